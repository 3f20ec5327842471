"""The pages that the program writes are kept where they can be read without a build, and say what it says today."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest
from listings import DOCS, GENERATED

sys.path.insert(0, str(DOCS))

import reference_pages

from itouch_tools.authoring.codes import CODES
from itouch_tools.cli import COMMANDS, _plugin_commands, sweep

REFERENCE: Path = DOCS / "reference"
_ADVICE = "the program writes another page: python docs/reference_pages.py"


@pytest.mark.parametrize("name", ["scene.md", "sweep-language.md", "units.md"])  # the others in CI, with the site
def test_a_page_that_is_kept_is_current(name: str) -> None:
    made = reference_pages._pages()[name]()
    assert (REFERENCE / name).read_text(encoding="utf-8") == made, _ADVICE


def test_all_pages_are_kept_and_name_all() -> None:
    assert all((REFERENCE / name).is_file() for name in GENERATED)
    errors = (REFERENCE / "errors.md").read_text(encoding="utf-8")
    assert [name for name in CODES if f"### {name}\n" not in errors] == [], _ADVICE
    commands = (REFERENCE / "command-line.md").read_text(encoding="utf-8")
    assert [name for name in {*COMMANDS, *_plugin_commands()} if f"## itouch-py {name}\n" not in commands] == [], (
        _ADVICE
    )


def test_the_commands_of_a_command_have_their_sections() -> None:
    page = (REFERENCE / "command-line.md").read_text(encoding="utf-8")
    for name in ("study", "thermal", "measure"):
        own = page.partition(f"\n## itouch-py {name}\n")[2].partition("\n## ")[0]
        listed = re.findall(r"(?m)^ {4}([a-z-]+)(?=  |$)", own)
        assert listed
        assert [each for each in listed if f"\n### itouch-py {name} {each}\n" not in own] == [], _ADVICE
    assert [each for each in sweep.COMMANDS if f"\n### itouch-py sweep {each}\n" not in page] == [], _ADVICE


def test_each_switch_of_a_cache_stands_in_the_reference_of_the_command_line() -> None:
    sources = [path.read_text(encoding="utf-8") for path in (DOCS.parent / "framework").rglob("*.py")]
    switches = {name for text in sources for name in re.findall(r'^SWITCH = "(\w+)"', text, re.MULTILINE)}
    assert len(switches) == 3
    page = (REFERENCE / "command-line.md").read_text(encoding="utf-8").partition("\n## Environment variables\n")[2]
    assert [name for name in switches if f"\n| `{name}` | " not in page] == [], _ADVICE
