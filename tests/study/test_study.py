"""Studies through the entrance that a user has: a file, a command, a folder of data."""

from __future__ import annotations

import json
import re
import shutil
from collections import Counter
from pathlib import Path

import campaign
import pytest
from run_scene import write_study
from shipped import SCENES, STUDIES

from itouch.plugin.discovery import Catalog
from itouch_tools.cli import main
from itouch_tools.study import simulate as simulation
from itouch_tools.study.analysis import analyse
from itouch_tools.study.constant import stimuli
from itouch_tools.study.observers import Felt
from itouch_tools.study.progression import Course
from itouch_tools.study.reading import StudyFile, load_study, read_study
from itouch_tools.study.study_page import page
from itouch_tools.study.study_store import Row, Store
from itouch_tools.study.touches import Presented, TouchError, TouchRunner, deep_temperature
from itouch_tools.study.trials import trials_of

CATALOG = Catalog()
SCENE = """<itouch version="1.0">
  <materials>
    <material name="wood"><contact stiffness="1.2 N/mm" static-friction="0.4"/></material>
    <material name="steel"><contact stiffness="1.5 N/mm" static-friction="0.2"/></material>
    <material name="cork"><contact stiffness="0.6 N/mm" static-friction="0.6"/></material>
  </materials>
  <world><box name="block" size="60 60 20 mm" pos="0 0 10 mm" material="wood"/></world>
  <devices><device name="arm" plugin="usb-arm"/></devices>
  <interaction>
    <probe name="finger" radius="8 mm" pose-from="arm" force-to="arm"/>
    <operator probe="finger"><motion><to pos="0 0 24 mm" in="0.3 s" hold="0.2 s"/></motion></operator>
  </interaction>
</itouch>"""
FACTOR = '<factor name="material" levels="wood steel cork" set="block.material"/>'


def written(
    folder: Path, *, factor: str = FACTOR, task: str = 'kind="identify" factor="material"', more: str = ""
) -> Path:
    (folder / "scene.xml").write_text(SCENE)
    path = folder / "study.xml"
    path.write_text(
        f'<study version="1.0" scene="scene.xml" seed="5">\n  {factor}\n  <task {task}/>\n  {more}\n'
        f'  <contact object="block" duration="0.1 s"/>\n</study>'
    )
    return path


def loaded(folder: Path, **parts: str) -> StudyFile:
    found, problems = read_study(written(folder, **parts), CATALOG)
    assert found is not None
    assert not problems, problems
    return found


@pytest.mark.parametrize("path", STUDIES, ids=[path.stem for path in STUDIES])
def test_shipped_studies_are_right(path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["study", "check", str(path)]) == 0
    assert "ok" in capsys.readouterr().out


@pytest.mark.parametrize(
    "path", campaign.some(STUDIES, lambda path: "real" not in path.stem), ids=[path.stem for path in STUDIES]
)
def test_a_trial_of_a_shipped_study_on_the_twins_counts(path: Path) -> None:
    """Through the whole trial: calibrated first, the hand waits for the signal, the plate is ready by then."""
    file = load_study(path, CATALOG)
    row = next(simulation.Simulation(file, "S001", simulation.Panel(1), CATALOG).rows([]))
    assert not row.void
    assert row.answer is not None
    assert all(felt["plate_ready"] and not felt["plate_limited"] for felt in row.felt)


@pytest.mark.parametrize(
    ("parts", "sentence", "advice"),
    [
        ({"factor": FACTOR.replace("cork", "corc")}, "no material named 'corc'", "cork"),
        ({"factor": FACTOR.replace("block.material", "blok.material")}, "nothing named 'blok'", "block"),
        ({"factor": FACTOR.replace("block.material", "block")}, "not the path of an attribute", "NAME.attribute"),
        ({"factor": FACTOR.replace("block.material", "block.materal")}, "no attribute 'materal'", "material"),
        ({"factor": FACTOR.replace("levels", "level")}, "no attribute 'level'", "levels"),
        ({"factor": FACTOR.replace("wood steel", "wood wood")}, "different words", ""),
        ({"task": 'kind="identify" factor="stuff"'}, "no factor named 'stuff'", "material"),
        ({"task": 'kind="colder" factor="material"'}, "compares with a standard", ""),
        ({"task": 'kind="colder" factor="material" standard="wod"'}, "'wod' is not a level", "wood"),
        ({"task": 'kind="guess" factor="material"'}, "guess", "identify"),
        ({"more": '<exclude where="material=gold"/>'}, "no level 'gold'", "its levels are"),
        ({"more": '<order kind="blocked"/>'}, "blocked needs by=", ""),
        ({"more": '<order by="x" kind="blocked"/>'}, "no factor named 'x'", ""),
        ({"more": '<order repetitions="0"/>'}, "out of range", ""),
        ({"more": "<orders/>"}, "no element <orders>", "order"),
    ],
)
def test_mistakes_are_told_at_their_place(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], parts: dict[str, str], sentence: str, advice: str
) -> None:
    path = written(tmp_path, **parts)
    assert main(["study", "check", str(path)]) == 2
    said = capsys.readouterr().err
    assert sentence in said
    assert advice in said
    assert f"{path}:" in said
    assert "Traceback" not in said
    assert said.count("error[") == 1


