"""The suite on modalities: a touch is always there, bad ones are found by name, good ones are not blamed."""

from __future__ import annotations

import random
import time
from dataclasses import dataclass, replace

import numpy as np
import pytest
from shipped import SCENES
from slider import Slider, SliderTwin

from itouch.plugin import Contact, Field, Modality, schema
from itouch.plugin.discovery import Catalog
from itouch.scene import load, loads
from itouch.testing.checks import examine
from itouch.testing.harness import KnownCatalog
from itouch.testing.scenario import FINGER, ModalityHarness, made
from itouch.testing.suites import MODALITY_CHECKS
from itouch_thermal import Heat

CHECKS = {check.name: check for check in MODALITY_CHECKS}
LAST = [0.0]


@dataclass(frozen=True)
class CounterParams:
    """What <counter:count .../> may hold."""

    probe: str = schema.ref("probe", doc="the probe")


class Counter(Modality):
    """Counts its updates."""

    Params = CounterParams

    def compile(self, name, params, world):
        return {"name": name}

    def fields(self, model):
        return (Field("x", unit="1", doc="a number"),)

    def reset(self, model, state):
        state[f"{model['name']}.x"] = 0.0

    def update(self, model, state, period):
        state[f"{model['name']}.x"] += period


class DrivesAnother(Counter):
    def update(self, model, state, period):
        state["suite.command.wrench"][2] = 1.0


class KeepsItsState(Counter):
    def update(self, model, state, period):
        LAST[0] += 1.0
        state[f"{model['name']}.x"] = LAST[0]


class ThrowsDice(Counter):
    def update(self, model, state, period):
        state[f"{model['name']}.x"] = random.random()


class ReportsNaN(Counter):
    def measures(self, model, state, probe, object_index):
        return {"x": float("nan")}


class WaitsInItsUpdate(Counter):
    def update(self, model, state, period):
        time.sleep(0.001)


class PreparesForEachState(Counter):
    """Makes ready what works on the views of a State when it first meets that State, for a few milliseconds."""

    def __init__(self):
        self.met = {}

    def update(self, model, state, period):
        end = time.thread_time() + 0.003
        while id(state) not in self.met and time.thread_time() < end:
            pass
        self.met[id(state)] = state
        super().update(model, state, period)


class PrintsEvents(Counter):
    def on_contact(self, event, model, state):
        print(event)


class KeepsAView(Counter):
    def reset(self, model, state):
        model["view"] = state[f"{model['name']}.x"]

    def update(self, model, state, period):
        model["view"][...] += period


class WritesInItsModel(Counter):
    def update(self, model, state, period):
        model["k"] = model.get("k", 0) + 1
        state[f"{model['name']}.x"] = model["k"]


class IsNaNInContact(Counter):
    def on_contact(self, event, model, state):
        state[f"{model['name']}.x"] = np.nan


class SwallowsEverything(Counter):
    def update(self, model, state, period):
        try:
            super().update(model, state, period)
        except BaseException:
            return


BAD = {
    DrivesAnother: "own-fields", KeepsItsState: "state-declared", ThrowsDice: "determinism", ReportsNaN: "measures",
    WaitsInItsUpdate: "opens-nothing", PrintsEvents: "quiet", KeepsAView: "uses-given-state",
    WritesInItsModel: "state-declared", IsNaNInContact: "runs", SwallowsEverything: "errors-come-through",
}  # fmt: skip


class CounterCatalog(KnownCatalog):
    """The plugins of this environment, and the counter."""

    cls: type[Modality] = Counter

    @property
    def plugin_names(self):
        return [*super().plugin_names, "counter"]

    def modality_names(self, plugin):
        return ["count"] if plugin == "counter" else super().modality_names(plugin)

    def modality(self, plugin, local):
        return self.cls if plugin == "counter" else super().modality(plugin, local)


@dataclass(frozen=True)
class CounterHarness(ModalityHarness):
    """A counter in a scene that is made for it."""

    @property
    def catalog(self):
        catalog = CounterCatalog(dict(super().catalog._known))
        catalog.cls = self.cls
        return catalog


def harness(cls: type[Modality]) -> CounterHarness:
    return CounterHarness(cls, name="counter.count")


@pytest.mark.parametrize(("cls", "check"), BAD.items(), ids=[cls.__name__ for cls in BAD])
def test_a_bad_modality_is_caught_by_name(cls, check):
    finding = CHECKS[check].examine(harness(cls))
    assert finding.outcome == "failed", finding.note
    assert "likely cause:" in finding.note


