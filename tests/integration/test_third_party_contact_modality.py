"""A stranger's modality computes the contact of a probe: all that follows from a contact follows from what it says."""

from __future__ import annotations

import itertools
import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from third_party_plugins import install

import itouch
from itouch.contact import Box, layout
from itouch.faults.kinds import Kind
from itouch.loop.engine import Engine
from itouch.plugin.discovery import Catalog
from itouch.plugin.geometry import FOUND, Geometry, point_distance, proxy_step
from itouch.testing.declared_fields import touches
from itouch.testing.scenario import ModalityHarness
from itouch_evidence.renamed import RenamedCatalog
from itouch_tools.cli.__main__ import main

HERE = Path(__file__).parent
SCENES = Path(__file__).parents[2] / "scenes"
LATE = """
from itouch.plugin import Device, FingerTwin, pose, wrench

@dataclass(frozen=True, slots=True)
class Grip:
    "A grip on a wire."
    resolution: float = schema.quantity("m", low=0.0, high=1e-3, default=1e-5, doc="step of its encoders")

class Stylus(Device):
    "A stylus that answers every few milliseconds."
    Params, Twin = Grip, FingerTwin
    reads, commands = (pose(),), (wrench(force=8.0),)
    max_stiffness, damping = 5000.0, 0.0
    blocking, period, delay = True, 0.004, 0.002
    def open(self):
        raise NotImplementedError
    def close(self):
        raise NotImplementedError
    def write(self, command):
        raise NotImplementedError
    def read(self, reading):
        raise NotImplementedError
"""
WRONG = f"""
COUNT, DISTANCE, VELOCITY = {layout.RESULT_COUNT}, {layout.RESULT_DISTANCE}, {layout.RESULT_SURFACE_VELOCITY}
SHARE = {layout.RESULT_CONTACTS + layout.CONTACT_SHARE}
"""
WRONG += """

@dataclass(frozen=True, slots=True)
class Asked(Penalty):
    error: str = schema.text(default="", doc="what it does wrong")


class Wrong(PenaltyContact):
    Params = Asked

    def compile(self, name, params, world):
        self.error = params.error
        return super().compile(name, params, world)

    def fields(self, model):
        first, *rest = super().fields(model)
        if self.error == "named":
            rest.append(Field("stiffness", unit="N/m", doc="how stiff it is"))
        return (Field("object", ">f8", unit="1", doc=first.doc) if self.error == "swapped" else first, *rest)

    def contact_fields(self, model):
        said = super().contact_fields(model)
        if self.error == "tuple":
            return tuple(said)
        if self.error == "listed":
            return said._replace(probe=[said.probe])
        if self.error == "fails":
            raise RuntimeError("out of touch")
        if self.error == "twice":
            return said._replace(found="force")
        if self.error == "elsewhere":
            return said._replace(probe="thumb")
        if self.error == "nameless":
            return said._replace(point="")
        return said._replace(force="object") if self.error == "undeclared" else said

    def update(self, model, state, period):
        super().update(model, state, period)
        if state["tick"].item() < 700:
            return
        if self.error == "huge":
            state[f"{model.name}.force"][1] = 1e150
        if self.error == "lets go":
            state[f"{model.name}.object"] = -1.0
        if self.error == "nan":
            state[f"{model.name}.force"][1] = float("nan")
        if self.error == "beyond":
            state[f"{model.name}.object"] = 7.0
        if self.error == "between":
            state[f"{model.name}.object"] = 0.5
        if self.error == "long":
            state[f"{model.name}.normal"] *= 1.1
        if self.error == "pulls":
            state[f"{model.name}.force"] *= -3.0
        if self.error == "raises":
            raise RuntimeError("out of springs")


class WrongProxy(ProxyContact):
    Params = Asked

    def compile(self, name, params, world):
        self.error = params.error
        return super().compile(name, params, world)

    def update(self, model, state, period):
        super().update(model, state, period)
        found = state[f"{model.name}.found"]
        if found[COUNT] == 0.0:
            return
        place = {"count": COUNT, "share": SHARE, "distance": DISTANCE, "velocity": VELOCITY}[self.error]
        found[place] = {"count": 5.0, "share": 2.0, "distance": -0.1, "velocity": 1e200}[self.error]


class SmallProxy(ProxyContact):
    def fields(self, model):
        memory, found = super().fields(model)
        return Field("memory", "f8", 9, unit="mixed", doc=memory.doc), found


class Inward(PenaltyContact):
    def update(self, model, state, period):
        super().update(model, state, period)
        state[f"{model.name}.normal"] *= -1.0


class Away(PenaltyContact):
    def update(self, model, state, period):
        state[f"{model.name}.object"] = -1.0
"""
SEEN = "arm.sent.wrench", "finger.proxy", "finger.point", "finger.penetration", "finger.object", "finger.area"
NUMBERS = itertools.count()


