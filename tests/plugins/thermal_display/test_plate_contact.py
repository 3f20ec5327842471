"""How a finger meets the plate is a matter of these two, not of the virtual object that it is to feel."""

from __future__ import annotations

from pathlib import Path

import pytest
from display_scenes import Display

import itouch
from itouch_thermal.flux.flux_control_params import FluxControlParams

CONTROL = '<thermal:flux-control display="peltier" desired-from="heat"{}/>'


def heat(resistance: float) -> str:
    return f'<thermal:heat probe="finger" contact-resistance="{resistance:g} m^2*K/W"/>'


def errors(scene: Display, folder: Path, seed: int = 1) -> list[float]:
    engine = itouch.build(scene.write(folder), seed=seed)
    engine.run()
    return [entry["flux_error_rms"] for entry in engine.report()["contacts"]]


@pytest.mark.parametrize("virtual", [0.001, 0.004, 0.01, 0.05])
def test_an_object_that_meets_the_finger_otherwise_than_the_plate_is_felt_as_well(scenes: Path, virtual: float) -> None:
    assert max(errors(Display(heat=heat(virtual)), scenes)) < 0.02


MILD = {"left": "wood", "right": "pyrex"}  # what a plate can give behind a poor contact, too


@pytest.mark.parametrize(
    "hardware",
    [
        ' contact-resistance="0.001 m^2*K/W"',
        ' contact-resistance="0.004 m^2*K/W"',
        ' press="50 ms"',
    ],
)
def test_the_plate_is_met_as_the_display_states_it(scenes: Path, hardware: str) -> None:
    assert max(errors(Display(**MILD, hardware=f"<thermal:hardware{hardware}/>"), scenes)) < 0.02


@pytest.mark.parametrize(
    ("inside", "bound"),
    # most of it is the beginning, when a finger that hardly touches yet takes less than it should
    [("<thermal:pressure-resistance/>", 0.07), ("<thermal:table-resistance>{points}</thermal:table-resistance>", 0.12)],
)
def test_a_plate_whose_contact_depends_on_the_force_renders_an_object_whose_contact_does_not(
    scenes: Path, inside: str, bound: float
) -> None:
    points = "".join(
        f'<thermal:point force="{force} N" resistance="{resistance} m^2*K/W"/>'
        for force, resistance in ((0.1, 0.006), (0.5, 0.003), (2.0, 0.001))
    )
    hardware = f"<thermal:hardware>{inside.format(points=points)}</thermal:hardware>"
    assert max(errors(Display(**MILD, hardware=hardware), scenes)) < bound


def test_a_press_of_the_object_is_not_one_of_the_plate(scenes: Path) -> None:
    assert max(errors(Display(**MILD, heat='<thermal:heat probe="finger" press="50 ms"/>'), scenes)) < 0.02


def test_what_the_scene_says_of_the_plate_counts_before_what_the_display_states(scenes: Path) -> None:
    same = errors(Display(control=CONTROL.format(' contact-resistance="0.002 m^2*K/W"')), scenes)
    assert same == errors(Display(), scenes)
    other = errors(Display(control=CONTROL.format(' contact-resistance="0.006 m^2*K/W"')), scenes)
    assert min(other) > 2.0 * max(same)


def test_where_the_plant_departs_from_what_is_stated_it_is_learnt(scenes: Path) -> None:
    off = '<thermal:hardware><thermal:mismatch contact-resistance="20 %"/></thermal:hardware>'
    same, other = errors(Display(**MILD), scenes), errors(Display(**MILD, hardware=off), scenes)
    assert max(same) < max(other) < 0.05  # nobody tells the controller what differs


def test_below_its_full_force_a_contact_is_as_much_poorer_as_the_force_is_less(scenes: Path) -> None:
    hardware = '<thermal:hardware contact-resistance="0.001 m^2*K/W" full-force="2 N"/>'
    engine = itouch.build(Display(**MILD, hardware=hardware).write(scenes), seed=1)
    (control,) = [m.model for m in engine.model.modalities if m.name == "flux-control"]
    assert control.contact.expected == control.contact.at == pytest.approx(0.002)
    while int(engine.state["flux-control.on_plate"]) == 0:
        engine.tick()
    engine.run(0.8)
    learnt = float(engine.state["flux-control.theta"][0])
    assert abs(learnt) < 0.1  # the force has explained it: twice as much at half the force


def test_controllers_that_know_no_resistance_refuse_one() -> None:
    with pytest.raises(ValueError, match='contact-resistance goes with controller="model"'):
        FluxControlParams(display="peltier", desired_from="heat", controller="paper", contact_resistance=0.002)
