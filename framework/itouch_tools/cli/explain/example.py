"""One wrong input for a code, and what the program prints about it."""

from __future__ import annotations

import contextlib
import importlib
import io
import os
import shutil
import sys
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path


@dataclass(frozen=True, slots=True)
class Example:
    """A wrong input: files by name, the words of a command, and what is different about the machine.

    ``shown`` is the file that a reader should see (default: the scene), ``note`` a text in its place;
    ``absent`` a package that is made to appear not installed; ``plugin`` whether the folder holds an installed plugin;
    ``shipped`` whether it holds the shipped scenes; ``varies`` are patterns of what differs from run to run, each with
    the text that the page has in its place.
    """

    files: Mapping[str, str | bytes] = field(default_factory=dict)
    words: tuple[str, ...] = ("check", "scene.xml")
    shown: str = "scene.xml"
    note: str = ""
    absent: str = ""
    plugin: bool = False
    shipped: bool = False
    varies: tuple[tuple[str, str], ...] = ()

    @property
    def text(self) -> str:
        """What a reader sees of the input: the file's text, or the note."""
        content = self.files.get(self.shown, b"")
        return self.note or (content if isinstance(content, str) else content.decode("utf-8", "replace"))


def scene(
    body: str,
    others: Mapping[str, str | bytes] | None = None,
    *,
    words: str = "check scene.xml",
    note: str = "",
    absent: str = "",
    plugin: bool = False,
) -> Example:
    """Return the example of one scene, with other files beside it."""
    lines = "\n".join(f"  {line}" for line in body.rstrip().splitlines())
    files = {"scene.xml": f'<itouch version="1.0">\n{lines}\n</itouch>\n', **(others or {})}
    return Example(files, tuple(words.split()), note=note, absent=absent, plugin=plugin)


def play(example: Example) -> str:
    """Run an example in a folder of its own; return what the program prints."""
    from itouch_tools.cli import main

    printed = io.StringIO()
    with (
        tempfile.TemporaryDirectory() as folder,
        _inside(Path(folder), example),
        contextlib.redirect_stdout(printed),
        contextlib.redirect_stderr(printed),
    ):
        if example.words[0] == "python":
            exec(compile(example.files[example.words[1]], example.words[1], "exec", dont_inherit=True), {})
        else:
            main(list(example.words))
    return printed.getvalue()


@contextlib.contextmanager
def _inside(folder: Path, example: Example) -> Iterator[None]:
    """Set up the example's files and process, and restore the process afterwards."""
    if example.shipped:
        from itouch_tools.cli.demo import scenes_folder

        python = example.words[0] == "python"
        shutil.copytree(scenes_folder(), folder / "scenes" if python else folder, dirs_exist_ok=True)
    for name, content in example.files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content.encode() if isinstance(content, str) else content)
    with contextlib.chdir(folder), _without(example.absent), _on_path(folder if example.plugin else None):
        yield


@contextlib.contextmanager
def _without(package: str) -> Iterator[None]:
    """Make a package appear not installed."""
    before = sys.modules.get(package)
    if package:
        sys.modules[package] = None  # type: ignore[assignment]  # for the import system: there is no such module
    try:
        yield
    finally:
        if package:
            sys.modules.pop(package)
            if before is not None:
                sys.modules[package] = before


@contextlib.contextmanager
def _on_path(folder: Path | None) -> Iterator[None]:
    """Make a folder's distributions appear installed; modules imported from it are forgotten afterwards."""
    if folder is None:
        yield
        return
    sys.path.insert(0, os.fspath(folder))
    importlib.invalidate_caches()
    known = set(sys.modules)
    try:
        yield
    finally:
        sys.path.remove(os.fspath(folder))
        for name in set(sys.modules) - known:
            if str(getattr(sys.modules[name], "__file__", "") or "").startswith(os.fspath(folder)):
                sys.modules.pop(name)
