"""The time of a check grows with the file: counted in what is done, not in seconds."""

from __future__ import annotations

from pathlib import Path

import pytest

from itouch.plugin.discovery import Catalog
from itouch.scene.loader import read_scene
from itouch.schema import diagnostics
from itouch.schema.diagnostics import Place, Problem, Suggestions
from itouch_evidence import bench_check as bench

_SCENE = '<itouch version="1.0"><materials>{}</materials><world temperature="23 °C">{}</world></itouch>'


def _read(tmp_path: Path, materials: str, objects: str = "") -> list[Problem]:
    path = tmp_path / "scene.xml"
    path.write_text(_SCENE.format(materials, objects), encoding="utf-8")
    return read_scene(path, Catalog())[1]


def test_a_chain_of_bases_may_be_as_long_as_the_file(tmp_path: Path) -> None:
    links = [f'<material name="m{i}" base="m{i - 1}"/>' for i in range(1, 2000)]
    first = '<material name="m0"><contact stiffness="1 N/mm"/></material>'
    assert _read(tmp_path, "".join([*reversed(links), first])) == []


def test_each_base_of_a_cycle_is_told_once(tmp_path: Path) -> None:
    links = [f'<material name="m{i}" base="m{(i + 1) % 3}"/>' for i in range(3)]
    found = _read(tmp_path, '<material name="leads there" base="m1"/>' + "".join(links))
    assert sorted(problem.sentence for problem in found if problem.code == "base-cycle") == [
        f"material 'm{i}' is its own base" for i in range(3)
    ]


def test_columns_of_a_long_line_are_those_of_its_letters(tmp_path: Path) -> None:
    wrong = [f'<bok name="°{i}" x="1"/>' for i in range(40)]
    found = [problem.place for problem in _read(tmp_path, "", "".join(wrong)) if problem.code == "unknown-element"]
    text = (tmp_path / "scene.xml").read_text(encoding="utf-8")
    assert [place.column for place in found if place is not None] == [text.index(one) + 1 for one in wrong]


def test_only_what_is_shown_of_a_long_line_is_looked_at() -> None:
    line = "x" * 400 + "\t<bok/>" + "y" * 400
    shown = Problem("unknown-element", "no", Place("a.xml", 1, 402, 6, line)).render().splitlines()
    assert shown[3].index("^") == shown[2].index("<bok/>")
    assert len(shown[2]) < 200 and "\t" not in shown[2]


def test_what_is_known_is_compared_with_so_many_words_only(monkeypatch: pytest.MonkeyPatch) -> None:
    compared: list[str] = []

    def nearest(word: str, known: object) -> str:
        compared.append(word)
        return ""

    monkeypatch.setattr(diagnostics, "nearest", nearest)
    monkeypatch.setattr(Suggestions, "ENOUGH", 40)
    suggestions = Suggestions(["wood", "foam"], "there are")
    advised = [suggestions.advise(f"w{i}") for i in range(100)]
    assert len(compared) == 13 and advised[0] == "there are: 'foam', 'wood'" and advised[13:] == [""] * 87


@pytest.mark.parametrize("kind", bench.KINDS)
def test_the_bench_checks_what_it_says(kind: str, tmp_path: Path) -> None:
    path = bench.written(kind, 40, tmp_path / "scene")
    scene, problems = read_scene(path, Catalog())
    wrong = {"misspelt": "unknown-element", "unknown": "unknown-name", "same-name": "duplicate-name"}
    assert {problem.code for problem in problems} == ({wrong[kind]} if kind in wrong else set())
    written = "".join(file.read_text(encoding="utf-8") for file in Path(path).parent.iterdir())
    assert 38 <= written.count("<") - written.count("</") <= 52
    assert kind not in ("boxes", "spheres", "included", "one-line") or len(scene.objects) == 40


def test_the_bench_fails_where_an_element_takes_longer_the_more_there_are(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def taken(power: float) -> None:
        def check(paths: list[str]) -> float:
            return 1.0 + sum(1e-4 * Path(path).read_text(encoding="utf-8").count("<to ") ** power for path in paths)

        monkeypatch.setattr(bench, "check", check)

    taken(1.0)
    assert bench.main(["targets", "--many", "4000"]) == 0
    taken(2.0)
    assert bench.main(["targets", "--many", "4000"]) == 1
    assert "4.00 times" in capsys.readouterr().out
