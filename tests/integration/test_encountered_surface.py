"""The encountered surface is a modality: the commands that the framework's own way made are kept; it is there unasked.

``python tests/integration/test_encountered_surface.py`` writes the kept commands anew.
"""

from __future__ import annotations

import json
import math
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

sys.path.append(str(Path(__file__).parents[1]))  # where a command does not look, and the tests do
sys.path.append(str(Path(__file__).parents[1] / "session"))

from commanded import commanded, same
from shipped import SCENES
from third_party_plugins import install

import itouch
from itouch.monitors.thresholds import DOUBT_GAP, DOUBT_GAP_UNCALIBRATED
from itouch.plugin.carried_surfaces import ROOM, SLOPE_AHEAD
from itouch.plugin.discovery import Catalog, Found, find
from itouch.session import layout_mapping
from itouch.testing.checks import examine
from itouch.testing.scenario import ModalityHarness
from itouch.testing.suites import MODALITY_CHECKS
from itouch_encountered import Encountered, choosing, feed_forward, modality, motion, surface_fields
from itouch_tools.cli.__main__ import main

PLUGIN = '''
import ctypes
import math
from dataclasses import dataclass

from itouch.plugin import Device, DeviceError, Field, Modality, Twin, pose, schema
from itouch_encountered import Encountered, EncounteredParams


@dataclass(frozen=True, slots=True)
class Still:
    """Nothing to say."""


class Rides(Twin):
    """Sways by a millimetre, and goes round."""

    def fields(self):
        return (Field("time", unit="s", doc="since the begin"),)

    def reset(self, state, rng):
        state["time"] = 0.0

    def position(self, state):
        return None

    def step(self, state, command, touch, period):
        state["time"] += period

    def read(self, state, reading):
        time = state["time"].item()
        reading["pose"][:] = (1e-3 * math.sin(3 * time), 1e-3 * math.cos(time), 5e-4 * math.sin(2 * time), 1, 0, 0, 0)
        return True


class Cart(Device):
    """Carries what stands on it."""

    Params, Twin = Still, Rides
    reads = (pose(),)

    def open(self):
        raise DeviceError("no cart here")

    def close(self):
        pass

    def read(self, reading):
        return False


class Hum(Modality):
    """Renders nothing."""

    Params, subscribes_to = Still, frozenset()

    def compile(self, name, params, world):
        return name

    def reset(self, model, state):
        pass

    def update(self, model, state, period):
        pass


@dataclass(frozen=True, slots=True)
class Where(EncounteredParams):
    """What it writes beside its own."""

    field: str = schema.text(default="", doc="a field of somebody else")


class Astray(Encountered):
    """Does what it should, and in one tick writes past the views that it got, as compiled code may."""

    Params = Where

    def compile(self, name, params, world):
        Astray.field = params.field
        return super().compile(name, params, world)

    def update(self, model, state, period):
        super().update(model, state, period)
        if state["tick"].item() == 300:
            ctypes.memset(state[Astray.field].ctypes.data, 0x11, 8)
'''
SCENE = """<itouch version="1.0" xmlns:xyz-table="urn:itouch:plugin:xyz-table" xmlns:usb-arm="urn:itouch:plugin:usb-arm">
  <materials><material name="m"><contact stiffness="800 N/m" damping="2 N*s/m" static-friction="0.3"/></material></materials>
  <world>{world}</world>
  <devices>
    <device name="arm" plugin="usb-arm"><mount pos="0 250 0 mm" rpy="0 0 180 deg"/><limits force="3 N"/>
      <usb-arm:hardware/></device>
    {devices}
  </devices>
  <interaction>
    <probe name="finger" radius="8 mm" pose-from="arm" force-to="arm" surface-to="table"{probe}/>
    <operator probe="finger"><motion>{motion}</motion></operator>
  </interaction><safety force="3 N"{safety}/>
</itouch>
"""
TABLE = """<device name="table" plugin="xyz-table"><mount {mount}/><limits speed="0.25 m/s"/>{more}
  <xyz-table:hardware travel="200 140 80 mm"/></device>"""