@pytest.fixture
def written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Path]:
    """Return what writes a shipped scene, with an element for each probe that computes its contact."""
    module = f"springs_{next(NUMBERS)}"
    codes = [(HERE / f"{name}_contact.py").read_text(encoding="utf-8") for name in ("penalty", "proxy")]
    code = "\n".join(codes).replace("from __future__ import annotations\n", "") + LATE + WRONG
    classes = {"penalty": "Wrong", "proxy": "ProxyContact", "inward": "Inward", "away": "Away", "unproxy": "WrongProxy"}
    classes["small"] = "SmallProxy"
    listed = "".join(f"mine.{local} = {module}:{cls}\n" for local, cls in classes.items())
    site = install(
        tmp_path / "site",
        "mine",
        f"[itouch.devices]\nmine = {module}:Stylus\n[itouch.modalities]\n{listed}",
        module=module,
        code=code,
    )
    monkeypatch.syspath_prepend(str(site))
    shutil.copytree(SCENES, tmp_path / "scenes")

    def write(scene: str, element: str, *replaced: tuple[str, str]) -> Path:
        text = (SCENES / scene).read_text(encoding="utf-8")
        for old, new in replaced:
            assert old in text
            text = text.replace(old, new)
        probes = re.findall(r'<probe name="(\w+)"', text)
        own = "".join(f'<mine:{element} name="own-{probe}" probe="{probe}"/>' for probe in probes if element)
        text = text.replace("<itouch ", '<itouch xmlns:mine="urn:itouch:plugin:mine" ', 1)
        path = tmp_path / "scenes" / f"{next(NUMBERS)}.xml"
        path.write_text(text.replace("<operator", f"{own}\n<operator", 1), encoding="utf-8")
        return path

    return write


def only_read(array: Any) -> Any:
    """Return an array as a modality has it that only reads it: for others the same is compiled once more."""
    array.flags.writeable = False
    return array


def commands(path: Path, seconds: float) -> list[bytes]:
    """Run a scene, and return what it has sent to devices and found of contacts, tick by tick."""
    session, rows = itouch.build(path), list[bytes]()
    ends = (".contact_force", ".area", ".near_distance", ".result", ".proxy", ".felt_force")
    names = [name for name in session.state if ".sent." in name or name.endswith(ends) or name.startswith("events.")]
    session.taps.append(lambda tick: rows.append(b"".join(session.state[name].tobytes() for name in names)))
    session.run(seconds)
    assert session.report()["faults"] == []
    return rows


@pytest.mark.parametrize(
    ("scene", "seconds"),
    [("first_touch.xml", 2.5), ("mesh.xml", 2.5), ("moving.xml", 2.5), ("two_fingers.xml", 2.5),
     ("texture.xml", 2.5), ("four_materials.xml", 3.0)],
)  # fmt: skip
def test_the_proxy_written_as_a_plugin_gives_the_same_commands_bit_for_bit(
    written: Callable[..., Path], scene: str, seconds: float
) -> None:
    assert commands(written(scene, "proxy"), seconds) == commands(written(scene, ""), seconds)


def test_behind_a_wire_too_where_the_coupling_changes_while_running(written: Callable[..., Path]) -> None:
    wire = 'name="arm" plugin="usb-arm"', 'name="arm" plugin="mine"'
    path = written("first_touch.xml", "proxy", wire)
    assert commands(path, 2.5) == commands(written("first_touch.xml", "", wire), 2.5)
    session = itouch.build(path)
    session.run(1.2)
    assert session.state["finger.coupling.stiffness"].item() < 1100.0  # else the wire has changed nothing


