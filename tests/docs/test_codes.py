"""Every code that the program can print is in the table, and has an example that really gives it."""

from __future__ import annotations

import ast
import functools
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

import pytest

from itouch.contact.meshfile import findings
from itouch.safety import Trip
from itouch.scene import documents, source
from itouch_tools.authoring.codes import CODES, HEADINGS, RUNNING
from itouch_tools.cli import main
from itouch_tools.cli.explain import examples
from itouch_tools.cli.explain.example import play

EXAMPLES = examples()
FILES = [code.name for codes in HEADINGS.values() if codes is not RUNNING for code in codes]
#: What makes a problem with a code -> which argument the code is.
MAKERS = {"Problem": 0, "MeshError": 0, "ValueProblemError": 0, "MeshFinding": 0, "_refuse": 0}
#: Notes of meshes, which carry no code on the screen.
NOTES = {"mesh-left-out", "mesh-inverted", "mesh-repeated", "mesh-degenerate", "mesh-joined"}


def packages() -> Iterator[Path]:
    for name in (
        "itouch",
        "itouch_tools",
        "itouch_evidence",
        "itouch_thermal",
        "itouch_xyz_table",
        "itouch_encountered",
        "itouch_usb_arm",
    ):
        spec = find_spec(name)
        assert spec is not None
        assert spec.origin is not None
        yield Path(spec.origin).parent


@functools.cache
def made() -> tuple[tuple[str, str], ...]:
    """Return (code, where) of each problem in the source; the code is "" where it is no literal."""
    return tuple(_made())


def _made() -> Iterator[tuple[str, str]]:
    for folder in packages():
        for path in folder.rglob("*.py"):
            if {"testing", "doctor", "identify"} & set(path.parts):  # findings, and problems, of another kind
                continue
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if not isinstance(node, ast.Call):
                    continue
                name = getattr(node.func, "id", "") or getattr(node.func, "attr", "")
                if name in MAKERS and node.args:
                    code = node.args[MAKERS[name]]
                    yield str(code.value) if isinstance(code, ast.Constant) else "", f"{path.name}:{node.lineno}"


def test_no_problem_has_a_code_outside_the_table() -> None:
    unknown = {(code, where) for code, where in made() if code and code not in CODES and code not in NOTES}
    assert not unknown
    handed_on = {where.partition(":")[0] for code, where in made() if not code}
    assert handed_on <= {
        "binding.py", "documents.py", "rig.py", "surfaces.py", "object_shapes.py", "motion_tables.py", "error_transport.py", "source.py", "findings.py",
    }, "a problem with a code that is no literal: let it be one, or handed on from another problem"  # fmt: skip


def test_every_code_of_the_table_is_used() -> None:
    used = {code for code, _ in made()} | {trip.label for trip in Trip} | {"injected"}
    assert set(CODES) <= used


def test_codes_say_the_numbers_that_files_are_refused_by() -> None:
    def length(metres: float) -> str:
        return next(
            f"{round(metres / unit):g} {symbol}"
            for unit, symbol in ((1.0, "m"), (1e-3, "mm"), (1e-6, "um"))
            if metres >= unit
        )

    told = {
        "too-many-includes": [f"{documents.MAX_INCLUDE_DEPTH} deep", f"{documents.MAX_DOCUMENTS} documents"],
        "too-large": [f"{source.MAX_BYTES >> 20} MiB"],
        "too-deep": [f"{source.MAX_DEPTH} deep"],
        "too-many-attributes": [f"{source.MAX_ATTRIBUTES} attributes"],
        "too-many-elements": [f"{source.MAX_ELEMENTS:,} elements".replace(",", " ")],
        "mesh-units": [
            length(one) for one in (findings.TOO_LARGE, findings.TOO_SMALL, findings.GREATEST, findings.SMALLEST)
        ],
    }
    for code, words in told.items():
        at = 0
        for word in words:
            at = CODES[code].wrong.find(word, at) + 1
            assert at > 0, f"'{word}' is not in: {CODES[code].wrong}"


def test_every_trip_is_in_the_table() -> None:
    assert {code.name for code in RUNNING} == {trip.label for trip in Trip if trip is not Trip.NONE} | {"injected"}


def test_every_code_has_one_example() -> None:
    assert set(EXAMPLES) == set(CODES)
    assert len(CODES) == sum(len(codes) for codes in HEADINGS.values())


@pytest.mark.parametrize("code", FILES)
def test_an_input_gives_its_code(code: str) -> None:
    printed = play(EXAMPLES[code])
    found = [line.partition("[")[2].partition("]")[0] for line in printed.splitlines() if "[" in line.split(":")[0]]
    assert set(found) == {code}
    assert ".xml:" in printed
    assert EXAMPLES[code].text.strip()


@pytest.mark.parametrize("code", [code.name for code in RUNNING])
def test_a_run_gives_its_code(code: str) -> None:
    printed = play(EXAMPLES[code])
    assert f"fault[{code}]: device '" in printed
    others = {line.partition("[")[2].partition("]")[0] for line in printed.splitlines() if line.startswith("fault[")}
    assert others <= {code, "injected"}


def test_explain_lists_and_explains(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["explain"]) == 0
    listed = capsys.readouterr().out
    assert all(f"  {name} " in listed for name in CODES)
    assert main(["explain", "error[unknown-name]"]) == 0
    assert "did you mean 'wood'?" in capsys.readouterr().out
    assert main(["explain", "unknown-nam"]) == 2
    assert "did you mean 'unknown-name'?" in capsys.readouterr().err


def test_the_page_shows_input_files_command_and_message() -> None:
    from itouch_tools.cli.explain.code_page import _entry

    text = "\n".join(_entry(CODES["rig"], EXAMPLES["rig"]))
    for part in ('<device name="arm"', "`rig.xml` beside it", "itouch-py check scene.xml --rig rig.xml", "error[rig]:"):
        assert part in text
    assert text.startswith("### rig\n")


def test_the_page_names_the_files_in_which_each_code_is_told() -> None:
    from itouch_tools.cli.explain.code_page import told_in

    assert [code for code in CODES if not told_in(code)] == ["injected"]  # that is no reason, but who asked for it
    for code, where in made():
        if code in CODES:
            assert where.partition(":")[0] in {Path(file).name for file in told_in(code)}
    assert told_in("released") == ["itouch/safety/hold_to_run.py", "itouch_tools/cli/doctor/rig_checks.py"]
    from itouch_tools.cli.explain.code_page import _entry

    assert "Reported in `itouch/scene/rigs.py`." in "\n".join(_entry(CODES["rig"], EXAMPLES["rig"]))
