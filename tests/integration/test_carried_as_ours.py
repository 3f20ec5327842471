"""What a stranger's modality is told suffices: written with it alone, the framework's own way commands the same bytes."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from shipped import SCENES

import itouch
from itouch_tools.cli.__main__ import main

PLUGIN = '''

from itouch.plugin import Device, DeviceError, Twin, pose


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
#: What the framework remembers of a surface, whoever carries it.
KEPT = (
    "renders", "present", "share", "pressed", "felt", "felt_weight", "missed", "misses", "missed_at", "missed_depth",
    "missed_load", "cut", "upright", "climb", "changing", "load", "settled",
)  # fmt: skip
#: What the framework makes of it.
FIGURES = ("plate_gap", "plate_top", "plate_yield", "tracking", "felt_force", "plate")
ELEMENT = '<ours:carries-as-ours xmlns:ours="urn:itouch:plugin:ours" probe="finger"/></interaction>'
WRITTEN = (Path(__file__).parent / "carries_as_ours.py").read_text(encoding="utf-8")


@pytest.fixture(scope="module", autouse=True)
def installed(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Install the stranger's modality, and a cart."""
    site = tmp_path_factory.mktemp("site")
    info = site / "ours-1.0.dist-info"
    info.mkdir()
    (site / "carries_and_cart.py").write_text(WRITTEN + PLUGIN, encoding="utf-8")
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: ours\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(
        "[itouch.devices]\nours = carries_and_cart:Cart\n"
        "[itouch.modalities]\nours.carries-as-ours = carries_and_cart:CarriesAsOurs\n"
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(site))
        yield


def both(path: Path, seconds: float) -> tuple[itouch.Session, itouch.Session, set[str]]:
    """Run a scene with the framework's way and with the stranger's; hold each tick of the second against the first.

    Return both sessions, and what has come about in them.
    """
    text = path.read_text(encoding="utf-8")
    other = path.with_name(f"other_{path.name}")
    other.write_text(text.replace("</interaction>", ELEMENT, 1), encoding="utf-8")
    sessions = itouch.build(path, seed=3), itouch.build(other, seed=3)
    come: set[str] = set()
    rows: tuple[list[bytes], list[bytes]] = ([], [])
    for session, found in zip(sessions, rows, strict=True):
        session.records = False
        state = session.state
        views = [state[name] for name in state if ".sent." in name]
        views += [state[f"finger.surface.{name}"] for name in KEPT] + [state[f"finger.{name}"] for name in FIGURES]

        def note(tick: int, found: list[bytes] = found, views: list[np.ndarray] = views, state=state) -> None:
            found.append(b"".join(view.tobytes() for view in views))
            come.update(
                name for name, is_so in (
                    ("present", state["finger.surface.present"] > 0), ("misses", state["finger.surface.misses"] > 0),
                    ("changes", state["finger.surface.changing"] > 0),
                    ("withdrawn", state["table.surface.withdrawn"] > 0),
                    ("yields", state["finger.plate_yield"] > 0),
                ) if is_so
            )  # fmt: skip

        session.taps.append(note)
        session.run(until=lambda session=session: session.done or session.seconds > seconds)
    assert len(rows[0]) == len(rows[1])
    apart = next((tick for tick, (a, b) in enumerate(zip(*rows, strict=True)) if a != b), None)
    assert apart is None, f"apart from tick {apart}"
    return (*sessions, come)


@pytest.mark.parametrize("world", WORLDS)
def test_a_stranger_carries_as_the_framework_does(world: str, tmp_path: Path) -> None:
    objects, devices, motion, probe, safety, what = WORLDS[world]
    path = tmp_path / "scene.xml"
    path.write_text(
        SCENE.format(world=objects, devices=devices, motion=motion, probe=probe, safety=safety), encoding="utf-8"
    )
    ours, theirs, come = both(path, 12.0)
    assert what in come
    assert ours.report()["faults"] == theirs.report()["faults"] == []
    assert not [line for line in theirs.report()["notices"] if "no effect" in line]
    one, other = (session.report()["contacts"] for session in (ours, theirs))
    assert one == other != []


def test_the_shipped_flat_scene_is_rendered_to_the_same_commands(tmp_path: Path) -> None:
    """Its first touch, with touch-off, display and heat: 12 s of it."""
    (tmp_path / "rigs").mkdir()
    for name in ("four_materials.xml", "materials.xml", "rigs/twin.xml"):
        shutil.copy(SCENES / name, tmp_path / name)
    *_, come = both(tmp_path / "four_materials.xml", 12.0)
    assert "present" in come


def test_it_joins_the_tick_and_imports_nothing_but_the_contract(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "scene.xml"
    world, devices, motion, probe, safety, _ = WORLDS["level"]
    text = SCENE.format(world=world, devices=devices, motion=motion, probe=probe, safety=safety)
    path.write_text(text.replace("</interaction>", ELEMENT, 1), encoding="utf-8")
    assert main(["inspect", str(path), "--plan", "--json"]) == 0
    (mine,) = (row for row in json.loads(capsys.readouterr().out)["steps"] if row["step"] == "carries-as-ours")
    assert mine["code"] == "compiled"
    imported = [line.split()[1] for line in WRITTEN.splitlines() if line.startswith(("from itouch", "import itouch"))]
    assert set(imported) == {"itouch.plugin", "itouch.plugin.kernels"}