def test_on_a_convex_solid_without_friction_penalty_is_the_same_as_the_proxy(written: Callable[..., Path]) -> None:
    smooth = (' static-friction="0.4"', "")
    found = []
    for element in ("penalty", ""):
        session, rows = itouch.build(written("first_touch.xml", element, smooth)), list[Any]()
        state = session.state
        session.taps.append(lambda tick, s=state, r=rows: r.append(np.concatenate([s[name].ravel() for name in SEEN])))
        session.run()
        found.append((np.array(rows), session.report()["contacts"]))
    (own, told), (proxy, said) = found
    np.testing.assert_allclose(own, proxy, rtol=0, atol=1e-12)
    assert [one["begin_s"] for one in told] == [one["begin_s"] for one in said] != []


def test_the_plan_shows_who_computes_the_contact(written: Callable[..., Path]) -> None:
    plan = Engine(itouch.build(written("first_touch.xml", "proxy")).model).plan
    names = plan.names[2:7]
    assert names == ("follow finger", "fence contacts", "own-finger", "mend contacts", "contact finger")
    assert len(plan.pieces) == 1  # with a compiled update it is all one call


def test_what_it_says_never_pulls(written: Callable[..., Path]) -> None:
    text = written("first_touch.xml", "penalty").read_text().replace("<mine:penalty", '<mine:penalty error="pulls"')
    path = written("first_touch.xml", "")
    path.write_text(text, encoding="utf-8")
    session, least = itouch.build(path), list[float]()
    session.taps.append(lambda tick: least.append(float(session.state["arm.sent.wrench"][2])))
    session.run()
    assert min(least) == 0.0
    assert session.report()["contacts"] != []


@pytest.mark.parametrize(
    ("error", "said"),
    [
        ("nan", "own-finger.object, own-finger.force, own-finger.normal, own-finger.point is not a finite number"),
        ("beyond", "'own-finger.object' names an object that is not there: -1 is none, the last one is 0"),
        ("between", "'own-finger.object' names an object that is not there"),
        ("long", "the normal in 'own-finger.normal' must have the length 1"),
        ("raises", "out of springs"),
        ("huge", "is not a finite number, or beyond 1e+15"),
    ],
)
def test_what_cannot_be_is_a_fault_that_names_the_modality(written: Callable[..., Path], error: str, said: str) -> None:
    path = written("first_touch.xml", "penalty")
    path.write_text(path.read_text().replace("<mine:penalty", f'<mine:penalty error="{error}"'), encoding="utf-8")
    session = itouch.build(path)
    with pytest.raises(itouch.ItouchError) as fault:
        session.run()
    assert "lost its modality 'own-finger'" in str(fault.value)
    assert said in str(fault.value)
    assert (session.state["arm.sent.wrench"] == 0.0).all()


@pytest.mark.parametrize(
    ("error", "said"),
    [
        ("count", "'own-finger.found' has a number of contacts, a share or a distance that no contact can have"),
        ("share", "'own-finger.found' has a number of contacts, a share or a distance that no contact can have"),
        ("distance", "'own-finger.found' has a number of contacts, a share or a distance that no contact can have"),
        ("velocity", "own-finger.found is not a finite number, or beyond 1e+15"),
    ],
)
def test_what_no_step_of_contact_can_find_is_a_fault_that_names_the_modality(
    written: Callable[..., Path], error: str, said: str
) -> None:
    path = written("texture.xml", "unproxy")
    path.write_text(path.read_text().replace("<mine:unproxy", f'<mine:unproxy error="{error}"'), encoding="utf-8")
    session = itouch.build(path)
    with pytest.raises(itouch.ItouchError) as fault:
        session.run()
    assert "lost its modality 'own-finger'" in str(fault.value)
    assert said in str(fault.value)
    assert (session.state["arm.sent.wrench"] == 0.0).all()


