"""Scripts that drive a window: all of a module in one process, each with a window and a session of its own."""

from __future__ import annotations

import json
import subprocess
import sys
import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path

import pytest

#: Lets scripts import what stands beside this file.
_FOUND = f"import sys\nsys.path.append({str(Path(__file__).parent)!r})\n"
RUN = """
import json, sys, time, traceback
import pyglet
pyglet.options.audio = ("silent",)
from pyglet.window import BaseWindow
seen = []
def counting(self, name, *words, dispatch=BaseWindow.dispatch_event):
    if name in ("on_refresh", "on_expose"):
        seen.append(name)
    return dispatch(self, name, *words)
BaseWindow.dispatch_event = counting
def settle(window):
    # the server says when a new window is uncovered, on a busy machine late: then it draws at once, and no time has passed
    quiet = 0
    for _ in range(100):
        before = len(seen)
        window.dispatch_events()
        quiet = quiet + 1 if len(seen) == before else 0
        if len(seen) > 1 and quiet >= 5:
            break
        time.sleep(0.01)
prepare, scripts, out = json.load(open(sys.argv[1]))
said = {}
for name, script in scripts.items():
    space = {"__name__": "script"}
    seen.clear()
    try:
        exec(compile(prepare, "<prepare>", "exec"), space)
        if "window" in space:
            settle(space["window"])
        exec(compile(script, f"<{name}>", "exec"), space)
        said[name] = ""
    except BaseException:
        said[name] = traceback.format_exc() + "".join(f"{line}\\n" for line in script.splitlines())
    finally:
        if "window" in space and space["window"].context is not None:
            space["window"].close()
    json.dump(said, open(out, "w"))
"""


def asked(request: pytest.FixtureRequest, scripts: Mapping[str, str]) -> dict[str, str]:
    """Return the scripts of which this run asks: those whose tests were not left to the long form."""
    here = {item.callspec.params.get("name") for item in request.session.items
            if item.path == request.path and hasattr(item, "callspec")}  # fmt: skip
    return {name: script for name, script in scripts.items() if name in here}


def drive(
    prepare: str, scripts: Mapping[str, str], words: Sequence[str], environment: Mapping[str, str], folder: Path
) -> dict[str, str]:
    """Run scripts, and return what went wrong with each, or an empty text; ``words`` are in ``sys.argv[2:]``."""
    task, out = folder / "task.json", folder / "said.json"
    plain = {name: textwrap.dedent(script) for name, script in scripts.items()}
    task.write_text(json.dumps([prepare, plain, str(out)]))
    done = subprocess.run([sys.executable, "-c", _FOUND + RUN, str(task), *words], capture_output=True, text=True,
                          env=dict(environment), timeout=600)  # fmt: skip
    said = json.loads(out.read_text()) if out.exists() else {}
    died = f"the process ended with {done.returncode} before this script had: {done.stderr}"
    return {name: said.get(name, died) for name in scripts}
