"""Doing what a page of the docs says, from its first line to its last; ``python tutorial.py PAGE FOLDER`` does it for real.

On a page ``% file: PATH`` stands before the whole content of a file, ``% step: PATH N`` before what takes the place of the
line ``STEP N``, ``% done: PATH N`` where that line is deleted; the commands are the ``$`` lines of its console listings,
and ``% fails: TEXT`` stands before those that must fail and say so.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import textwrap
import time
from collections.abc import Callable, Iterator
from pathlib import Path

_MARK = re.compile(r"% (file|step|done|fails): (\S+)(.*)")
_FENCE = re.compile(r"(`{3,})(\w*)$")
Run = Callable[[str, Path], tuple[int, str]]


def actions(page: str) -> Iterator[tuple[str, str, str, str]]:
    """Yield kind, path, rest of the mark and text, in the order of the page; headings too."""
    lines = iter(page.splitlines())
    mark: re.Match[str] | None = None
    for line in lines:
        found, fence = _MARK.fullmatch(line), _FENCE.fullmatch(line)
        if line.startswith("#"):
            yield "part", line.lstrip("# "), "", ""
        if found:
            mark = found
            if mark[1] == "done":
                yield "done", mark[2], mark[3].strip(), ""
                mark = None
        if fence:
            body = "\n".join(iter(lambda: next(lines), fence[1]))
            if mark is not None and mark[1] in ("file", "step"):
                yield mark[1], mark[2], mark[3].strip(), body + "\n"
            elif fence[2] == "console":
                wanted = f"{mark[2]}{mark[3]}" if mark is not None else ""
                for command in body.splitlines():
                    yield "command", command.removeprefix("$ "), wanted, ""
            mark = None


def files(page: str) -> dict[str, str]:
    """Return the files whose whole content is on the page."""
    return {path: text for kind, path, _, text in actions(page) if kind == "file"}


def walk(page: str, folder: Path, run: Run) -> list[tuple[str, float]]:
    """Do everything in a folder; return how long each part took [s]."""
    parts: list[tuple[str, float]] = []
    begin = time.perf_counter()
    for kind, path, rest, text in actions(page):
        if kind == "part":
            parts.append((path, time.perf_counter() - begin))
        elif kind == "file":
            (folder / path).write_text(text)
        elif kind in ("step", "done"):
            _step(folder / path, int(rest), text)
        elif path.startswith("cd "):
            folder = (folder / path.removeprefix("cd ")).resolve()
        else:
            _do(path, folder, rest, run)
    parts.append(("end", time.perf_counter() - begin))
    return [(name, after - before) for (name, before), (_, after) in zip(parts, parts[1:], strict=False)]


def _do(command: str, folder: Path, wanted: str, run: Run) -> None:
    code, said = run(command, folder)
    if wanted and (code == 0 or wanted not in said):
        raise SystemExit(f"$ {command}\nshould have failed with '{wanted}':\n{said}")
    if not wanted and code:
        raise SystemExit(f"$ {command}\nexit code {code}:\n{said}")


def _step(path: Path, number: int, text: str) -> None:
    lines = path.read_text().splitlines()
    at = next(i for i, line in enumerate(lines) if f"STEP {number}:" in line)
    indent = " " * (len(lines[at]) - len(lines[at].lstrip()))
    lines[at : at + 1] = textwrap.indent(text.rstrip("\n"), indent).splitlines() if text else []
    path.write_text("\n".join(lines) + "\n")


def for_real(command: str, folder: Path) -> tuple[int, str]:
    """Run a command in the environment whose Python this is."""
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    done = subprocess.run(["bash", "-c", command], cwd=folder, capture_output=True, text=True, check=False,
                          env=os.environ | {"PATH": path})  # fmt: skip
    return done.returncode, done.stdout + done.stderr


if __name__ == "__main__":
    home = Path(sys.argv[2])
    home.mkdir(parents=True, exist_ok=True)
    for part, seconds in walk(Path(sys.argv[1]).read_text(), home, for_real):
        print(f"{seconds:6.1f} s  {part}", flush=True)
