"""Observers that a stranger's distribution brings: found by their entry points, used by name, refused in a sentence."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from shipped import SCENES
from third_party_plugins import install

from itouch_tools.cli import main
from itouch_tools.study import simulate as simulation
from itouch_tools.study.observer_catalog import ObserverError, names, observer_of
from itouch_tools.study.observers import Felt, Observer, Person

MODULE = '''
class Peak:
    """Judges by the greatest flux, and knows nothing of the framework."""
    def __init__(self):
        self.base = 500.0
    def peak(self, felt):
        return float(abs(felt.flux).max())
    def cue(self, felt):
        return self.peak(felt) / self.base

class Stubborn(Peak):
    def colder(self, intervals, rng):
        return 1

class Faints(Peak):
    def colder(self, intervals, rng):
        raise RuntimeError("boom")

class Beyond(Peak):
    def colder(self, intervals, rng):
        return 7

class Shy(Peak):
    def __init__(self):
        raise OSError("no table")

class Wild:
    def cue(self, felt):
        return [float("nan")]

class Cross:
    def cue(self, felt):
        raise KeyError("nothing")

class Dies(Peak):
    def __init__(self):
        import os, signal
        os.kill(os.getpid(), signal.SIGKILL)

class Mute:
    pass

nobody = 3
'''
POINTS = {"peak": "Peak", "stubborn": "Stubborn", "faints": "Faints", "beyond": "Beyond", "shy": "Shy", "wild": "Wild", "cross": "Cross", "mute": "Mute", "dies": "Dies", "nobody": "nobody",
          "gone": "Gone", "flux": "Mute"}  # fmt: skip
FELT = Felt(np.linspace(3000.0, 1000.0, 100), np.full(100, 303.0), np.full(100, 304.0), 0.01)


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Lay a distribution out as pip does."""
    lines = "".join(f"{name} = strange_observers:{cls}\n" for name, cls in POINTS.items())
    site = install(tmp_path / "site", "strange-observers", f"[itouch.observers]\n{lines}", code=MODULE, version="1.2")
    monkeypatch.syspath_prepend(str(site))
    monkeypatch.delitem(sys.modules, "strange_observers", raising=False)


def test_the_page_s_own_example_is_one(installed: None, tmp_path: Path) -> None:
    page = (SCENES.parent / "docs" / "explanation" / "observers.md").read_text(encoding="utf-8")
    code = page.split("```python\n")[1].split("```")[0]
    with (tmp_path / "site" / "strange_observers.py").open("a") as stream:
        stream.write(code + "\nPeak = Slope\n")
    rng = np.random.default_rng(0)
    observer = observer_of("peak")(Person(noise=1e-6, lapse=0.0))
    still = Felt(np.full(100, 500.0), FELT.skin, FELT.deep, 0.01)
    assert observer.colder([FELT, still], rng) == 0


def test_installed_observers_are_found_by_name_and_judge(installed: None) -> None:
    assert names()[:4] == ["flux", "combined", "receptors", "naive"] and "peak" in names()
    observer = observer_of("peak")(Person(noise=1e-6, lapse=0.0))
    assert isinstance(observer, Observer)
    assert observer.cue(FELT).tolist() == [6.0]
    weak = Felt(FELT.flux / 3, FELT.skin, FELT.deep, 0.01)
    rng = np.random.default_rng(0)
    assert observer.colder([weak, FELT], rng) == 1 and observer.colder([FELT, weak], rng) == 0
    assert observer.identify(weak, {"a": FELT, "b": weak}, rng) == "b"
    assert observer_of("stubborn")(Person(lapse=0.0)).colder([FELT, weak], rng) == 1
    assert observer_of("flux").__name__ == "FluxObserver"  # what ships can't be replaced


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("mute", "observer 'mute' (strange-observers 1.2) is not a class with a method cue"),
        ("nobody", "is not a class"),
        ("gone", "failed to load: AttributeError"),
        ("ghost", "there is no observer 'ghost'; there are flux, combined"),
    ],
)
def test_a_class_that_is_no_observer_is_refused_before_anything_is_touched(
    installed: None, name: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    study = str(next((SCENES / "studies").glob("*.xml")))
    for words in (["simulate", study, "-o", str(tmp_path / "rows")], ["power", study, "--panel", "2"]):
        assert main(["study", *words, "--model", name]) == 2
        told = capsys.readouterr().err
        assert said in told and "Traceback" not in told
    assert not (tmp_path / "rows").exists()


@pytest.mark.parametrize(("name", "said"), [("wild", "finite numbers"), ("cross", "cue raised KeyError")])
def test_an_observer_that_fails_is_named(installed: None, name: str, said: str) -> None:
    with pytest.raises(ObserverError, match=said):
        observer_of(name)(Person(lapse=0.0)).colder([FELT, FELT], np.random.default_rng(0))


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("faints", "observer 'faints' (strange-observers 1.2): colder raised RuntimeError: boom"),
        ("beyond", "colder gave 7; it must be the number of an interval, from 0"),
        ("shy", "making it raised OSError: no table"),
    ],
)
def test_decisions_that_err_are_sentences(
    installed: None, name: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    from test_study import Hands as Touches
    from test_study import written

    monkeypatch.setattr(simulation, "TouchRunner", Touches)
    study = written(tmp_path, task='kind="colder" factor="material" standard="wood"')
    words = ["study", "simulate", str(study), "-o", str(tmp_path / "rows"), "--observers", "1", "--processes", "1"]
    assert main([*words, "--model", name]) == 2
    told = capsys.readouterr().err
    assert said in told and "Traceback" not in told


def test_a_whole_study_is_answered_by_one(installed: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from test_study import Hands as Touches
    from test_study import written

    monkeypatch.setattr(simulation, "TouchRunner", Touches)
    study = written(tmp_path, more='<order repetitions="2"/>')
    words = ["study", "simulate", str(study), "-o", str(tmp_path / "rows"), "--observers", "2", "--processes", "1"]
    assert main([*words, "--model", "peak"]) == 0
    assert main(["study", "report", str(study), str(tmp_path / "rows")]) == 0


@pytest.mark.long
def test_a_process_that_dies_is_told_and_not_waited_for(installed: None, tmp_path: Path) -> None:
    from test_study import written

    words = ["study", "simulate", str(written(tmp_path)), "-o", str(tmp_path / "rows"), "--observers", "3"]
    done = subprocess.run(
        [sys.executable, "-m", "itouch_tools.cli", *words, "--processes", "2", "--model", "dies"], capture_output=True,
        text=True, timeout=600, check=False, env={**os.environ, "PYTHONPATH": str(tmp_path / "site")},
    )  # fmt: skip
    assert done.returncode == 1
    assert "one of the processes that simulate was killed" in done.stderr and "Traceback" not in done.stderr
