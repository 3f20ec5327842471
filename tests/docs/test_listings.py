"""Every listing of the documentation is checked, run, or part of a file that is: none is left out."""

from __future__ import annotations

import argparse
import contextlib
import functools
import io
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from listings import DOCS, ROOT, WALKED, Listing, listings, scene_around
from shipped import SCENES

from itouch_tools.authoring.codes import CODES
from itouch_tools.cli import COMMANDS, _plugin_commands, main

EVERY = listings()
ALL = [listing for listing in EVERY if listing.page not in WALKED]
COMMAND_LINES = ("sh", "bash", "console")
#: First words of lines that are not ours.
FOREIGN = {
    ".", "pip", "cd", "pytest", "groupadd", "usermod", "printf", "python", "npm", "node", "cpupower", "apt", "pro", "python3",
    "pactl", "rm", "make", "dask", "srun",
}  # fmt: skip
#: Directives that bring no listing of their own.
STRUCTURE = ("{toctree}", "{figure}", "{include}", "{admonition}", "{note}", "{warning}", "{image}")


def of(*languages: str) -> Any:
    some = EVERY if languages == COMMAND_LINES else ALL
    chosen = [listing for listing in some if listing.language in languages]
    return pytest.mark.parametrize("listing", chosen, ids=lambda listing: listing.name)


def test_every_listing_says_what_it_is() -> None:
    known = (*COMMAND_LINES, "xml", "python", "text", "csv", "toml")
    bare = [
        listing.name for listing in ALL
        if listing.language not in known
        and not listing.language.startswith((*STRUCTURE, "{literalinclude}", "{eval-rst}"))
    ]  # fmt: skip
    assert not bare, "a listing needs one of the languages that are tested here"
    assert len(ALL) > 60


@pytest.mark.parametrize(
    "listing", [one for one in ALL if one.language.startswith("{literalinclude}")], ids=lambda listing: listing.name
)
def test_included_files_are_tested_ones(listing: Listing) -> None:
    path = (ROOT / listing.page).parent / listing.language.split()[1]
    assert path.is_file()
    folder = path.resolve().relative_to(ROOT).parts[0]
    if folder == "docs":
        assert path.resolve().parent == DOCS / "examples"
    else:
        assert folder in ("scenes", "tests", "plugins")  # shipped scenes run in tests/integration
    for option, marker in re.findall(r":(start-at|end-before|start-after|end-at): (.*)", listing.text):
        assert marker in path.read_text(encoding="utf-8"), option


@pytest.mark.parametrize("example", sorted((DOCS / "examples").glob("*.py")), ids=lambda path: path.name)
def test_examples_print_what_their_pages_show(example: Path) -> None:
    done = subprocess.run([sys.executable, example], capture_output=True, text=True, check=True)
    shown = [listing.text for listing in ALL if listing.language == "text" and example.name in listing.before]
    assert shown == [done.stdout]


@functools.cache
def recording() -> bytes:
    """Return a recording of the smallest scene."""
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "touch.mcap"
        assert main(["run", str(SCENES / "first_touch.xml"), "--headless", "--record", str(path)]) == 0
        return path.read_bytes()


@of("xml")
def test_xml_is_right(listing: Listing, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any) -> None:
    if listing.text.startswith("<?xml-model"):
        monkeypatch.chdir(tmp_path)
        assert main(["new-scene", "blocks"]) == 0
        assert listing.text.strip() in (tmp_path / "blocks" / "blocks.xml").read_text(encoding="utf-8")
        return
    folder = tmp_path / "scenes"
    shutil.copytree(SCENES, folder)
    (folder / "curves").mkdir()
    for curve in ("wood.csv", *re.findall(r'file="(curves/[^"]*)"', listing.text)):
        (folder / curve).write_text("t,j\n0.001,2573.93\n0.002,2555.20\n")
    (folder / "lid.csv").write_text("t,x,y,z\n0,0,0,0\n1,0,0,0.1\n")
    if "touch.mcap" in listing.text:
        (folder / "touch.mcap").write_bytes(recording())
    (folder / "listing.xml").write_text(scene_around(listing.text), encoding="utf-8")
    monkeypatch.chdir(folder)
    assert main(["check", "listing.xml"]) == 0, capsys.readouterr().err


class _Parsed(Exception):  # noqa: N818
    """A command line was understood."""


def commands(listing: Listing) -> list[list[str]]:
    """Return the command lines of a listing: all of a script's, those behind the prompt of a console."""
    text = listing.text.replace("\\\n", " ")
    lines = [line.strip() for line in text.splitlines()]
    if listing.language == "console":
        lines = [line.removeprefix("$ ") for line in lines if line.startswith("$ ")]
    found = []
    for line in lines:
        for part in re.split(r" && | \| ", line):
            words = shlex.split(part, comments=True)
            while words and re.fullmatch(r"[A-Z_]+=.*", words[0]):
                words = words[1:]
            if words:
                found.append(words)
    return found


def understood(words: list[str]) -> None:
    """Let the program read its words, and stop before it does anything."""
    real = argparse.ArgumentParser.parse_args

    def parse(parser: argparse.ArgumentParser, args: Any = None, namespace: Any = None) -> Any:
        real(parser, args, namespace)
        raise _Parsed

    with pytest.MonkeyPatch.context() as patch, pytest.raises(_Parsed):
        patch.setattr(argparse.ArgumentParser, "parse_args", parse)
        main(words)


@of(*COMMAND_LINES)
def test_command_lines_are_understood(listing: Listing, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for words in commands(listing):
        program = Path(words[0]).name or words[0]
        if words[:2] == ["itouch-py", "demo"] and "--scenes" in words:
            assert main(words[1:]) == 0
        elif program == "itouch-py":
            understood(words[1:] if words[1:2] != ["demo"] else ["run", "scene.xml", *words[2:]])
        else:
            assert program in FOREIGN, f"{listing.name}: nobody checks '{' '.join(words)}'"


@of("text")
def test_printed_text_has_its_command(listing: Listing) -> None:
    synopsis = [line for line in listing.text.splitlines() if line.startswith("itouch-py ") and "[" in line]
    if synopsis:
        for line in synopsis:
            _is_offered(line)
        return
    codes = re.findall(r"(?:error|warning|fault)\[([\w-]+)\]", listing.text)
    assert set(codes) <= set(CODES)
    named = re.search(r"itouch-py \w|python docs/|pytest", listing.before + listing.text)
    assert codes or named, f"{listing.name}: say which command prints this"


def _is_offered(synopsis: str) -> None:
    words = synopsis.split()[1:]
    assert words[0] in COMMANDS or words[0] in _plugin_commands()
    path = [word for word in words if re.fullmatch(r"[a-z-]+", word)]
    lead = path[:2] if words[0] in ("thermal", "bench") else path[:1]
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed), contextlib.suppress(SystemExit):
        main([*lead, "--help"])
    for option in re.findall(r"--[\w-]+", synopsis):
        assert option in printed.getvalue(), f"{synopsis}: {option}"


@of("csv")
def test_tables_are_numbers(listing: Listing) -> None:
    rows = [line for line in listing.text.splitlines() if line and not line.startswith("#")]
    if not re.match(r"[-\d]", rows[0]):
        rows = rows[1:]
    assert len({len([float(number) for number in row.split(",")]) for row in rows}) == 1


@pytest.mark.parametrize(("page", "test"), WALKED.items())
def test_a_page_that_is_left_out_here_is_walked_there(page: str, test: str) -> None:
    walk = (ROOT / test).read_text(encoding="utf-8")
    assert Path(page).name in walk
    assert "def test_every_listing_is_a_tested_file" in walk
