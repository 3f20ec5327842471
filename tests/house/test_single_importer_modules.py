"""A small module that only one other imports stands in that one, or has a reason to be a file of its own."""

from __future__ import annotations

from pathlib import Path

import pytest
from sources import SMALL, imports, modules, small_with_one_importer

#: Folders of like files, of which each is looked for by its name -> what each of them is.
FAMILIES = {
    "itouch.monitors": "a monitor",
    "itouch_tools.cli.explain": "examples of one kind of message",
    "itouch_tools.export": "a format",
    "itouch_tools.study.statistics": "a method of statistics",
}
#: Module -> why it stands by itself.
REASONS = {
    "itouch.linking": "what Numba's own compiler is told is another idea than what is kept on disk, and lies a layer below",
    "itouch.safety.check_warm_up": "it goes through safety's entrances: a part of safety, although the loop calls it",
    "itouch.safety.departures": "where commands sent a surface is another idea than the gate, which is long",
    "itouch.safety.hold_to_run": "the dead-man's switch is looked for by its name",
    "itouch.servo.opener": "the guardian loads drivers only where a device has a second opener",
    "itouch.session.state_validation": "what a stored State may be is checked by rules of their own",
    "itouch_tools.cli.doctor.timer": "a program of its own, run in another process",
    "itouch_tools.cli.study_serve": "each sub-command of `study` that runs something has a file",
    "itouch_tools.cli.wake_ups": "a program of its own, run in another process",
    "itouch_tools.sound.wav": "a sound is played, or written to a file: one file for each",
    "itouch_tools.sweeps.pages": "the work of a command lies below the command line",
    "itouch_tools.viewer.chart_layout": "it needs no graphics, and is tested where there is no display",
    "itouch_tools.viewer.legend": "each part of the picture has a file",
    "itouch_tools.viewer.menu": "each part of the picture has a file",
    "itouch_evidence.surface.reach": "a bound with a derivation, by which what was measured is judged",
    "itouch_evidence.viewer_web": "each kind of viewer that is measured has a file",
    "itouch_thermal.flux.curve_start": "what a display can follow is physics; its importer knows the scene and the names of State",
    "itouch_thermal.flux.slew": "what a driver can follow is another idea than the law and the plan, which take it from here",
    "itouch_thermal.solver_stores": "it must be imported before anything of the solver",
    "itouch_thermal.identify.posterior": "integrating over several valleys is another idea than finding the most probable values",
    "itouch_thermal.plot": "loaded only where a plot is asked for",
    "itouch_thermal.rendering.plantfile": "reading a plant from a file is another idea than measuring how well it renders",
    "contact_heat.analytic": "closed forms of the paper, which stand in the Python reference",
    "contact_heat.energy": "where the heat goes is a result of the solver, and stands in the Python reference",
    "contact_heat.peers": "what the solver is measured against shares nothing with it",
    "contact_heat.published_cases": "published contacts belong to the solver, not to the plugin that measures it",
    "itouch_xyz_table.axes": "kernels, loaded only where the table is a twin",
    "itouch_arms.haply.emulator": "each device that has an emulator has a file for it",
    "itouch_arms.openhaptics.openhaptics_device": "each device plugin has a file",
}


def family_of(name: str) -> str:
    """Return the folder of like files that a module lies in, or nothing."""
    folder = name.rpartition(".")[0]
    return folder if folder in FAMILIES else ""


@pytest.fixture(scope="module")
def small() -> dict[str, str]:
    """Return the small modules with one importer, each with that one."""
    every = modules()
    return small_with_one_importer(every, imports(every))


def test_a_small_module_with_one_importer_has_a_reason(small: dict[str, str]) -> None:
    homeless = [
        f"{name}, imported by {by}" for name, by in small.items() if name not in REASONS and not family_of(name)
    ]
    assert homeless == [], f"merge each into its importer or a kindred file, or say here why not (under {SMALL} lines)"


def test_every_reason_is_still_needed(small: dict[str, str]) -> None:
    assert sorted(REASONS.keys() - small.keys()) == []
    assert [name for name in REASONS if family_of(name)] == []
    assert sorted(FAMILIES.keys() - {family_of(name) for name in small}) == []


def test_small_modules_with_one_importer_are_found(tmp_path: Path) -> None:
    """Not one with two importers or none, nor one that is long enough; a module beside its package counts."""
    long = "".join(f"X{number} = {number}\n" for number in range(SMALL))
    files = {
        "__init__.py": "",
        "loop/__init__.py": "from itouch.loop import step\n",
        "loop/step.py": "def f():\n    from itouch.loop import plan, large\n    return plan, large\n",
        "loop/plan.py": "from itouch.loop import clock\n",
        "loop/clock.py": "",
        "loop/large.py": long,
        "loop/nearly.py": long.split("\n", 1)[1],
        "loop/pacing.py": "from itouch.loop import clock, nearly\n",
    }
    for name, text in files.items():
        path = tmp_path / "framework" / "itouch" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    every = modules(tmp_path)
    assert small_with_one_importer(every, imports(every)) == {
        "itouch.loop.nearly": "itouch.loop.pacing", "itouch.loop.plan": "itouch.loop.step",
        "itouch.loop.step": "itouch.loop",
    }  # fmt: skip