BLOCK = '<box name="block" size="90 60 20 mm" pos="0 0 10 mm" material="m"/>'
BALL = '<sphere name="ball" radius="40 mm" pos="0 0 -20 mm" material="m"/>'
STROKE = """<to pos="-20 0 40 mm" in="0.2 s" hold="0.2 s"/><to pos="-20 0 25 mm" in="0.4 s" hold="0.3 s"/>
  <to pos="25 5 25 mm" in="0.5 s" hold="0.2 s"/><to pos="25 5 40 mm" in="0.3 s" hold="0.2 s"/>"""
OVER = """<to pos="-40 0 40 mm" in="0.2 s" hold="0.2 s"/><to pos="-35 0 10 mm" in="0.3 s"/>
  <to pos="0 0 25 mm" in="0.6 s" hold="0.2 s"/><to pos="35 3 10 mm" in="0.6 s"/><to pos="35 3 40 mm" in="0.3 s"/>"""
LONG = """<to pos="0 0 40 mm" in="0.2 s"/><to pos="0 0 25 mm" in="0.4 s" hold="3 s"/>
  <to pos="0 0 40 mm" in="0.4 s" hold="2 s"/><to pos="0 0 25 mm" in="0.4 s" hold="0.4 s"/>"""
HARD = """<to pos="0 0 40 mm" in="0.2 s"/><to pos="0 0 15 mm" in="0.4 s" hold="0.5 s"/>
  <to pos="20 0 12 mm" in="0.4 s" hold="0.5 s"/><to pos="20 0 40 mm" in="0.4 s"/>"""
TOUCH_OFF = '<calibration method="touch-off"/>'
CART = '<device name="cart" plugin="ours"/>'
#: Name -> world, devices, motion, attributes of <probe> and <safety>, and what must have come about in it.
WORLDS: dict[str, tuple[str, str, str, str, str, str]] = {
    "level": (BLOCK, TABLE.format(mount='pos="0 0 -8 mm"', more=""), STROKE, "", "", "present"),
    "tilted, turned, touched off and carried": (
        BLOCK,
        CART + TABLE.format(mount='on="cart" pos="3 -4 -8 mm" rpy="1 -2 40 deg" mount-error="0 0 2 mm"', more=TOUCH_OFF),
        STROKE, "", "", "present",
    ),
    "over a ball": (BALL, TABLE.format(mount='pos="0 0 -8 mm"', more=""), OVER, "", "", "changes"),
    "from further away, and less steep": (
        BALL, TABLE.format(mount='pos="0 0 -8 mm"', more=""), OVER,
        ' clearance="8 mm" plate-angle="14 deg"', "", "changes",
    ),
    "too low": (
        BLOCK, TABLE.format(mount='pos="0 0 -8 mm" mount-error="0 0 3 mm"', more=""), STROKE, "", "",
        "misses",
    ),
    "too high": (
        BLOCK, TABLE.format(mount='pos="0 0 -8 mm" mount-error="0 0 -4 mm"', more=""), STROKE, "", "",
        "misses",
    ),
    "pressed harder than it may": (BLOCK, TABLE.format(mount='pos="0 0 -8 mm"', more=""), HARD, "", "", "yields"),
    "withdrawn": (
        BLOCK, TABLE.format(mount='pos="0 0 -8 mm"', more=""), LONG, "", ' contact-time="1.5 s"', "withdrawn",
    ),
}  # fmt: skip
#: The same surface as an element of the scene, and what two others are.
ELEMENT = '<ours:{0} xmlns:ours="urn:itouch:plugin:ours" {1}/></interaction>'
KEPT = Path(__file__).parent / "encountered_commands.json"
ADVICE = (
    "if it is meant: python tests/integration/test_encountered_surface.py, and say in the commit what changes, and why"
)


def written(world: str, folder: Path) -> Path:
    """Write the scene of a world, and return its file."""
    objects, devices, motion_, probe, safety, _ = WORLDS[world]
    path = folder / "scene.xml"
    text = SCENE.format(world=objects, devices=devices, motion=motion_, probe=probe, safety=safety)
    path.write_text(text, encoding="utf-8")
    return path


