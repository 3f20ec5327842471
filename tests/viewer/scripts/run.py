"""Runs scripts one after the other in one process, each with a window of its own: ``run.py TASK.json [WORDS ...]``.

Before each script what ``prepared.py`` makes is made anew; the script imports it as the module ``prepared``.
"""

import json
import sys
import time
import traceback
from pathlib import Path
from types import ModuleType


def settle(window, seen):
    # the server says when a new window is uncovered, on a busy machine late: then it draws at once, and no time has passed
    quiet = 0
    for _ in range(100):
        before = len(seen)
        window.dispatch_events()
        quiet = quiet + 1 if len(seen) == before else 0
        if len(seen) > 1 and quiet >= 5:
            break
        time.sleep(0.01)


def run(path, module):
    source = Path(path).read_text(encoding="utf-8")
    exec(compile(source, path, "exec"), vars(module))


def main():
    import pyglet

    pyglet.options.audio = ("silent",)
    from pyglet.window import BaseWindow

    seen = []

    def counting(self, name, *words, dispatch=BaseWindow.dispatch_event):
        if name in ("on_refresh", "on_expose"):
            seen.append(name)
        return dispatch(self, name, *words)

    BaseWindow.dispatch_event = counting
    with open(sys.argv[1], encoding="utf-8") as task:
        prepare, scripts, out = json.load(task)
    said = {}
    for name, script in scripts.items():
        prepared = sys.modules["prepared"] = ModuleType("prepared")
        seen.clear()
        try:
            run(prepare, prepared)
            if hasattr(prepared, "window"):
                settle(prepared.window, seen)
            run(script, ModuleType("script"))
            said[name] = ""
        except BaseException:
            said[name] = traceback.format_exc()
        finally:
            window = getattr(prepared, "window", None)
            if window is not None and window.context is not None:
                window.close()
        with open(out, "w", encoding="utf-8") as file:
            json.dump(said, file)


if __name__ == "__main__":
    sys.path.append(str(Path(__file__).parents[1]))  # what stands beside the tests
    main()
