"""Tasks and answer devices that a stranger's distribution brings: found, used by name, refused in a sentence."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from run_scene import write_study
from shipped import SCENES
from third_party_plugins import install

from itouch.plugin.discovery import Catalog
from itouch_tools.cli import main
from itouch_tools.study import plugin_tasks
from itouch_tools.study.plugin_tasks import TaskError, device_of, task_names, task_of
from itouch_tools.study.reading import read_study
from itouch_tools.study.study_store import Store

PAGE = (SCENES.parent / "docs" / "reference" / "studies.md").read_text(encoding="utf-8")
#: The page's own listing is the stranger's module.
LISTING = PAGE.split("## A task or an answer device of your own")[1].split("```python\n")[1].split("```")[0]
MORE = """
class Twisted(Rougher):
    intervals = 7

class Cross(Rougher):
    def choices(self, levels):
        raise KeyError("nothing")

class Odd(Rougher):
    def choices(self, levels):
        return ["a", "b"]

class Vague(Rougher):
    def right(self, answer, trial):
        return "perhaps"

class Broken(Pedal):
    def poll(self):
        raise OSError("unplugged")

class Loud:
    question = "How loud?"
    def right(self, answer, trial):
        return None
    def simulated(self, observer, felt, rng):
        return 2.0 * felt[0].mean_flux()

class Unmade(Rougher):
    def __init__(self):
        raise OSError("no such port")

nobody = 3
"""
POINTS = {"rougher": "Rougher", "pedal": "Pedal", "twisted": "Twisted", "cross": "Cross", "odd-words": "Odd",
          "vague": "Vague", "broken": "Broken", "unmade": "Unmade", "loud": "Loud", "nobody": "nobody", "gone": "Gone",
          "identify": "Twisted"}  # fmt: skip


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Lay a distribution out as pip does."""
    lines = "".join(f"{name} = my_tasks:{cls}\n" for name, cls in POINTS.items())
    points = f"[itouch.tasks]\n{lines}"
    site = install(tmp_path / "site", "strange-tasks", points, module="my_tasks", code=LISTING + MORE, version="1.2")
    monkeypatch.syspath_prepend(str(site))
    monkeypatch.delitem(sys.modules, "my_tasks", raising=False)
    plugin_tasks._task.cache_clear()
    yield
    plugin_tasks._task.cache_clear()


def asking(folder: Path, kind: str, standard: str = "steel") -> Path:
    """Write a small study with a task."""
    path = write_study(folder, repetitions=1)
    extra = f' standard="{standard}"' if standard else ""
    path.write_text(
        path.read_text().replace('kind="identify" factor="material"', f'kind="{kind}" factor="material"{extra}')
    )
    return path


