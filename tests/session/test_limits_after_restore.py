"""Every limit of every scene, rig and random rig, in each place where it can stand: no way back runs under a looser one.

A session is stored, and its scene then changed by one limit, as an edit or another version would; every digest fits.
"""

from __future__ import annotations

import os
import random
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import campaign
import pytest
from requirements import not_here
from shipped import SCENES
from test_limits_stored import edited

import itouch
from itouch.plugin.discovery import Catalog
from itouch.scene import Scene, loads, write
from itouch.schema import SceneError
from itouch.session.document import to_xml
from itouch_evidence.faults.random_rigs import draw

#: Of what is no number but holds, or of which less is looser.
FLAGS, LEAST = {"hold_to_run": (False, True), "servo_overrun": ("warn", "stop")}, {"ramp"}
SAFETY = (
    "force", "torque", "speed", "temperature", "plate_force", "plate_rate", "flux", "dose", "cold_time",
    "contact_time", "ramp", "watchdog", *FLAGS,
)  # fmt: skip
PAIRS = [
    (scene.name, rig)
    for scene in sorted(SCENES.glob("*.xml"))
    for rig in ("", *(path.name for path in sorted((SCENES / "rigs").glob("*.xml"))))
]

#: A change: in which element, what of it, and the tighter value.
Change = tuple[str, str, Any]


def in_force(session: itouch.Session) -> dict[str, Any]:
    """Return every limit by a name of its own; this is not how the program compares them."""
    safety = session.model.scene.safety
    found: dict[str, Any] = {name: getattr(safety, name) for name in FLAGS}
    for name, device in session.model.devices.items():
        found |= {f"{name} {limit}": value for limit, value in device.limits.table().items()}
        found[f"{name} ramp"] = device.limits.ramp
    return found


def loosened(before: dict[str, Any], after: dict[str, Any]) -> set[str]:
    """Return the names of the limits that are looser afterwards."""
    found = set()
    for name, was in before.items():
        now = after[name]
        if name in FLAGS:
            looser = FLAGS[name].index(now) < FLAGS[name].index(was)
        elif isinstance(was, tuple):
            looser = now[0] < was[0] or now[1] > was[1]
        else:
            looser = now < was if name.endswith(" ramp") else now > was
        found |= {name} if looser else set()
    return found


def tighter(name: str, value: Any) -> Any:
    """Return a tighter value of a limit."""
    if name in FLAGS:
        return FLAGS[name][1]
    if isinstance(value, tuple):
        return value[0] + 0.5, value[1] - 0.5
    return (value or 0.5) * 2.0 if name in LEAST else value * 0.6


def changes(session: itouch.Session) -> Iterator[Change]:
    """Yield each limit in each place where it can be tightened."""
    scene, devices = session.model.scene, session.model.devices
    held: dict[str, list[Any]] = {}
    for device in devices.values():
        for limit, value in {**device.limits.table(), "ramp": device.limits.ramp}.items():
            held.setdefault(limit, []).append(value)
    for name in SAFETY:
        if name in FLAGS:
            yield "safety", name, tighter(name, None)
        elif name in held:
            yield "safety", name, tighter(name, min(held[name]))
    for element in scene.devices:
        own = devices[element.name].limits.table()
        for name in (field.name for field in fields(element.limits)):
            if name in own:
                yield element.name, name, tighter(name, own[name])


def changed(scene: Scene, change: Change) -> Scene:
    """Return a scene with one limit changed."""
    where, name, value = change
    if where == "safety":
        return replace(scene, safety=replace(scene.safety, **{name: value}))
    devices = [
        replace(one, limits=replace(one.limits, **{name: value})) if one.name == where else one for one in scene.devices
    ]
    return replace(scene, devices=tuple(devices))


def told_of(names: set[str], said: str) -> bool:
    """Tell whether each of these limits is named."""
    words = [name.replace("_", "-") if name in FLAGS else "'{}' {}".format(*name.split(" ")) for name in names]
    return all(word.replace("_", "-") in said.replace("_", "-") for word in words)


