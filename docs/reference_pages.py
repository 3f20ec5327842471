"""Pages that the program writes: scene elements, codes of messages, commands, channels, Python API, campaigns.

The site writes what is not current when it is built. But for the Python API, which is nothing without the site, the
pages are kept in the repository, so that they can be read there: ``python docs/reference_pages.py`` writes them all,
and CI asks that nothing has changed after it built the site.
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import os
import re
from collections.abc import Callable
from pathlib import Path

import campaigns
import channels
import python_api
import units_page

HERE = Path(__file__).parent
#: The section on environment variables, after those that are the program's own.
VARIABLES = """\
## Environment variables

A folder for what is cached is used only if it is the user's and nobody else can write to it. `itouch-py doctor` names
each with what is in it, and `itouch-py doctor --clear-kept` empties them. Give full paths: a relative
one is ignored, with a note.

| variable | meaning | default |
|---|---|---|
{kept}
| `NUMBA_CACHE_DIR` | Numba's own folder: all compiled kernels lie there, and none elsewhere | not set |
| `XDG_CACHE_HOME` | on Linux, the folder in which those three lie | `~/.cache` |
| `XDG_STATE_HOME` | folder of what is noted of [participants](safety-limits.md) | `~/.local/state` |
| `NO_COLOR` | anything: no colours on the terminal | not set |

On macOS the three folders lie in `~/Library/Caches/itouch-py`, on Windows in `%LOCALAPPDATA%\\itouch-py`.
"""


def write_pages() -> None:
    """Write the pages that differ from what is there."""
    for name, text in ((name, make()) for name, make in _pages().items()):
        _put(HERE / "reference" / name, text)
    _put(HERE / "explanation" / "campaigns.md", campaigns.page())
    _put(campaigns.CASE, campaigns.case())
    stamp, digest = HERE / "_generated" / "code.sha256", _digest()
    page = HERE / "reference" / "errors.md"
    if page.exists() and stamp.exists() and stamp.read_text(encoding="utf-8") == digest:
        return
    from itouch_tools.cli.explain.code_page import page as errors

    _put(page, errors())
    stamp.parent.mkdir(exist_ok=True)
    stamp.write_text(digest, encoding="utf-8")


def _pages() -> dict[str, Callable[[], str]]:
    return {
        "scene.md": _scene,
        "sweep-language.md": _sweeps,
        "channels.md": channels.page,
        "units.md": units_page.page,
        **python_api.pages(),
    }


def _scene() -> str:
    from itouch.plugin.discovery import Catalog
    from itouch_tools.authoring.grammar import reference

    return reference(Catalog())


def _sweeps() -> str:
    from itouch_tools.authoring.grammar import elements_of
    from itouch_tools.sweeps.sweep_elements import Sweep

    head = "# Elements of sweeps\n\nGenerated from the classes that read the files, as are those of scenes.\n"
    return head + elements_of(Sweep, "outermost")


def _digest() -> str:
    """Return a digest of the program's source."""
    root, digest = HERE.parent, hashlib.sha256()
    for folder in ("framework", "plugins", "scenes"):
        for path in sorted((root / folder).rglob("*")):
            if path.suffix in (".py", ".xml"):
                digest.update(path.read_bytes())
    return digest.hexdigest()


def write_commands() -> None:
    """Write the reference of the command line, out of each command's own help, and the environment variables."""
    from itouch_tools.cli import COMMANDS, _plugin_commands
    from itouch_tools.cli.command_options import HELP

    lines = [
        "# Command line",
        "",
        "Generated from the commands' own help. At the end: [environment variables](#environment-variables).",
        "",
        "```text",
        HELP.rstrip(),
        "```",
        "",
    ]
    for name in sorted({*COMMANDS, *_plugin_commands()}):
        lines += _of_command(name)
    lines += [_variables()]
    _put(HERE / "reference" / "command-line.md", "\n".join(lines))


def _of_command(*words: str) -> list[str]:
    """Return the section of a command, with those of the commands that it has of its own, whose list is in its help."""
    from itouch_tools.cli import sweep

    text = _help(*words)
    own = list(sweep.COMMANDS) if words == ("sweep",) else re.findall(r"(?m)^ {4}([a-z][a-z-]*)(?=  |$)", text)
    text = text.partition("\n\noptions of every command:")[0]  # they stand at the top
    lines = ["#" * (1 + len(words)) + f" itouch-py {' '.join(words)}", "", "```text", text, "```", ""]
    for each in own:
        lines += _of_command(*words, each)
    return lines


def _help(*words: str) -> str:
    """Return what a command's ``--help`` prints.

    Raises
    ------
    RuntimeError
        If it does not end with 0.
    """
    from itouch_tools.cli import main

    said, code = io.StringIO(), 0
    known = {name: os.environ.get(name) for name in ("COLUMNS", "NO_COLOR")}
    os.environ.update(COLUMNS="78", NO_COLOR="1")
    try:
        with contextlib.redirect_stdout(said):
            code = main([*words, "--help"])
    except SystemExit as end:
        code = end.code or 0
    finally:
        for name, value in known.items():
            os.environ.pop(name)
            if value is not None:
                os.environ[name] = value
    if code:
        raise RuntimeError(f"itouch-py {' '.join(words)} --help ends with {code}")
    return said.getvalue().rstrip()


def _variables() -> str:
    """Return the section on environment variables."""
    from itouch import compiling
    from itouch.contact.meshfile import cache as meshes
    from itouch.plugin import result_cache

    kept = (
        (
            compiling.SWITCH,
            "kernels",
            "compiled kernels; or `off`: they lie beside the code that they are compiled from",
        ),
        (result_cache.SWITCH, "found", "results of compiling scenes: start temperatures, modal bases; or `off`"),
        (meshes.SWITCH, "meshes", "surfaces built from [mesh files](mesh-files.md#the-cache); or `off`"),
    )
    rows = [f"| `{switch}` | folder for {what} | `~/.cache/itouch-py/{name}` |" for switch, name, what in kept]
    return VARIABLES.format(kept="\n".join(rows))


def _put(page: Path, text: str) -> None:
    if not page.exists() or page.read_text(encoding="utf-8") != text:
        page.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    write_pages()
    write_commands()