def test_a_contact_ends_when_the_modality_says_so_even_inside_the_shape(written: Callable[..., Path]) -> None:
    path = written("first_touch.xml", "penalty")
    path.write_text(path.read_text().replace("<mine:penalty", '<mine:penalty error="lets go"'), encoding="utf-8")
    session = itouch.build(path)
    session.run(1.0)
    assert session.state["finger.hip"][2] < 0.0275  # else it has left the block, whose top is at 20 mm, by itself
    assert [one["end_s"] for one in session.report()["contacts"]] == [pytest.approx(0.72, abs=0.002)]


@pytest.mark.parametrize(
    ("element", "said"),
    [
        ('<mine:penalty probe="finger" error="elsewhere"/>', "the contact of probe 'thumb', but there is no such probe"),
        ('<mine:penalty probe="finger" error="nameless"/>', "computes a contact and names no field for: point"),
        ('<mine:penalty probe="finger" error="undeclared"/>', "'object', which it does not declare as 3 numbers (f8)"),
        ('<mine:penalty probe="finger" name="a"/><mine:penalty probe="finger" name="b"/>',
         "modalities 'a' and 'b' both compute the contact of probe 'finger'"),
        ('<mine:penalty probe="finger" error="tuple"/>',
         "failed in contact_fields: it returned ('finger', 'object', 'force', 'normal', 'point', '', '', False); ContactFields of"),
        ('<mine:penalty probe="finger" error="listed"/>', "failed in contact_fields: it returned ContactFields(probe=['finger']"),
        ('<mine:penalty probe="finger" error="fails"/>', "failed in contact_fields: RuntimeError: out of touch"),
        ('<mine:penalty probe="finger" error="twice"/>', "twice: in field 'force', and in object, force, normal, point"),
        ('<mine:penalty name="finger.coupling" probe="finger" error="named"/>',
         "modality 'finger.coupling' declares 'finger.coupling.stiffness', which is a field of something else, too"),
        ('<mine:penalty probe="finger" error="swapped"/>', "'object', which it does not declare as 1 number (f8)"),
    ],
    ids=["another probe", "a field that is not named", "a field of another size", "two for one probe", "a tuple",
         "no name", "an error", "said twice", "the name of another field", "bytes in another order"],
)  # fmt: skip
def test_a_declaration_that_cannot_be_is_told_before_a_run(
    written: Callable[..., Path], capsys: pytest.CaptureFixture[str], element: str, said: str
) -> None:
    path = written("first_touch.xml", "")
    path.write_text(path.read_text().replace("<operator", f"{element}\n<operator", 1), encoding="utf-8")
    assert main(["check", str(path)]) == 2
    assert said in capsys.readouterr().err


def test_a_rate_of_its_own_is_refused(written: Callable[..., Path], capsys: pytest.CaptureFixture[str]) -> None:
    path = written("first_touch.xml", "penalty")
    text = path.read_text().replace("</itouch>", '<rates servo="1 kHz" own-finger="500 Hz"/></itouch>')
    path.write_text(text, encoding="utf-8")
    assert main(["check", str(path)]) == 2
    assert "is updated in one of 2" in capsys.readouterr().err


SHORT = ("arm", Kind.BIAS), ("peltier", Kind.SATURATED)
CELLS = [(device, kind) for device in ("arm", "table", "peltier") for kind in Kind if kind]


@pytest.mark.parametrize(
    ("device", "kind"), [pytest.param(*cell, marks=() if cell in SHORT else pytest.mark.long) for cell in CELLS]
)
def test_a_fault_in_the_middle_of_a_touch_stops_and_is_armed_anew_alike(
    written: Callable[..., Path], device: str, kind: Kind
) -> None:
    fault = f'<fault device="{device}" kind="{kind.label}" at="9 s" for="0.5 s"/>'  # the finger is on the polystyrene
    both = [
        _armed_anew(written("four_materials.xml", own, ("</itouch>", f"{fault}</itouch>"))) for own in ("proxy", "")
    ]
    assert both[0] == both[1]
    assert len(both[0][0]) > 9000