def stored(session: itouch.Session, scene: Scene, path: Path) -> Path:
    """Store a session with the scene of another one in the place of its own: as archive, or as one document."""
    if path.suffix == ".xml":
        path.write_text(to_xml(replace(session.snapshot(), scene=scene)), encoding="utf-8")
        return path
    session.save(path)
    return edited(path, (write(session.model.scene), write(scene)))


def hold_on_both_ways_back(
    base: itouch.Session, change: Change, catalog: Catalog | None, folder: Path, ending: str
) -> bool:
    """Tighten a stored session by one limit, and loosen one that was begun tighter; false: the change has no effect."""
    try:
        tight = itouch.build(changed(base.model.scene, change), catalog=catalog)
    except SceneError:
        return False
    loose_limits, tight_limits = in_force(base), in_force(tight)
    looser = loosened(tight_limits, loose_limits)
    assert not loosened(loose_limits, tight_limits), change
    if not looser:
        return False
    path = stored(base, tight.model.scene, folder / f"tightened{ending}")
    session = itouch.restore(path, catalog=catalog)
    assert in_force(session) == tight_limits, change
    assert told_of(looser - set(FLAGS), "\n".join(session.notices)), (change, session.notices)
    path = stored(tight, base.model.scene, folder / f"loosened{ending}")
    with pytest.raises(itouch.SessionError, match="looser limits") as caught:
        itouch.restore(path, catalog=catalog)
    assert told_of(looser, str(caught.value)), (change, str(caught.value))
    return True


@pytest.mark.parametrize(
    ("scene", "rig"), campaign.some(PAIRS, lambda pair: pair == ("four_materials.xml", "twin.xml"))
)
def test_no_limit_of_a_shipped_scene_and_rig_is_looser_on_the_way_back(tmp_path: Path, scene: str, rig: str) -> None:
    try:
        loaded = itouch.load(SCENES / scene, rig=SCENES / "rigs" / rig if rig else None, twin="all", records=False)
        base = itouch.build(loaded)
    except SceneError:
        not_here("this rig does not fit this scene")
    every = list(changes(base))
    random.Random(f"{scene} {rig}").shuffle(every)
    must = [change for change in every if change[1] in FLAGS][: campaign.size(2, 2)]
    some = [*must, *[change for change in every if change not in must][: campaign.size(4, len(every))]]
    held = [hold_on_both_ways_back(base, one, None, tmp_path, (".itouch", ".xml")[n % 2]) for n, one in enumerate(some)]
    assert any(held) or not base.model.devices
    campaign.tell(f"{scene} {rig}: {sum(held)} of {len(some)} changes of a limit, none looser on the way back")


@pytest.mark.parametrize("number", campaign.seeds(1, 30))
def test_no_limit_of_a_random_rig_is_looser_on_the_way_back(tmp_path: Path, number: int) -> None:
    case = draw(number, 1601)
    base = itouch.build(loads(case.scene.encode(), case.catalog), catalog=case.catalog)
    every = list(changes(base))
    random.Random(number).shuffle(every)
    some = every[: campaign.size(8, len(every))]
    endings = (".itouch", ".xml")
    held = [hold_on_both_ways_back(base, one, case.catalog, tmp_path, endings[n % 2]) for n, one in enumerate(some)]
    assert any(held)


def test_a_new_process_refuses_what_would_be_looser(tmp_path: Path) -> None:
    base = itouch.build(SCENES / "four_materials.xml", twin="all")
    tight = itouch.build(changed(base.model.scene, ("safety", "dose", 20.0)))
    path = stored(tight, base.model.scene, tmp_path / "s.itouch")
    program = "from itouch_tools.cli import main; raise SystemExit(main())"
    words = ["run", str(path), "--headless", "--for", "0.1 s"]
    done = subprocess.run(
        [sys.executable, "-c", program, *words],
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
        env=os.environ,
    )
    assert done.returncode == 2
    assert "dose: 0.3333 min CEM43" in done.stderr
