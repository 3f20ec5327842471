"""The file of a sweep: every mistake is told at its place, all at once, before anything runs."""

from __future__ import annotations

from pathlib import Path

import pytest
from lxml import etree
from shipped import SCENES, SWEEPS
from sweeping import COLLECT, VARIED, written

from itouch.plugin.discovery import Catalog
from itouch_tools.cli import main
from itouch_tools.sweeps.sweep_elements import Sweep
from itouch_tools.sweeps.sweep_reading import load_sweep, read_sweep


def problems(folder: Path, inside: str) -> list[tuple[str, int, str]]:
    _, found = read_sweep(written(folder, inside), Catalog())
    assert all(problem.place is not None for problem in found)
    return [(problem.code, problem.place.line if problem.place else 0, problem.advice) for problem in found]


def test_all_problems_come_at_once_with_their_lines(tmp_path: Path) -> None:
    found = problems(tmp_path / "a", '<grid name="m" set="operatr.mass" values="60"/>\n<grid name="s" set='
                     '"wood/contact.stifness" values="1"/>' + COLLECT)  # fmt: skip
    assert found == [
        ("unknown-name", 2, "did you mean 'operator'?"),
        ("unknown-attribute", 3, "did you mean 'stiffness'?"),
    ]
    found = problems(tmp_path / "b", VARIED + '<collect>\n<field name="p" of="finger.forc"/>\n<call name="c" function='
                     '"own.py:cuont"/>\n<call name="d" function="no.py:x"/></collect>')  # fmt: skip
    assert [code for code, _, _ in found] == ["unknown-name"] * 3
    assert found[0][2] == "did you mean 'finger.force'?"
    assert len({line for _, line, _ in found}) == 3


@pytest.mark.parametrize(
    ("run", "begin", "said"),
    [
        ('<run for="2 s"/>', 'begin="2 s"', "'touching' counts from 2 s on, and runs end at 2 s"),
        ('<run for="2 s"/>', 'begin="1.9 s"', ""),
        ("", 'begin="60 s"', ""),  # where the motion ends is not known before it has run
        ("", 'begin="0.5 s" end="0.5 s"', "'touching' counts to 0.5 s, and only from 0.5 s on"),
    ],
)
def test_a_field_over_a_time_that_no_run_has_is_warned_of(tmp_path: Path, run: str, begin: str, said: str) -> None:
    text = VARIED + run + COLLECT.replace('begin="0.2 s"', begin)
    file, found = read_sweep(written(tmp_path, text), Catalog())
    assert file is not None  # such a sweep ran before, and goes on running
    assert [(one.severity, one.sentence) for one in found] == (
        [("warning", f"{said}: it would be empty")] if said else []
    )


def test_draws_are_not_said_to_be_empty_because_their_parameter_is_wrong(tmp_path: Path) -> None:
    found = problems(tmp_path, '<draws kind="random" count="2"><over name="s" set="wood/contact.stiffness" low="5" '
                     'high="2"/></draws>' + COLLECT)  # fmt: skip
    assert [(code, line) for code, line, _ in found] == [("bad-value", 2)]


@pytest.mark.parametrize(
    ("inside", "code"),
    [
        (COLLECT, "missing-element"),
        (VARIED, "missing-element"),
        (VARIED.replace('values="60 80"', 'low="60" high="50" steps="3"') + COLLECT, "bad-value"),
        (VARIED.replace('values="60 80"', 'values="60 80" low="1" high="2" steps="3"') + COLLECT, "exclusive"),
        (VARIED.replace('values="60 80"', 'low="1" high="2"') + COLLECT, "together"),
        (VARIED.replace('low="0.8"', 'low="-5"') + COLLECT, "out-of-range"),
        (VARIED.replace("sobol", "halton") + COLLECT, "bad-value"),
        (VARIED.replace('count="2"/>', 'count="0"/>') + COLLECT, "out-of-range"),
        (VARIED.replace("stiffness\" set", "mass\" set") + COLLECT, "duplicate-name"),
        (VARIED.replace("\"mass\"", "\"digest\"") + COLLECT, "duplicate-name"),
        (VARIED + COLLECT.replace("contacts[0]", "contacts[0"), "bad-value"),
        (VARIED + COLLECT.replace('index="2"', 'index="3"'), "out-of-range"),
        (VARIED + COLLECT + '<stop><enough result="forse" half-width="1"/></stop>', "unknown-name"),
        (VARIED + COLLECT + "<sto/>", "unknown-element"),
    ],
)  # fmt: skip
def test_a_mistake_has_its_code(tmp_path: Path, inside: str, code: str) -> None:
    assert {found[0] for found in problems(tmp_path / "a", inside)} == {code}


def test_a_file_that_is_no_sweep_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["sweep", "check", str(SCENES / "first_touch.xml")]) == 2
    assert "not <sweep>" in capsys.readouterr().err
    assert main(["sweep", str(tmp_path / "none.xml"), "-o", str(tmp_path / "out")]) == 2
    assert "error[no-such-file]" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("path", SWEEPS, ids=[path.stem for path in SWEEPS])
def test_shipped_sweeps_are_right(path: Path) -> None:
    file = load_sweep(path, Catalog())
    assert len(file.plan()) > 40


def test_the_schema_takes_shipped_sweeps_and_refuses_mistakes(tmp_path: Path) -> None:
    assert main(["schema", str(tmp_path)]) == 0
    schema = etree.XMLSchema(etree.parse(str(tmp_path / "sweep.xsd")))
    for path in SWEEPS:
        schema.assertValid(etree.parse(str(path)))
        text = path.read_text(encoding="utf-8")
        for right, wrong in (("<collect>", '<collect of="1">'), (' set="', ' sett="')):
            assert right in text
            assert not schema.validate(etree.fromstring(text.replace(right, wrong).encode()))


def test_every_attribute_is_in_the_reference() -> None:
    from itouch_tools.authoring.grammar import elements_of

    text = elements_of(Sweep, "the outermost element")
    for word in ("half-width", "patience", "## `<over>`", "## `<call>`", "at-least", "Latin hypercube"):
        assert word in text