def _armed_anew(path: Path) -> tuple[list[bytes], list[str]]:
    """Run the scene, arming it anew after each trip; return its commands, and what was said."""
    session, rows, said = itouch.build(path), list[bytes](), list[str]()
    names = [name for name in session.state if ".sent." in name or name.endswith((".contact_force", ".felt_force"))]
    session.taps.append(lambda tick: rows.append(b"".join(session.state[name].tobytes() for name in names)))
    for call in (lambda: session.run(9.4), session.rearm, lambda: session.run(0.8), session.rearm):
        try:
            call()
        except itouch.ItouchError as error:
            said.append(str(error).replace(str(path), "the scene"))
    return rows, said


def test_many_sessions_of_it_run_in_a_batch(written: Callable[..., Path]) -> None:
    found = [
        itouch.batch(written("mesh.xml", own), seeds=(1, 2, 3), until=1.5, collect=_commanded) for own in ("proxy", "")
    ]
    assert found[0] == found[1]
    assert any(any(row) for row in found[0])


def _commanded(session: itouch.Session) -> list[float]:
    return [*session.state["arm.sent.wrench"].tolist(), session.state["finger.area"].item()]


def test_a_session_goes_on_in_the_middle_of_a_touch(written: Callable[..., Path], tmp_path: Path) -> None:
    path = written("mesh.xml", "proxy")
    whole = itouch.build(path)
    whole.run(2.0)
    first = itouch.build(path)
    first.run(1.1)
    first.save(tmp_path / "middle.itouch")
    again = itouch.restore(tmp_path / "middle.itouch")
    again.run(0.9)
    assert again.state.tobytes() == whole.state.tobytes()


@pytest.mark.parametrize("field", ["finger.coupling.stiffness", "finger.coupling.damping"])
def test_a_stored_session_does_not_say_how_stiff_objects_are(
    written: Callable[..., Path], tmp_path: Path, field: str
) -> None:
    session, found = itouch.build(written("first_touch.xml", "proxy")), list[bytes]()
    session.run(0.9)
    for factor in (1.0, 1e6):
        session.state[field] *= factor
        session.save(tmp_path / "middle.itouch")
        again = itouch.restore(tmp_path / "middle.itouch")
        again.run(0.1)
        found.append(again.state.tobytes())
    assert found[0] == found[1]


@pytest.mark.parametrize(("count", "number"), [(1.0, 1e7), (1e6, 0.0), (0.5, 1e7), (float("nan"), 0.0), (1.0, -3.0)])
def test_a_memory_that_no_step_has_written_is_taken_as_none(count: float, number: float) -> None:
    geometry = Geometry.build([Box((0.05, 0.05, 0.05))])
    poses, twists = np.array([[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]]), np.zeros((1, 6))
    read = [only_read(array) for array in (poses, twists, np.array([1000.0]), np.array([0.0, 0.0, 0.055]))]
    found = []
    for forged in (False, True):
        memory, result = geometry.new_memory(), np.zeros(FOUND)
        if forged:
            memory[layout.MEMORY_READY], memory[layout.MEMORY_COUNT] = 1.0, count
            memory[layout.MEMORY_CONTACTS] = number
        proxy_step(geometry.world, geometry.mesh, *read, 0.008, 0.01, memory, result, geometry.new_scratch())
        found.append((memory.tobytes(), result.tobytes()))
    assert found[0] == found[1]
    assert result[layout.RESULT_FORCE + 2] > 0.0


@pytest.mark.parametrize(
    ("small", "said"),
    [("poses", "those of all objects"), ("twists", "those of all objects"), ("stiffness", "those of all objects"),
     ("hip_at", "3 numbers"), ("memory", "memory_size"), ("result", "FOUND"), ("scratch", "new_scratch")],
)  # fmt: skip
def test_an_array_that_is_too_small_is_refused(small: str, said: str) -> None:
    geometry = Geometry.build([Box((0.05, 0.05, 0.05)), Box((0.05, 0.05, 0.05))])
    poses = np.tile([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0], (2, 1))
    arrays: dict[str, Any] = {"poses": poses, "twists": np.zeros((2, 6)), "stiffness": np.array([1000.0, 1000.0])}
    arrays = {name: only_read(array) for name, array in (arrays | {"hip_at": np.array([0.0, 0.0, 0.055])}).items()}
    arrays |= {"memory": geometry.new_memory(), "result": np.zeros(FOUND)}
    arrays["scratch"] = geometry.new_scratch()

    def step() -> int:
        poses, twists, stiffness, hip, memory, result, scratch = arrays.values()
        return proxy_step(
            geometry.world, geometry.mesh, poses, twists, stiffness, hip, 0.008, 0.01, memory, result, scratch
        )

    assert step() == 0
    alone = Geometry.build([Box((0.05, 0.05, 0.05))]).new_scratch()
    arrays[small] = alone if small == "scratch" else arrays[small][:-1]
    with pytest.raises(ValueError, match=said):
        step()


