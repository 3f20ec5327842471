"""The paper's figures and claims from one command."""

import xml.etree.ElementTree as ElementTree

import pytest

from itouch_thermal import reproduce
from itouch_thermal.rendering.claims import claims
from itouch_thermal.rendering.figures import halfspaces, tem_step, touch

FIGURES = (2, 3, 4, 5, 6, 7, 9, 10, 11)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    out = tmp_path_factory.mktemp("reproduced")
    assert reproduce.main(["--out", str(out)]) == 0
    return out


@pytest.mark.parametrize("number", FIGURES)
def test_each_figure_is_drawn_twice(made, number):
    picture = (made / f"figure{number:02d}.png").read_bytes()
    assert picture.startswith(b"\x89PNG")
    assert len(picture) > 10_000
    assert ElementTree.parse(made / f"figure{number:02d}.svg").getroot().tag.endswith("svg")


def test_the_page_lists_claims_and_figures(made):
    page = (made / "claims.md").read_text(encoding="utf-8")
    rows = [line for line in page.splitlines() if line.startswith("| ") and not line.startswith("| claim")]
    assert len(rows) >= 20
    assert "nan" not in page
    for number in FIGURES:
        assert f"(figure{number:02d}.png)" in page
        assert f"\nFigure {number}. " in page


def test_claims_that_fail_for_ideal_bodies_say_so():
    found = {}
    for claim in claims():
        found[claim.claim] = claim
        if "contact resistance of 1e-4" in claim.claim:
            break
    assert "not for the bare bodies" in found["The more insulating the material, the faster the flux falls"].verdict
    assert "false for foam" in found["The sensor hardly disturbs the measurement"].verdict
    broken = found["The same, with a contact resistance of 1e-4 K m2/W"]
    assert broken.verdict.startswith("false")
    assert "+165, +37, +5 %" in broken.number


def test_insulators_fall_faster_only_under_the_film():
    def fall(flux):
        return flux[999] / flux[99]

    bare = {name: fall(touch(name, resistance=1e-4, seconds=1.0)) for name in ("aluminium", "polystyrene")}
    film = {name: fall(touch(name, films=1, resistance=1e-4, seconds=1.0)) for name in ("aluminium", "polystyrene")}
    assert bare["aluminium"] == pytest.approx(bare["polystyrene"], rel=0.06)
    assert film["polystyrene"] < 0.5 * film["aluminium"]
    assert film["polystyrene"] == pytest.approx(0.128, abs=0.005)


def test_halfspaces_begin_at_the_resistance_and_end_as_equation_two():
    first, late = halfspaces((1e-9, 100.0), 1e-4, "wood")
    assert first == pytest.approx(10.0 / 1e-4, rel=0.01)
    ours, other = 1167.0, 352.4
    assert late == pytest.approx(10.0 / (1 / ours + 1 / other) / (3.14159 * 100.0) ** 0.5, rel=0.01)


def test_the_module_is_slow():
    step = tem_step(seconds=3.0)
    assert abs(step[:1000]).max() < 1e-6
    assert step[1010] < 0.01 * step[-1]
    assert 0.02 < step[1100] / step[-1] < 0.2


def test_a_folder_that_cannot_be_made_is_an_error(tmp_path, capsys):
    (tmp_path / "file").write_text("", encoding="utf-8")
    assert reproduce.main(["--out", str(tmp_path / "file" / "below")]) == 2
    assert capsys.readouterr().err.startswith("error:")