def test_an_object_that_is_not_there(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = written(tmp_path)
    path.write_text(path.read_text().replace('object="block"', 'object="blok"'))
    assert main(["study", "check", str(path)]) == 2
    assert "no object named 'blok'" in capsys.readouterr().err
    path.write_text("<studie/>")
    assert main(["study", "check", str(path)]) == 2
    assert "not <study>" in capsys.readouterr().err
    path.write_text('<study version="1.0" scene="scene.xml" seed="1"/>')
    assert main(["study", "check", str(path)]) == 2
    assert "needs the element <task>" in capsys.readouterr().err
    assert main(["study", "check", str(tmp_path / "none.xml")]) == 2
    assert "cannot read" in capsys.readouterr().err


def test_orders_of_participants(tmp_path: Path) -> None:
    file = loaded(tmp_path, more='<order repetitions="4" most-equal="1"/><practice trials="2"/>')
    planned = trials_of(file, "P01")
    assert planned == trials_of(file, "P01") != trials_of(file, "P02")
    assert [trial.place for trial in planned] == list(range(14))
    main_trials = [trial.condition["material"] for trial in planned if trial.block != "practice"]
    assert Counter(main_trials) == {"wood": 4, "steel": 4, "cork": 4}
    assert all(a != b for a, b in zip(main_trials, main_trials[1:], strict=False))


def test_crossing_excluding_and_blocks(tmp_path: Path) -> None:
    factor = FACTOR + '<factor name="size" levels="small;large" values="40 40 20 mm;60 60 20 mm" set="block.size"/>'
    more = '<exclude where="material=cork size=large"/><order kind="blocked" by="size" repetitions="2"/>'
    file = loaded(tmp_path, factor=factor, more=more)
    assert len(file.conditions()) == 5
    planned = trials_of(file, "P01")
    blocks = list(dict.fromkeys(trial.block for trial in planned))
    assert sorted(blocks) == ["large", "small"]
    assert [trial.block for trial in planned] == [blocks[0]] * Counter(t.block for t in planned)[blocks[0]] + [blocks[1]] * Counter(t.block for t in planned)[blocks[1]]  # fmt: skip
    scene, _ = file.scene({"material": "steel", "size": "small"}, CATALOG)
    assert (scene.world.objects[0].material, scene.world.objects[0].size) == ("steel", (0.04, 0.04, 0.02))


@pytest.mark.parametrize(("kind", "count"), [("colder", 2), ("odd", 3), ("same", 2)])
def test_intervals_hold_the_standard_and_the_level(tmp_path: Path, kind: str, count: int) -> None:
    file = loaded(tmp_path, task=f'kind="{kind}" factor="material" standard="wood"', more='<order repetitions="20"/>')
    planned = trials_of(file, "P01")
    for trial in planned:
        assert len(trial.shown) == count
        assert trial.shown[trial.target] == trial.condition
        assert all(one["material"] == "wood" for i, one in enumerate(trial.shown) if i != trial.target)
    places = Counter(trial.target for trial in planned)
    assert set(places) == set(range(count))


class Hands:
    """Touches without a scene: flux and skin by the level alone."""

    FLUX = {"wood": 1500.0, "steel": 4000.0, "cork": 300.0}

    def __init__(self, file: StudyFile, catalog: Catalog, *, skin_temperature: float | None = None) -> None:
        self.broken = 0

    def touch(self, condition: dict[str, str], seed: int) -> Presented:
        import numpy as np

        flux = np.full(
            100, self.FLUX[condition["material"]] if "material" in condition else 1000.0 * 2 ** float(condition["gain"])
        )
        skin = 306.0 - flux / 2000.0 * np.linspace(0, 1, 100)
        void = "released early" if seed % 13 == 0 else ""
        return Presented(Felt(flux, skin, skin, 0.01), {"peak_force_N": 1.0}, void)


@pytest.fixture
def hands(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(simulation, "TouchRunner", Hands)


def simulated(file: StudyFile, folder: Path, codes: int = 3, *, stop_after: int = 10**9) -> list[Row]:
    panel = simulation.Panel(codes)
    with Store.open(folder, create=True) as store:
        for code in panel.codes():
            for count, row in enumerate(simulation.Simulation(file, code, panel, CATALOG).rows(store.rows(code))):
                store.add(row)
                if count + 1 >= stop_after:
                    break
        return store.rows()


def test_the_simulate_command_counts_void_trials(
    tmp_path: Path, hands: None, capsys: pytest.CaptureFixture[str]
) -> None:
    path = written(tmp_path, more='<order repetitions="6"/>')
    assert main(["study", "simulate", str(path), "-o", str(tmp_path / "data"), "--observers", "2"]) == 0
    said = capsys.readouterr().out
    with Store.open(tmp_path / "data") as store:
        void = [row.participant for row in store.rows() if row.void]
    assert void
    for code in set(void):
        count = void.count(code)
        assert f"{code}: {18 + count} new trials, {count} void: released early ({count})" in said


@pytest.mark.parametrize("none", ["--observers", "--processes"])
def test_a_panel_of_nobody_or_on_no_processor_is_refused(
    tmp_path: Path, none: str, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["study", "simulate", str(written(tmp_path)), "-o", str(tmp_path / "data"), none, "0"]
    assert main(words) == 2
    assert capsys.readouterr().err == "--observers and --processes must be 1 or more\n"
    assert not (tmp_path / "data").exists()


def test_a_study_that_was_stopped_goes_on_to_the_same_rows(tmp_path: Path, hands: None) -> None:
    file = loaded(tmp_path, more='<order repetitions="6"/><practice trials="3"/>')
    (tmp_path / "a").mkdir(), (tmp_path / "b").mkdir()
    whole = simulated(file, tmp_path / "a")
    for _ in range(40):
        rows = simulated(file, tmp_path / "b", stop_after=2)
    assert rows == whole
    first = [row for row in whole if row.participant == "S001"]
    assert [row.place for row in first] == list(range(len(first)))
    valid = [row for row in first if not row.void and row.block != "practice"]
    assert Counter(row.condition["material"] for row in valid) == {"wood": 6, "steel": 6, "cork": 6}
    assert any(row.void for row in whole)
    for row in whole:  # a void trial is repeated later, with the same condition
        if row.repeats is not None:
            again = next(other for other in whole if (other.participant, other.place) == (row.participant, row.repeats))
            assert (again.condition, again.shown) == (row.condition, row.shown)
            assert again.void


def test_the_report_of_simulated_people(tmp_path: Path, hands: None) -> None:
    file = loaded(tmp_path, more='<order repetitions="6"/>')
    result = analyse(file, simulated(file, tmp_path), draws=60)
    assert result["participants"] == 3
    assert result["correct"]["proportion"] > 0.8
    matrix = result["identification"][0]
    assert [sum(row) for row in matrix["counts"]] == [18, 18, 18]
    assert result["felt"][1]["mean_flux_W_m2"]["mean"] == pytest.approx(4000.0)
    text = page(result, {"seed": "5"})
    assert "What was answered to what" in text
    assert "http" not in text
    json.dumps(result, allow_nan=False)


@pytest.mark.parametrize("keep", [0, 1, 2, 18])
def test_small_panels_have_a_page(tmp_path: Path, hands: None, keep: int) -> None:
    for kind in (
        'kind="identify" factor="material"',
        'kind="odd" factor="material" standard="wood"',
        'kind="rate" factor="material"',
    ):
        file = loaded(tmp_path, task=kind, more='<order repetitions="6"/>')
        folder = tmp_path / kind.split('"')[1]
        folder.mkdir()
        result = analyse(file, simulated(file, folder, codes=1)[:keep], draws=20)
        assert page(result, {})
        json.dumps(result, allow_nan=False)


@pytest.mark.parametrize("task", ['kind="identify"', 'kind="odd" standard="wood"', 'kind="colder" standard="wood"'])
def test_a_report_without_resampling_lacks_intervals_alone(tmp_path: Path, hands: None, task: str) -> None:
    """The ends of an interval that is not there were taken for proportions, and refused."""
    file = loaded(tmp_path, task=f'{task} factor="material"', more='<order repetitions="6"/>')
    result = analyse(file, simulated(file, tmp_path), draws=0)
    assert result["correct"]["panel_mean"] > 0.3
    assert page(result, {})
    json.dumps(result, allow_nan=False)


def test_a_staircase_finds_what_is_told_apart(tmp_path: Path, hands: None) -> None:
    factor = (
        '<staircase name="gain" procedure="quest" set="block.friction" low="-2" high="2" start="1" standard="0" '
        'step="0.05" trials="40" prior="1"/>'
    )
    (tmp_path / "scene.xml").write_text(SCENE)
    path = written(tmp_path, factor=factor, task='kind="colder" factor="gain" standard="0"')
    file, problems = read_study(path, CATALOG)
    assert any("friction" in problem.sentence for problem in problems)  # a path that the scene has not is told
    assert file is not None
    rows = simulated(file, tmp_path, codes=4)
    found = analyse(file, rows, draws=20)["staircases"][0]
    assert len(found["thresholds"]) == 4
    # 43 % more flux is told in 3 of 4: log2(1.43) = 0.52, give or take people
    assert found["mean"] == pytest.approx(0.52, abs=0.4)


def test_the_temperature_below_the_skin_follows_it() -> None:
    import numpy as np

    skin = np.full(4000, 300.0)
    skin[0] = 306.0
    deep = deep_temperature(skin, 0.01)
    assert deep[0] > 305.0
    assert np.all(np.diff(deep) < 0)
    t = 2.0
    from math import erfc, sqrt

    assert deep[200] == pytest.approx(306.0 - 6.0 * erfc(0.2e-3 / (2 * sqrt(1.005e-7 * t))), abs=0.02)


def test_an_unknown_argument_is_told_with_the_usage_of_the_command(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["study", "run", "study.xml", "DATA", "--participant", "P01"])
    told = capsys.readouterr().err
    assert ended.value.code == 2 and told.startswith("usage: itouch-py study run ")
    assert told.endswith("itouch-py study run: error: unrecognized arguments: DATA\n")


def test_another_study_is_refused_in_the_same_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = written(tmp_path)
    assert main(["study", "freeze", str(path), str(tmp_path / "data")]) == 0
    assert main(["study", "freeze", str(path), str(tmp_path / "data")]) == 0
    (tmp_path / "scene.xml").write_text(SCENE.replace("0.4", "0.5"))
    assert main(["study", "freeze", str(path), str(tmp_path / "data")]) == 2
    assert "this one differs" in capsys.readouterr().err
    assert main(["study", "report", str(path), str(tmp_path / "nowhere")]) == 2
    assert "holds no study" in capsys.readouterr().err


@pytest.mark.long
def test_the_panel_of_the_paper_on_the_twins(tmp_path: Path) -> None:
    study = SCENES / "studies" / "four_materials.xml"
    text = (
        study.read_text()
        .replace('repetitions="10"', 'repetitions="2"')
        .replace("../study_sample", str(SCENES / "study_sample"))
    )
    path = tmp_path / "study.xml"
    path.write_text(text)
    for folder, processes in (("a", "1"), ("b", "2")):
        assert (
            main(
                [
                    "study",
                    "simulate",
                    str(path),
                    "-o",
                    str(tmp_path / folder),
                    "--observers",
                    "2",
                    "--processes",
                    processes,
                ]
            )
            == 0
        )
        assert main(["study", "report", str(path), str(tmp_path / folder)]) == 0
    with Store.open(tmp_path / "a") as one, Store.open(tmp_path / "b") as two:
        assert one.rows() == two.rows()
        assert not [row.void for row in one.rows() if row.void]
    result = json.loads((tmp_path / "a" / "report.json").read_text())
    felt = {one["condition"]["material"]: one["mean_flux_W_m2"]["mean"] for one in result["felt"]}
    assert felt["aluminium"] > felt["pyrex"] > felt["wood"] > felt["polystyrene"]


def test_a_hand_that_ends_elsewhere_than_it_begins_is_found(tmp_path: Path) -> None:
    """From one trial to the next such an arm would jump: its sensors would not be believed."""
    study = write_study(tmp_path)
    scene = tmp_path / "scene.xml"
    last = '<to pos="0 0 32 mm" in="0.1 s" hold="0.1 s"/>'
    scene.write_text(scene.read_text().replace(last, last.replace("0 0 32", "9 0 32")))
    _, problems = read_study(study, CATALOG)
    assert [(one.code, one.place.line) for one in problems if one.place] == [("bad-value", 15)]
    assert "does not end where it begins" in problems[0].sentence


def test_check_tells_of_a_study_in_which_no_trial_can_count(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The scripted hand is back before the touch has lasted as long as it must; one level tells nothing apart."""
    study = write_study(tmp_path)
    assert main(["study", "check", str(study)]) == 0
    assert "warning" not in capsys.readouterr().err
    study.write_text(study.read_text().replace('duration="0.1 s"', 'duration="30 s"'))
    text = study.read_text()
    levels = text[text.index('levels="') : text.index('"', text.index('levels="') + 8) + 1]
    study.write_text(text.replace(levels, 'levels="wood"'))
    assert main(["study", "check", str(study)]) == 0
    said = capsys.readouterr().err
    assert "no trial will count: a touch lasts 30 s at least, and the scripted hand of 'finger' is back after " in said
    assert f"{study}:{1 + text[: text.index('duration=')].count(chr(10))}:" in said
    assert "'material' has one level, 'wood': every answer to 'identify' is known" in said


STAIRS = (
    '<staircase name="a" procedure="up-down" set="wood/contact.stiffness" unit="N/mm" low="0.5" high="2" start="1.5" '
    'standard="0.6" step="0.1" trials="30" reversals="3"/>'
    '<staircase name="b" procedure="quest" set="wood/contact.stiffness" unit="N/mm" low="0.5" high="2" start="1.2" '
    'standard="0.6" trials="12"/>'
)


@pytest.mark.parametrize("every", [2, 3, 5])
def test_staircases_with_void_trials_go_on_to_their_end_whenever_they_are_resumed(tmp_path: Path, every: int) -> None:
    """One ends before the other, and each void trial is repeated as one of its own; a new start changes nothing."""
    file = loaded(tmp_path, factor=STAIRS, task='kind="colder" factor="a" standard="0.6"')
    rows: list[Row] = []
    course = Course(file, "P1")
    while (due := course.next()) is not None:
        assert due == Course(file, "P1", rows).next()
        if due.repeats is not None:
            assert rows[due.repeats].staircase == due.trial.staircase
        void = "broken" if len(rows) % every == 0 else ""
        right = None if void else int(len(rows) % 4 != 3)
        row = Row("P1", due.place, "main", "colder", {}, list(due.shown), 0.0, 1.0, "s", "", repeats=due.repeats,
                  staircase=due.trial.staircase, level=due.level, right=right, void=void)  # fmt: skip
        rows.append(row)
        course.made(row)
        assert len(rows) < 400
    assert course.left == 0
    for rule in file.study.staircases:
        counted = [row for row in rows if row.staircase == rule.name and not row.void]
        assert 0 < len(counted) <= rule.trials
    felt = analyse(file, rows, draws=20)["felt"]
    assert {name for one in felt for name in one["condition"]} == {"a", "b"}


@pytest.mark.parametrize(
    ("parts", "said"),
    [
        ({"factor": STAIRS.replace('standard="0.6"', 'standard="1.9"', 1)}, "the standard is 1.9"),
        ({"factor": STAIRS.replace('trials="12"', 'trials="12" target="0.8"')}, "target is of the up-down procedure"),
        ({"factor": STAIRS.replace('high="2" start="1.2"', 'high="200" start="60"')}, "prior of 'b', 1, is narrow"),
        ({"factor": STAIRS + FACTOR}, "a factor beside them has no effect"),
    ],
)
def test_staircases_that_would_do_nothing_or_go_the_wrong_way(tmp_path: Path, parts: dict[str, str], said: str) -> None:
    _, problems = read_study(written(tmp_path, task='kind="colder" factor="a" standard="0.6"', **parts), CATALOG)
    assert any(said in problem.sentence for problem in problems), problems


def test_a_block_is_not_called_as_what_does_not_count(tmp_path: Path) -> None:
    factor = FACTOR + '<factor name="phase" levels="practice test" values="1;1" set="block.pos"/>'
    _, problems = read_study(written(tmp_path, factor=factor, more='<order kind="blocked" by="phase"/>'), CATALOG)
    assert any("block can't be called 'practice'" in problem.sentence for problem in problems)


def test_the_report_is_of_the_study_of_the_trials(
    tmp_path: Path, hands: None, capsys: pytest.CaptureFixture[str]
) -> None:
    path = written(tmp_path)
    assert main(["study", "simulate", str(path), "-o", str(tmp_path / "data"), "--observers", "1"]) == 0
    path.write_text(
        path.read_text().replace('levels="wood steel cork"', 'levels="wood steel bark" values="wood;steel;cork"')
    )
    assert main(["study", "report", str(path), str(tmp_path / "data")]) == 2
    said = capsys.readouterr().err
    assert "material=cork" in said
    assert "Traceback" not in said


def test_catch_trials_stand_among_the_others_and_do_not_count(
    tmp_path: Path, hands: None, capsys: pytest.CaptureFixture[str]
) -> None:
    more = '<order repetitions="6"/><catch trials="5" where="material=cork"/>'
    file = loaded(tmp_path, more=more)
    for code in ("P1", "P2", "P3"):
        planned = trials_of(file, code)
        caught = [index for index, trial in enumerate(planned) if trial.block == "catch"]
        assert len(caught) == 5
        assert caught[0] > 0
        assert [trial.place for trial in planned] == list(range(23))
        assert all(planned[index].condition == {"material": "cork"} for index in caught)
        counted = Counter(trial.condition["material"] for trial in planned if trial.block != "catch")
        assert counted == {"wood": 6, "steel": 6, "cork": 6}
    assert len({tuple(t.block for t in trials_of(file, code)) for code in ("P1", "P2", "P3")}) > 1
    result = analyse(file, simulated(file, tmp_path), draws=20)
    assert result["catch"]["trials"] == 15
    assert result["catch"]["right"] > 10  # cork draws ten times less than the others
    assert result["trials"] == 54
    assert f"{result['catch']['right']} of 15 catch trials right" in page(result, {})
    assert main(["study", "check", str(written(tmp_path, more=more))]) == 0
    assert "18 trials of identify (0 of practice before them, 5 catch trials among them)" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("where", "said"),
    [("material=oak", "no level 'oak'"), ("size=large", "'material' is open"), ("material", "FACTOR=LEVEL")],
)
def test_catch_trials_show_what_the_study_varies(tmp_path: Path, where: str, said: str) -> None:
    _, problems = read_study(written(tmp_path, more=f'<catch trials="2" where="{where}"/>'), CATALOG)
    assert any(said in problem.sentence for problem in problems), problems


SERIES = '<factor name="gain" levels="0.6 0.8 1.0 1.2 1.4" values="0.6;0.8;1;1.2;1.4" set="block.pos"/>'


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_constant_stimuli_find_the_equal_level_and_the_threshold(tmp_path: Path, sign: float) -> None:
    """Rows of four people whose answers are drawn from a known function, rising and falling with the level."""
    import numpy as np
    from scipy.special import ndtr

    file, _ = read_study(written(tmp_path, factor=SERIES, task='kind="colder" factor="gain" standard="1.0"'), CATALOG)
    assert file is not None
    rng, rows = np.random.default_rng(3), []
    for person in range(4):
        for place in range(5 * 120):
            level = ("0.6", "0.8", "1.0", "1.2", "1.4")[place % 5]
            where = int(rng.integers(2))
            chosen = rng.random() < ndtr(sign * (float(level) - 1.05) / 0.2)
            shown = [{"gain": level if index == where else "1.0"} for index in range(2)]
            answer = str(where if chosen else 1 - where)
            rows.append(Row(f"P{person}", place, "main", "colder", {"gain": level}, shown, 0.0, 1.0, "s", "",
                            answer=answer, right=int(chosen)))  # fmt: skip
    found = analyse(file, rows, draws=100)["constant"]
    assert [one["level"] for one in found["series"]] == [0.6, 0.8, 1.2, 1.4]  # equal to the standard tells nothing
    assert found["equal"]["pooled"] == pytest.approx(1.05, abs=0.03)
    assert found["equal"]["mean"] == pytest.approx(1.05, abs=0.04)
    assert found["threshold"]["pooled"] == pytest.approx(0.2 * 0.6745, rel=0.2)
    low, high = found["equal"]["panel_95"]
    assert low < found["equal"]["mean"] < high
    assert "Judged colder than 1.0" in page(analyse(file, rows, draws=20), {})
    few = analyse(file, rows[:3], draws=20)
    assert few["constant"]["equal"]["pooled"] is None
    assert page(few, {})


@pytest.mark.parametrize(
    ("values", "numbers"),
    [
        ("0.3 N/mm;400 N/m;0.5 N/mm", [300.0, 400.0, 500.0]),  # units differ: SI
        ("0.3 N/mm;0.4 N/mm;0.5 N/mm", [0.3, 0.4, 0.5]),
        ("300;0.4 N/mm;500", [300.0, 400.0, 500.0]),  # without a unit: SI
        ("288.15 K;17 degC;293.15 K", [288.15, 290.15, 293.15]),
        ("0 0 6 mm;0 0 8 mm;0 0 1 cm", [0.006, 0.008, 0.01]),
        ("0 0 6 mm;0 0 8 mm;0 0 9 mm", [6.0, 8.0, 9.0]),
        ("0 0 6 mm;0 0 8 mm;1 0 9 mm", []),
        ("0.3 N;0.4 mm;0.5 s", []),
        ("oak;0.4;0.5", []),
    ],
)
def test_a_series_has_one_unit(tmp_path: Path, values: str, numbers: list[float]) -> None:
    factor = f'<factor name="gain" levels="a b c" values="{values}" set="wood/contact.stiffness"/>'
    file, _ = read_study(written(tmp_path, factor=factor, task='kind="colder" factor="gain" standard="b"'), CATALOG)
    assert file is not None
    assert list(stimuli(file).values()) == pytest.approx(numbers)


def test_a_single_level_may_have_a_value_with_a_unit(tmp_path: Path) -> None:
    """Without a ; the blank before the unit made two values of it."""
    factor = FACTOR + '<factor name="k" levels="soft" values="0.9 N/mm" set="wood/contact.stiffness"/>'
    file = loaded(tmp_path, factor=factor)
    assert [edit.value.value for edit in file.edits(file.conditions()[0])] == ["wood", "0.9 N/mm"]


def test_levels_with_blanks_can_be_excluded_and_caught(tmp_path: Path) -> None:
    factor = '<factor name="m" levels="old oak;steel;a=b" values="wood;steel;cork" set="block.material"/>'
    factor += '<factor name="f" levels="low high" values="0.1;0.2" set="wood/contact.static-friction"/>'
    task, more = 'kind="identify" factor="m"', '<catch trials="1" where="m=old oak  f=low"/>'
    file = loaded(
        tmp_path, factor=factor + '<exclude where="m=old oak f=high"/><exclude where="m=a=b"/>', task=task, more=more
    )
    assert [tuple(one.values()) for one in file.conditions()] == [
        ("old oak", "low"), ("steel", "low"), ("steel", "high"),
    ]  # fmt: skip
    caught = [trial.condition for trial in trials_of(file, "P01") if trial.block == "catch"]
    assert caught == [{"m": "old oak", "f": "low"}]


@pytest.mark.parametrize("where", ["m", "m=", "=wood", "wood m=wood", "m=wood m=steel"])
def test_malformed_pairs_of_an_exclusion_are_told(tmp_path: Path, where: str) -> None:
    factor = f'<factor name="m" levels="wood steel cork" set="block.material"/><exclude where="{where}"/>'
    _, problems = read_study(written(tmp_path, factor=factor, task='kind="identify" factor="m"'), CATALOG)
    assert any("where" in problem.sentence for problem in problems)


def test_words_are_no_series_of_stimuli(tmp_path: Path) -> None:
    file = loaded(tmp_path, task='kind="colder" factor="material" standard="wood"')
    assert "constant" not in analyse(file, [], draws=20)


def test_observers_of_another_model_need_another_folder(
    tmp_path: Path, hands: None, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["study", "simulate", str(written(tmp_path)), "-o", str(tmp_path / "data"), "--observers", "1"]
    assert main(words) == 0
    assert main([*words, "--model", "combined"]) == 2
    said = capsys.readouterr().err
    assert "holds trials of simulated-flux, these would be of simulated-combined" in said
    assert main([*words, "--same-skin"]) == 2
    assert "these would be of simulated-flux-same-skin" in capsys.readouterr().err
    assert main(words) == 0


def test_people_and_simulated_observers_are_kept_apart(
    tmp_path: Path, hands: None, capsys: pytest.CaptureFixture[str]
) -> None:
    """Observers were added to people's data; and a person with an observer's code was done before the first trial."""
    path, simulated_data, data = str(written(tmp_path)), str(tmp_path / "simulated"), tmp_path / "data"
    answers = tmp_path / "answers.txt"
    answers.write_text("wood\n")
    data.mkdir()
    assert main(["study", "simulate", path, "-o", simulated_data, "--observers", "1"]) == 0
    for code in ("S001", "P01"):
        assert main(["study", "run", path, "-o", simulated_data, "--participant", code, "--answers", str(answers)]) == 2
        assert "simulated holds trials of S001, a simulated observer (simulated-flux)" in capsys.readouterr().err
    with Store.open(data, create=True) as store:
        for code in ("P01", "simulated"):
            trial = Row(code, 0, "main", "identify", {"material": "wood"}, [{"material": "wood"}], 0.0, 1.0,
                        f"{code}-1", "now")  # fmt: skip
            store.add(trial)
        store.refuse_simulated()
    assert main(["study", "simulate", path, "-o", str(data), "--observers", "1"]) == 2
    assert "data holds trials of P01-1, these would be of simulated-flux: another folder" in capsys.readouterr().err


def test_the_time_that_is_told_is_what_the_study_asks_for(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = written(tmp_path)
    assert main(["study", "check", str(path)]) == 0
    usual = capsys.readouterr().out
    path.write_text(path.read_text().replace('duration="0.1 s"', 'duration="0.1 s" pause="0 s" skin-wait="0 s"'))
    assert main(["study", "check", str(path)]) == 0
    assert "with 34 s between two touches" in usual
    assert "with 4 s between two touches" in capsys.readouterr().out


@pytest.mark.parametrize("kind", ["colder", "odd"])
def test_the_standard_beside_itself_has_no_right_answer(tmp_path: Path, hands: None, kind: str) -> None:
    file = loaded(tmp_path, task=f'kind="{kind}" factor="material" standard="wood"', more='<order repetitions="6"/>')
    rows = simulated(file, tmp_path, codes=2)
    for row in rows:
        if not row.void:
            assert (row.right is None) == (row.condition["material"] == "wood")
    result = analyse(file, rows, draws=20)
    assert result["correct"]["trials"] == 24
    shares = {one["condition"]["material"]: one["proportion"] for one in result["conditions"]}
    assert shares["wood"] is None
    assert shares["cork"] is not None
    assert page(result, {})


def sampled(folder: Path, arm: str = '<device name="arm" plugin="usb-arm"/>') -> TouchRunner:
    """Make touches of the shipped panel, whose scene has no hand of its own."""
    shutil.copytree(SCENES, folder / "scenes", dirs_exist_ok=True)
    scene, rig = folder / "scenes" / "study_sample.xml", folder / "scenes" / "rigs" / "twin.xml"
    scene.write_text(re.sub("<operator.*</operator>", "", scene.read_text(), flags=re.S))
    rig.write_text(re.sub('<device name="arm".*?</device>', arm, rig.read_text(), count=1, flags=re.S))
    return TouchRunner(load_study(folder / "scenes" / "studies" / "four_materials.xml", CATALOG), CATALOG)


def test_a_touch_ends_though_a_recorded_hand_is_over_before_the_rig_has_found_its_heights(tmp_path: Path) -> None:
    (tmp_path / "scene.xml").write_text(SCENE)
    (tmp_path / "scenes").mkdir()
    assert (
        main(["run", str(tmp_path / "scene.xml"), "--headless", "--record", str(tmp_path / "scenes" / "hand.mcap")])
        == 0
    )
    track = '<recorded:hardware file="../hand.mcap" track="arm"/>'  # far beside the table
    arm = f'<device name="arm" plugin="recorded" xmlns:recorded="urn:itouch:plugin:recorded">{track}</device>'
    made = sampled(tmp_path, arm).touch({"material": "wood"}, seed=1)
    assert made.void == "the motion was over before the rig had found its heights"


def test_observers_need_a_hand_that_moves(tmp_path: Path) -> None:
    with pytest.raises(TouchError, match="nothing moves a finger in this scene"):
        sampled(tmp_path).touch({"material": "wood"}, seed=1)