def test_a_memory_that_is_too_small_is_told_before_a_run(written: Callable[..., Path]) -> None:
    with pytest.raises(itouch.SceneError, match=r"'own-finger' failed in update: .*it takes Geometry\.memory_size"):
        itouch.build(written("first_touch.xml", "small"))


@pytest.mark.parametrize("number", [-1, 1, 10**7])
def test_an_object_that_is_not_there_is_nowhere_near(number: int) -> None:
    geometry = Geometry.build([Box((0.05, 0.05, 0.05))])
    poses, point = (
        only_read(np.array(numbers)) for numbers in ([[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]], [0.0, 0.0, 0.06])
    )
    asked = geometry.world, geometry.mesh, poses
    assert point_distance(*asked, 0, point, 1.0, geometry.new_scratch())[0] == pytest.approx(0.01)
    assert point_distance(*asked, number, point, 1.0, geometry.new_scratch())[0] == np.inf


def test_modalities_that_compute_contact_run_in_the_order_of_the_scene(written: Callable[..., Path]) -> None:
    path = written("two_fingers.xml", "")
    own = "".join(f'<mine:proxy name="own-{probe}" probe="{probe}"/>' for probe in ("index", "thumb"))
    path.write_text(path.read_text().replace("<operator", f"{own}<operator", 1), encoding="utf-8")
    names = Engine(itouch.build(path).model).plan.names
    assert names.index("own-index") < names.index("own-thumb") < names.index("contact thumb")


@pytest.mark.parametrize(
    ("local", "outcome", "said"),
    [("penalty", "passed", "own-finger"), ("inward", "failed", "pulls the finger in"),
     ("away", "left out", "nothing is touched")],
)  # fmt: skip
def test_the_conformance_suite_looks_at_what_it_says(
    written: Callable[..., Path], local: str, outcome: str, said: str
) -> None:
    path = written("first_touch.xml", local)
    cls = Catalog().modality("mine", local)
    assert cls is not None
    finding = touches.examine(ModalityHarness(cls, path))
    assert (finding.outcome, said in finding.note) == (outcome, True), finding.note


def test_inspect_shows_the_contact_of_a_modality(
    written: Callable[..., Path], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["inspect", str(written("first_touch.xml", "penalty")), "--plan", "--json"]) == 0
    steps = {step["step"]: step for step in json.loads(capsys.readouterr().out)["steps"]}
    assert "own-finger.object" in steps["contact finger"]["reads"]


@pytest.mark.parametrize("element", ["penalty", "proxy"])
def test_other_names_for_all_channels_and_fields_change_nothing(written: Callable[..., Path], element: str) -> None:
    path, rows = written("first_touch.xml", element), list[list[bytes]]()
    for catalog in (None, RenamedCatalog(seed=5)):
        session, seen = itouch.build(path, catalog=catalog), list[bytes]()
        force = session.state["finger.contact_force"]
        session.taps.append(lambda tick, force=force, seen=seen: seen.append(force.tobytes()))
        session.run(1.5)
        rows.append(seen)
    assert rows[0] == rows[1]


@pytest.mark.parametrize("element", ["penalty", "proxy"])
def test_where_there_is_no_object_nothing_is_touched(written: Callable[..., Path], element: str) -> None:
    path = written("first_touch.xml", element)
    text, count = re.subn(r"<box[^>]*/>", "", path.read_text())
    assert count == 1
    path.write_text(text, encoding="utf-8")
    session = itouch.build(path)
    session.run(0.1)
    assert session.state["finger.object"].item() == -1
    assert session.report()["faults"] == []