def test_a_participant_s_whole_study_is_asked_by_one_and_answered_by_a_pedal(
    installed: None, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    study = asking(tmp_path / "study", "rougher")
    assert main(["study", "check", str(study)]) == 0
    told = capsys.readouterr().out
    assert "task 'rougher' (strange-tasks 1.2) asks: Which was rougher?" in told
    assert "6 touches" in told
    folder = tmp_path / "data"
    words = ["study", "run", str(study), "-o", str(folder), "--participant", "P1", "--pace", "fast"]
    assert main([*words, "--answers-from", "pedal"]) == 0
    with Store.open(folder) as store:
        rows = store.rows("P1")
    assert [row.task for row in rows] == ["rougher"] * 3
    assert [row.answer for row in rows] == ["second"] * 3
    shown = [[one["material"] for one in row.shown] for row in rows]
    assert all(len(pair) == 2 and "steel" in pair for pair in shown)
    # what is right is the plugin's to say: the interval that is not the standard
    assert [row.right for row in rows] == [
        None if pair == ["steel", "steel"] else int(pair[1] != "steel") for pair in shown
    ]
    assert main(["study", "report", str(study), str(folder)]) == 0
    assert "right" in capsys.readouterr().out


def test_observers_answer_it_as_the_plugin_says(
    installed: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from test_study import Hands as Touches
    from test_study import written

    from itouch_tools.study import simulate as simulation

    monkeypatch.setattr(simulation, "TouchRunner", Touches)
    path = written(tmp_path, more='<order repetitions="2"/>')
    level = path.read_text().split('levels="')[1].split()[0].strip('"')
    text = path.read_text()
    assert '<task kind="identify"' in text
    path.write_text(text.replace('<task kind="identify"', f'<task kind="rougher" standard="{level}"'))
    words = ["study", "simulate", str(path), "-o", str(tmp_path / "rows"), "--observers", "2"]
    assert main(words) == 0
    with Store.open(tmp_path / "rows") as store:
        assert {row.answer for row in store.rows() if not row.void} == {"first", "second"}
    assert main(["study", "report", str(path), str(tmp_path / "rows")]) == 0
    assert main(["study", "power", str(path), "--panel", "2"]) == 2


def test_numbers_that_a_task_asks_for_are_in_the_report(
    installed: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from test_study import Hands as Touches
    from test_study import written

    from itouch_tools.study import simulate as simulation

    monkeypatch.setattr(simulation, "TouchRunner", Touches)
    path = str(written(tmp_path, task='kind="loud" factor="material"', more='<order repetitions="2"/>'))
    folder = tmp_path / "rows"
    assert main(["study", "simulate", path, "-o", str(folder), "--observers", "2", "--processes", "1"]) == 0
    assert main(["study", "report", path, str(folder)]) == 0
    found = json.loads((folder / "report.json").read_text())["ratings"]
    assert {one["condition"]["material"]: one["mean"] for one in found} == pytest.approx(
        {name: 2.0 * flux for name, flux in Touches.FLUX.items()}
    )
    assert "Ratings" in (folder / "report.html").read_text()


@pytest.mark.parametrize(
    ("kind", "standard", "code", "said"),
    [
        ("rouger", "", "unknown-name", "there is no task 'rouger'"),
        ("rougher", "", "bad-value", "compares with a standard"),
        ("pedal", "", "bad-value", "is not a task: it has no method right"),
        ("twisted", "", "bad-value", "intervals = 7 must be 1 to 3"),
        ("cross", "steel", "bad-value", "choices raised KeyError"),
        ("odd-words", "steel", "bad-value", "must be a mapping"),
        ("unmade", "", "bad-value", "can't be made: OSError: no such port"),
        ("nobody", "", "bad-value", "is not a class"),
        ("gone", "", "bad-value", "failed to load: AttributeError"),
    ],
)
def test_a_class_that_is_no_task_is_refused_at_its_place(
    installed: None, tmp_path: Path, kind: str, standard: str, code: str, said: str
) -> None:
    _, problems = read_study(asking(tmp_path / "study", kind, standard), Catalog())
    assert [one.code for one in problems] == [code]
    assert said in problems[0].sentence
    assert problems[0].place is not None and (problems[0].place.line, problems[0].place.column) == (3, 9)
    if code == "unknown-name":
        assert "rougher" in problems[0].advice


def test_a_task_that_is_installed_nowhere_is_told(tmp_path: Path) -> None:
    """What ships can be asked without any plugin, and a plugin can't replace it."""
    _, problems = read_study(asking(tmp_path, "colour"), Catalog())
    assert [one.code for one in problems] == ["unknown-name"]


def test_a_task_or_device_that_fails_is_named(
    installed: None, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert "rougher" in task_names() and "pedal" not in task_names()
    with pytest.raises(TaskError, match="right gave 'perhaps'"):
        task_of("vague").right("first", {"levels": ["wood", "steel"], "standard": "steel"})
    with pytest.raises(TaskError, match="no method poll"):
        device_of("rougher")
    study = asking(tmp_path / "study", "identify", "")
    words = ["study", "run", str(study), "-o", str(tmp_path / "data"), "--participant", "P1", "--pace", "fast"]
    assert main([*words, "--answers-from", "broken"]) == 2
    assert "poll raised OSError: unplugged" in capsys.readouterr().err
    assert main([*words, "--answers-from", "organ"]) == 2
    assert "no plugin brings 'organ'" in capsys.readouterr().err