def test_a_good_modality_is_not_blamed():
    documented = type("Documented", (Counter,), {"__doc__": "Counts.", "__module__": __name__})
    blamed = [
        f"{f.check.name}: {f.note}" for f in examine(MODALITY_CHECKS, harness(documented)) if f.outcome == "failed"
    ]
    assert not blamed


class HearsBegins(Counter):
    """Counts touches, and wants to hear of nothing else."""

    subscribes_to = frozenset((Contact.BEGIN,))

    def on_contact(self, event, model, state):
        state[f"{model['name']}.x"] += 1.0


TWICE = """<to pos="-40 0 25 mm" in="0.3 s"/><to pos="-40 0 45 mm" in="0.2 s"/>
        <to pos="-40 0 25 mm" in="0.3 s"/><to pos="-20 0 25 mm" in="0.3 s"/><to pos="-20 0 45 mm" in="0.3 s"/>"""


def test_one_that_hears_beginnings_alone_is_not_blamed_for_two_of_them():
    one = harness(HearsBegins)
    head, rest = made("counter.count", one.catalog).split("<motion>", 1)
    scene = f"{head}<motion>{TWICE}</motion>{rest.split('</motion>', 1)[1]}"
    finding = CHECKS["order"].examine(replace(one, scene=scene))
    assert finding.outcome == "passed", finding.note


class LiftTwin(SliderTwin):
    """Goes up and down alone."""

    def step(self, state, command, touch, period):
        if touch.finger_attached:
            state["place"] = (0.0, 0.0, touch.finger_pose[2])


class Lift(Slider):
    """An arm with one axis."""

    Twin = LiftTwin


class LiftHarness(CounterHarness):
    """A counter beside an arm with one axis."""

    @property
    def catalog(self):
        catalog = CounterCatalog({**super().catalog._known, "lift": Lift})
        catalog.cls = self.cls
        return catalog


def test_a_touch_that_cannot_slide_is_not_called_none():
    """An arm with one axis touches and lets go, but slides over nothing."""
    one = LiftHarness(Counter, name="counter.count")
    text = made("counter.count", one.catalog).replace('plugin="suite-finger"', 'plugin="lift"')
    finding = CHECKS["order"].examine(replace(one, scene=text.replace('pos="-30 0 10 mm"', 'pos="0 0 10 mm"')))
    assert finding.outcome == "left out"
    assert "no touch in the scene begins, slides and ends" in finding.note


def test_what_is_prepared_once_for_a_state_is_no_slow_update():
    """A session has one State as long as it lives: what a modality prepares for its views is done once."""
    finding = CHECKS["timing"].examine(harness(PreparesForEachState))
    assert finding.outcome == "passed", finding


@pytest.mark.parametrize("name", ["thermal.heat", "thermal.flux-control"])
def test_a_scene_is_made_for_the_modalities_that_are_bundled(name):
    catalog = KnownCatalog(dict(ModalityHarness(Counter).catalog._known))
    scene = loads(made(name, catalog).encode(), catalog)
    assert any(device.plugin == FINGER for device in scene.devices)
    assert name.split(".")[1] in [part.name for part in scene.modalities]


def test_a_scene_without_a_touch_gets_one():
    """The operator's motion is replaced where it touches nothing, so that a touch begins, slides and ends."""
    one = harness(Counter)
    text = made("counter.count", one.catalog).replace('pos="-40 0 25 mm"', 'pos="-40 0 60 mm"')
    still = replace(one, scene=text.replace('pos="25 0 25 mm"', 'pos="25 0 60 mm"'))
    engine = still.engine()
    engine.run(still.seconds)
    contacts = engine.report()["contacts"]
    assert contacts and contacts[0]["end_s"] is not None


def test_the_catalog_of_the_suite_has_the_finger_only_there():
    assert FINGER not in Catalog().device_names


def test_in_a_scene_of_hardware_a_modality_is_examined_on_the_twins() -> None:
    """Nothing moves or heats for it, and nobody is asked to hold a switch."""
    harness = ModalityHarness(Heat, SCENES / "four_materials_wire.xml", name="thermal.heat")
    assert not any(device.twin for device in load(SCENES / "four_materials_wire.xml", Catalog()).devices)
    assert harness.seconds > 0.0
    assert all(device.twin for device in harness.engine().model.devices.values())
