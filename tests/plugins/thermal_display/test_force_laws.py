"""Contact resistance as a function of the force: in the scene, live, in the controller, and in a restored session."""

from __future__ import annotations

from pathlib import Path

import pytest
from display_scenes import Display

import itouch
from contact_heat.resistance import PressureResistance
from itouch_thermal.heat import HeatParams
from itouch_thermal.laws import ConstantLaw, ForcePoint, PressureLaw, TableLaw, press_factor

PRESSURE = '<thermal:heat probe="finger"><thermal:pressure-resistance/></thermal:heat>'
TABLE = """<thermal:heat probe="finger"><thermal:table-resistance>
  <thermal:point force="0.1 N" resistance="0.006 m^2*K/W"/><thermal:point force="3 N" resistance="0.002 m^2*K/W"/>
</thermal:table-resistance></thermal:heat>"""
CONSTANT = '<thermal:heat probe="finger"><thermal:constant-resistance resistance="0.003 m^2*K/W"/></thermal:heat>'
FINGER = "<thermal:hardware><thermal:pressure-resistance/></thermal:hardware>"


def touched(engine: itouch.Session, seconds: float) -> None:
    """Run until the first contact has lasted so long."""
    while int(engine.state["finger.contact.object"]) < 0:
        engine.tick()
    engine.run(seconds)


@pytest.mark.parametrize(
    ("heat", "law"),
    [
        (PRESSURE, PressureLaw().law()),
        (
            TABLE,
            TableLaw(points=(ForcePoint(force=0.1, resistance=6e-3), ForcePoint(force=3.0, resistance=2e-3))).law(),
        ),
        (CONSTANT, ConstantLaw(resistance=3e-3).law()),
    ],
)
def test_heat_takes_the_resistance_of_its_law_at_the_force_that_is_felt(scenes: Path, heat: str, law: object) -> None:
    engine = itouch.build(Display(heat=heat).write(scenes))
    touched(engine, 0.02)
    seen = set()
    for _ in range(300):
        engine.tick()
        force = float(engine.state["finger.felt_force"])
        if force > 0.0:
            resistance = float(engine.state["heat.resistance"])
            assert resistance == law.at(force)  # type: ignore[attr-defined]
            seen.add(resistance)
    assert len(seen) == 1 if heat is CONSTANT else len(seen) > 100
    assert float(engine.state["heat.contact_area"]) == pytest.approx(1.1e-4 * force ** (1 / 3))


def test_a_press_lets_the_resistance_fall_with_its_time_constant(scenes: Path) -> None:
    engine = itouch.build(Display(heat='<thermal:heat probe="finger" press="50 ms"/>').write(scenes))
    touched(engine, 0.0)
    since = int(engine.state["heat.since"])
    assert float(engine.state["heat.resistance"]) == pytest.approx(2e-3 * press_factor(since * 1e-3, 0.05))
    engine.run(0.6)
    assert float(engine.state["heat.resistance"]) == pytest.approx(2e-3, rel=1e-4)


@pytest.mark.parametrize("rates", ["", ' flux-control="100 Hz"'])
def test_the_flux_is_followed_where_finger_and_law_depend_on_the_force(scenes: Path, rates: str) -> None:
    engine = itouch.build(Display(heat=PRESSURE, hardware=FINGER, rates=rates).write(scenes), seed=2)
    engine.run()
    assert all(entry["flux_error_rms"] < 0.05 for entry in engine.report()["contacts"])


def test_what_the_controller_expects_follows_the_measured_force(scenes: Path) -> None:
    engine = itouch.build(Display(heat=PRESSURE, hardware=FINGER).write(scenes), seed=2)
    touched(engine, 0.5)
    force = abs(float(engine.state["table.wrench"][2]))
    (control,) = [m.model for m in engine.model.modalities if m.name == "flux-control"]
    assert not control.steady
    scale = PressureLaw().law().at(force) / control.contact.expected
    true = float(engine.state["peltier.twin.true_skin"] - engine.state["peltier.twin.true_plate"])
    assert true / float(engine.state["peltier.twin.true_flux"]) == pytest.approx(
        scale * control.contact.expected, rel=0.02
    )
    learnt = float(engine.state["flux-control.theta"][0])
    assert abs(learnt) < 0.05  # the force has explained the resistance, nothing is left to be learnt


def test_a_restored_session_goes_on_bit_for_bit(scenes: Path, tmp_path: Path) -> None:
    heat = (
        '<thermal:heat probe="finger" press="80 ms"><thermal:pressure-resistance base="150 W/(m^2*K)"/></thermal:heat>'
    )
    engine = itouch.build(Display(heat=heat, hardware=FINGER).write(scenes), seed=9)
    touched(engine, 0.037)
    engine.save(tmp_path / "half.itouch")
    other = itouch.restore(tmp_path / "half.itouch")
    for session in (engine, other):
        session.run(0.4)
    assert engine.state.tobytes() == other.state.tobytes()


def test_two_laws_or_a_law_and_a_constant_are_one_problem(scenes: Path) -> None:
    both = '<thermal:heat probe="finger"><thermal:pressure-resistance/><thermal:constant-resistance/></thermal:heat>'
    twice = (
        '<thermal:heat probe="finger" contact-resistance="0.004 m^2*K/W"><thermal:pressure-resistance/></thermal:heat>'
    )
    path = Display().write(scenes)
    text = path.read_text(encoding="utf-8")
    for heat, word in ((both, "only one"), (twice, "contact-resistance")):
        path.write_text(text.replace('<thermal:heat probe="finger"/>', heat), encoding="utf-8")
        with pytest.raises(itouch.SceneError) as fault:
            itouch.load(path)
        assert word in str(fault.value)
        assert all(problem.place is not None for problem in fault.value.problems)


@pytest.mark.parametrize(
    "law",
    [
        "<thermal:table-resistance/>",
        '<thermal:table-resistance><thermal:point force="1 N" resistance="1e-3"/>'
        '<thermal:point force="1 N" resistance="2e-3"/></thermal:table-resistance>',
        '<thermal:pressure-resistance base="0" slope="0"/>',
        '<thermal:pressure-resistance exponent="nan"/>',
        '<thermal:pressure-resistance contact-area="0 m^2"/>',
        '<thermal:constant-resistance resistance="-1"/>',
        '<thermal:constant-resistance resistance="1e999"/>',
    ],
)
def test_laws_that_can_not_be_are_problems(scenes: Path, law: str) -> None:
    heat = f'<thermal:heat probe="finger">{law}</thermal:heat>'
    with pytest.raises(itouch.SceneError) as fault:
        itouch.load(Display(heat=heat).write(scenes))
    assert len(fault.value.problems) == 1
    assert fault.value.problems[0].place is not None


def test_the_expected_resistance_is_that_at_the_expected_force() -> None:
    heat = HeatParams(probe="finger", laws=(PressureLaw(),), expected_force=0.5)
    assert heat.expected_resistance == PressureResistance().at(0.5)
    assert HeatParams(probe="finger").expected_resistance == 2e-3


def test_more_force_never_raises_the_resistance() -> None:
    law = PressureLaw(base=0.0, contact_area=5e-5, area_exponent=0.2).law()
    forces = [10.0 ** (k / 8 - 6) for k in range(64)]
    found = [law.at(force) for force in forces]
    assert found == sorted(found, reverse=True)
    assert law.at(0.0) == float("inf")
