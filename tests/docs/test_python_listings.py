"""The Python listings of a page are run one after the other, as a reader would; or stand in a tested file."""

from __future__ import annotations

import contextlib
import functools
import re
import textwrap
import time
from pathlib import Path

import pytest
from listings import ROOT, WALKED, listings
from python_pages import SETUPS, EnoughError

PYTHON = [listing for listing in listings() if listing.language == "python" and listing.page not in WALKED]
PAGES = list(dict.fromkeys(listing.page for listing in PYTHON))
#: Folders of code that is tested: a listing may be a piece of it.
TESTED = ("tests/outside", "tests/scaffold", "framework/itouch_tools/scaffold/templates", "docs/examples")


def _bare(text: str) -> str:
    return "\n".join(line.strip() for line in textwrap.dedent(text).splitlines() if line.strip())


def _in_a_tested_file(text: str) -> bool:
    """Tell whether each of a listing's pieces, without the name of its function, stands in a file that is tested."""
    pieces = [re.sub(r"\Adef .*:\n", "", piece) for piece in text.split("\n\n")]
    return all(any(_bare(piece) in known for known in _tested()) for piece in pieces)


@functools.cache
def _tested() -> list[str]:
    paths = [path for folder in TESTED for path in (ROOT / folder).rglob("*") if path.suffix in (".py", ".md", ".in")]
    return [_bare(path.read_text(encoding="utf-8")) for path in paths]


@pytest.mark.parametrize("page", PAGES)
def test_listings_run_in_the_order_of_the_page(page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pieces = [listing for listing in PYTHON if listing.page == page]
    if page not in SETUPS:
        missing = [listing.name for listing in pieces if not _in_a_tested_file(listing.text)]
        assert not missing, "give the page a setup in tests/docs/python_pages.py, or take listings from a tested file"
        return
    monkeypatch.chdir(tmp_path)
    names = SETUPS[page](tmp_path, monkeypatch)
    names["__name__"] = "listing"
    close = names.pop("close", lambda: None)
    try:
        for listing in pieces:
            with contextlib.suppress(EnoughError):
                exec(compile(listing.text, listing.name, "exec", dont_inherit=True), names)
    finally:
        close()


def test_the_device_of_the_readme_opens_reads_and_writes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is not only read without an error: it opens, reads a pose and writes a force."""
    from itouch.plugin import Field, Record, Terminal

    names = SETUPS["README.md"](tmp_path, monkeypatch)
    (listing,) = [listing for listing in PYTHON if listing.page == "README.md"]
    exec(compile(listing.text, listing.name, "exec", dont_inherit=True), names)
    board = Terminal(str(tmp_path / "port"))
    lever = names["Lever"](names["LeverParams"](path=str(tmp_path / "port")))
    assert lever.timing.watchdog, "without a watchdog of its own the hardware would be refused (no-watchdog)"
    lever.open()
    reading = Record.of([Field("pose", "f8", 7)])
    lever.read(reading)
    assert reading["pose"][2] == 0.0  # nothing has come yet, and it does not wait for it
    board.send(b"\x00\x40")
    end = time.monotonic() + 300.0
    while not reading["pose"][2] and time.monotonic() < end:
        lever.read(reading)
    assert reading["pose"][2] == pytest.approx(0.025)
    command = Record.of([Field("wrench", "f8", 6)])
    command["wrench"] = (0.0, 0.0, 2.0, 0.0, 0.0, 0.0)
    lever.write(command)
    heard = board.receive()
    while len(heard) < 2 and time.monotonic() < end:
        heard += board.receive()
    assert heard == b"\xf4\x01"
    lever.close()
    board.close()