def brought(site: Path) -> None:
    """Write the distribution of the cart, of the surface under another name, and of two modalities of a stranger."""
    listed = {"named": "Encountered", "hum": "Hum", "astray": "Astray"}
    modalities = "".join(f"ours.{name} = cart_and_others:{kind}\n" for name, kind in listed.items())
    points = f"[itouch.devices]\nours = cart_and_others:Cart\n[itouch.modalities]\n{modalities}"
    install(site, "ours", points, module="cart_and_others", code=PLUGIN)


@pytest.fixture(scope="module", autouse=True)
def installed(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Install a cart, the surface under another name, and two modalities of a stranger."""
    site = tmp_path_factory.mktemp("site")
    brought(site)
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(site))
        yield


def asked_for(path: Path, element: str, attributes: str = 'probe="finger"') -> Path:
    """Return a copy of a scene with an element more."""
    other = path.with_name(f"with_{element}.xml")
    text = path.read_text(encoding="utf-8")
    other.write_text(text.replace("</interaction>", ELEMENT.format(element, attributes), 1), encoding="utf-8")
    return other


def come_about(session: itouch.Session) -> set[str]:
    """Return what comes about in a session in 12 s."""
    state, come = session.state, set()

    def note(tick: int) -> None:
        seen = {
            "present": state["finger.surface.present"], "misses": state["finger.surface.misses"],
            "changes": state["finger.surface.changing"], "withdrawn": state["table.surface.withdrawn"],
            "yields": state["finger.plate_yield"],
        }  # fmt: skip
        come.update(name for name, value in seen.items() if value > 0)

    session.records = False
    session.taps.append(note)
    session.run(until=lambda: session.done or session.seconds > 12.0)
    return come


@pytest.mark.parametrize("world", WORLDS)
def test_it_commands_what_the_frameworks_own_way_commanded(world: str, tmp_path: Path) -> None:
    """The numbers are of the commit before it became a modality."""
    same(commanded(written(world, tmp_path)), json.loads(KEPT.read_text(encoding="utf-8"))[world], ADVICE)


@pytest.mark.parametrize("world", WORLDS)
def test_what_each_of_those_scenes_is_for_comes_about_in_it(world: str, tmp_path: Path) -> None:
    assert WORLDS[world][-1] in come_about(itouch.build(written(world, tmp_path), seed=1))


def test_an_element_that_names_it_takes_the_place_of_the_default(tmp_path: Path) -> None:
    world = "from further away, and less steep"
    path = asked_for(written(world, tmp_path), "named")
    session = itouch.build(path)
    assert [one.name for one in session.model.modalities] == ["named"]
    assert not [notice for notice in session.notices if "no effect" in notice]
    same(commanded(path), json.loads(KEPT.read_text(encoding="utf-8"))[world], ADVICE)


def test_the_plan_says_who_carries_and_that_limits_have_the_last_word(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["inspect", str(written("level", tmp_path)), "--plan", "--json"]) == 0
    plan = json.loads(capsys.readouterr().out)
    rows = {row["step"]: row for row in plan["steps"]}
    assert rows["finger.surface"]["code"] == "compiled"
    assert plan["writers"]["table.command.pose_target"] == "finger.surface"
    names = list(rows)
    after = [names.index(name) for name in ("finger.surface", "surface finger", "supervise table", "guard table")]
    assert after == sorted(after)
    assert main(["check", str(written("level", tmp_path))]) == 0
    assert "0 modalities" in capsys.readouterr().out  # of what the scene asks for


def test_what_other_limits_are_made_of_is_what_it_reckons_with() -> None:
    """A plugin can't import what monitors have."""
    assert (choosing.FAR, choosing.FAR_UNCALIBRATED) == (DOUBT_GAP, DOUBT_GAP_UNCALIBRATED)
    assert modality.ROOM_WIRED >= ROOM
    assert 2 * round(SLOPE_AHEAD * 4000.0) <= surface_fields.MOST_KINKS  # at the fastest servo rate


#: Over the top of the ball and back, so quickly that a drive is late.
TO_AND_FRO = '<to pos="0 0 40 mm" in="0.2 s" hold="0.2 s"/><to pos="0 0 25 mm" in="0.4 s" hold="0.2 s"/>' + (
    '<to pos="14 3 23 mm" in="0.2 s"/><to pos="-14 3 23 mm" in="0.2 s"/>' * 4
)


@pytest.mark.parametrize("bandwidth", [25.0, 40.0, 60.0])
def test_it_learns_how_late_a_drive_is_where_a_surface_bends(bandwidth: float, tmp_path: Path) -> None:
    """A position control of a bandwidth w is x'' / w2 behind: so much more it must be sent."""
    table = TABLE.format(mount='pos="0 0 -8 mm"', more="").replace("travel", f'bandwidth="{bandwidth} Hz" travel')
    path = tmp_path / "scene.xml"
    path.write_text(SCENE.format(world=BALL, devices=table, motion=TO_AND_FRO, probe="", safety=""), encoding="utf-8")
    session = itouch.build(path, seed=1)
    session.records = False
    session.run(until=lambda: session.done)
    behind = 1.0 / (2.0 * np.pi * bandwidth) ** 2
    assert session.state["finger.surface.inertia"].item() == pytest.approx(behind, rel=0.2)


@pytest.mark.parametrize(("tilt", "evened"), [(25.0, False), (30.0, False), (44.0, True), (46.0, False)])
def test_it_evens_out_the_steps_of_an_arm_on_steep_faces_that_it_renders(tilt: float, evened: bool) -> None:
    """A finger that goes on evenly is read in steps of 30 um; less steep faces are followed as they are, to the bit."""
    cosine = math.cos(math.radians(45.0))
    numbers = motion.Numbers(8e-3, 5e-3, cosine, 0.73, 1e-3, 2.0, 2.0, 1e3, True, 2e-4, 4e-3, 3, 0.0, 0.0, 0.0)
    state, upright = np.zeros(surface_fields.KINKS + surface_fields.MOST_KINKS), math.cos(math.radians(tilt))
    slope, along = math.tan(math.radians(tilt)), 11e-6 * np.arange(200)  # [m]
    read = 0.02 + slope * np.floor(along / 30e-6) * 30e-6
    heights = np.array([motion._even(numbers, state, height, slope * 11e-3, upright) for height in read])
    assert (heights == read).all() != evened
    if evened:
        jumps = np.diff(heights)[50:] - slope * 11e-6
        assert np.abs(jumps).max() < 0.6 * np.abs(np.diff(read)[50:] - slope * 11e-6).max()
        assert np.abs(heights - 0.02 - slope * (along - 15e-6))[50:].max() < 16e-6  # and it is no later
    assert motion._even(numbers, state, -np.inf, 0.0, 1.0) == -np.inf
    assert motion._even(numbers, state, 0.05, 0.0, upright) == 0.05  # another surface


@pytest.mark.parametrize("period", [2.5e-4, 1e-3, 3e-3])
def test_it_rounds_a_kink_off_and_is_on_both_faces_before_and_after(period: float) -> None:
    """Its speed grows by the same from tick to tick, from when the kink is seen to as long after it."""
    ahead = max(1, round(SLOPE_AHEAD / period))
    numbers = motion.Numbers(8e-3, 5e-3, 0.9, 0.92, period, 2.0, 2.0, 1e3, True, 2e-4, 4e-3, ahead, 0.0, 0.0, 0.0)
    state, steepens = np.zeros(surface_fields.KINKS + surface_fields.MOST_KINKS), 0.05  # [m/s]
    state[surface_fields.INERTIA] = 1.6e-5
    off = [feed_forward.bend(numbers, state, steepens / period if k == 0 else 0.0, 0.0, True) for k in range(4 * ahead)]
    surface = steepens * period * np.maximum(0.0, np.arange(4 * ahead) - (ahead - 0.5))
    bends = np.diff(surface + off, n=2, prepend=[0.0, 0.0]) / period**2
    assert bends[1 : 2 * ahead + 1] == pytest.approx(np.full(2 * ahead, steepens / (2 * ahead) / period), rel=1e-9)
    assert np.abs(off[2 * ahead :]).max() < 1e-15
    assert np.abs(bends[2 * ahead + 1 :]).max() < 1e-6


def test_a_contact_that_begins_forgets_how_the_slope_turned() -> None:
    numbers = motion.Numbers(8e-3, 5e-3, 0.9, 0.92, 1e-3, 2.0, 2.0, 1e3, True, 2e-4, 4e-3, 3, 0.0, 0.0, 0.0)
    state = np.ones(surface_fields.KINKS + surface_fields.MOST_KINKS)
    assert feed_forward.bend(numbers, state, 50.0, 2.0, False) == 0.0
    assert state[surface_fields.BENDS] == state[surface_fields.HASTE] == 0.0
    assert not state[surface_fields.KINKS : surface_fields.KINKS + 6].any()


def test_a_slope_is_seen_to_turn_three_milliseconds_before_the_finger_is_there(tmp_path: Path) -> None:
    """A trough: two planes of 10 degrees, over which a finger goes at up to 0.1 m/s."""
    halves = "".join(
        f'<box name="half{side}" size="60 60 10 mm" pos="{30 * side} 0 5 mm" rpy="0 {-10 * side} 0 deg" material="m"/>'
        for side in (-1, 1)
    )
    motion_ = (
        '<to pos="-15 0 40 mm" in="0.2 s" hold="0.2 s"/><to pos="-15 0 11 mm" in="0.4 s" hold="0.2 s"/>'
        '<to pos="15 0 11 mm" in="0.6 s"/>'
    )
    path, table = tmp_path / "scene.xml", TABLE.format(mount='pos="0 0 -8 mm"', more="")
    path.write_text(SCENE.format(world=halves, devices=table, motion=motion_, probe="", safety=""), encoding="utf-8")
    session = itouch.build(path, seed=1)
    session.records = False
    rows: list[tuple[float, ...]] = []
    state, names = session.state, ("finger.surface.turns", "finger.surface.climb")
    session.taps.append(
        lambda tick: rows.append((*(state[name].item() for name in names), state["finger.hip"][0].item()))
    )
    session.run(until=lambda: session.done)
    turns, climb, x = np.array(rows)[np.abs(np.array(rows)[:, 2]) < 5e-3].T
    kink, seen = int(np.diff(climb).argmax()) + 1, int(turns.argmax())
    assert abs(x[kink]) < 2e-3
    assert climb[kink] - climb[kink - 1] > 0.02
    assert kink - seen in (2, 3, 4)
    assert turns[seen] * session.model.period == pytest.approx(climb[kink] - climb[kink - 1], rel=0.1)


def test_the_conformance_suite_finds_nothing_wrong(tmp_path: Path) -> None:
    path = asked_for(written("level", tmp_path), "named")
    found = list(examine(MODALITY_CHECKS, ModalityHarness(Encountered, scene=path)))
    assert [f"{one.check.name}: {one.note}" for one in found if one.outcome == "failed"] == []
    assert {one.check.name for one in found if one.outcome == "passed"} >= {"carries", "runs", "determinism"}


@pytest.mark.parametrize("field", ["arm.pose", "events.table", "table.surface.track"])
@pytest.mark.parametrize("others", [False, True], ids=["alone", "beside another modality"])
def test_what_a_carrier_writes_past_its_views_stops_the_devices(field: str, others: bool, tmp_path: Path) -> None:
    path = asked_for(written("level", tmp_path), "astray", f'probe="finger" field="{field}"')
    session = itouch.build(asked_for(path, "hum", "") if others else path)
    with pytest.raises(itouch.DeviceFaultError, match=f"lost its modality .*'astray'.* wrote '{field}'") as fault:
        session.run(1.0)
    assert fault.value.tick == 300


def test_a_scene_whose_surface_nobody_brings_is_refused_at_its_place(tmp_path: Path) -> None:
    class Broken:
        value, module, attr = "itouch_encountered:Gone", "itouch_encountered", "Gone"

        def load(self) -> Any:
            raise ImportError("it is gone")

    def finder(group: str) -> dict[str, Found]:
        gone = Found("encountered", "itouch-py", "1", Broken())  # type: ignore[arg-type]
        return {"encountered": gone} if group == "itouch.carriers" else dict(find(group))

    with pytest.raises(itouch.SceneError, match="brings the surface of 'table' to probe 'finger'.*it is gone") as error:
        itouch.build(written("level", tmp_path), catalog=Catalog(finder))
    (problem,) = error.value.problems
    assert problem.place is not None
    assert problem.place.text[problem.place.column - 1 :].startswith('surface-to="table"')


def test_nobody_takes_its_place_by_being_installed(tmp_path: Path) -> None:
    def finder(group: str) -> dict[str, Found]:
        other = Found("a", "another", "1", None)  # type: ignore[arg-type]
        return ({"a": other} if group == "itouch.carriers" else {}) | dict(find(group))

    (one,) = itouch.build(written("level", tmp_path), catalog=Catalog(finder)).model.modalities
    assert (one.name, type(one.instance)) == ("finger.surface", Encountered)


def test_a_modality_of_another_kind_may_not_have_its_name(tmp_path: Path) -> None:
    path = asked_for(written("level", tmp_path), "hum", 'name="finger.surface"')
    with pytest.raises(itouch.SceneError, match="'finger.surface' has the name of what brings the surface of 'table'"):
        itouch.build(path)


#: What State did not have of a probe when the framework carried the surface itself.
GROWN = ("takes", "at_finger", "distance", "gap", "coming", "lost", "yields", "arrived", "unasked")


@pytest.mark.parametrize(("world", "at"), [("over a ball", 0.9), ("too low", 0.9), ("withdrawn", 2.7), ("level", 0.7)])
def test_a_session_that_was_stored_before_goes_on_with_the_same_commands(world: str, at: float, tmp_path: Path) -> None:
    """Also in a touch: what the framework remembered is what the modality does."""
    session = itouch.build(written(world, tmp_path), seed=3)
    session.records = False
    session.run(at)
    fields = session.state.dtype.fields
    assert fields is not None
    gone = {f"finger.surface.{name}" for name in (*GROWN, "clear")}
    kinds = [(name, kind[0]) for name, kind in fields.items() if name not in gone]
    stored = np.zeros(1, np.dtype(kinds))
    for name, _ in kinds:
        stored[name] = session.state[name]
    other = itouch.build(tmp_path / "scene.xml", seed=3)
    other.records = False
    other.adopt(layout_mapping.adopt(stored, other.state, {})[0])
    for _ in range(1000):
        session.tick()
        other.tick()
        for name in ("table.sent.pose_target", "arm.sent.wrench", "finger.surface.missed"):
            assert session.state[name].tobytes() == other.state[name].tobytes(), (session.ticks, name)


def test_of_a_probe_without_a_surface_nothing_is_refused_that_meant_nothing(tmp_path: Path) -> None:
    session = itouch.build(SCENES / "first_touch.xml")
    old = [("press", 0.1), ("free", 1.0), ("unfelt", 0.0), ("give", 0.0), ("lag", 0.0)]
    kinds = [(name, kind[0]) for name, kind in (session.state.dtype.fields or {}).items()]
    stored = np.zeros(1, np.dtype([*kinds, *((f"finger.surface.{name}", "<f8") for name, _ in old)]))
    for name, value in old:
        stored[f"finger.surface.{name}"] = value
    assert layout_mapping.adopt(stored, session.state, {}) == (np.zeros(1, session.state.dtype).tobytes(), [])


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as site_, tempfile.TemporaryDirectory() as scenes_:
        brought(Path(site_))
        sys.path.insert(0, site_)
        found_ = {world_: commanded(written(world_, Path(scenes_))) for world_ in WORLDS}
    KEPT.write_text(json.dumps(found_, indent=0) + "\n", encoding="utf-8")
