"""The suite on modalities: a touch is always there, bad ones are found by name, good ones are not blamed."""

from __future__ import annotations

import random
import time
from dataclasses import dataclass, replace

import numpy as np
import pytest

from itouch.plugin import Field, Modality, schema
from itouch.plugin.discovery import Catalog
from itouch.scene import loads
from itouch.testing.checks import examine
from itouch.testing.harness import KnownCatalog
from itouch.testing.scenario import FINGER, ModalitySubject, made
from itouch.testing.suites import MODALITY_CHECKS

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
class CounterSubject(ModalitySubject):
    """A counter in a scene that is made for it."""

    @property
    def catalog(self):
        catalog = CounterCatalog(dict(super().catalog._known))
        catalog.cls = self.cls
        return catalog


def subject(cls: type[Modality]) -> CounterSubject:
    return CounterSubject(cls, name="counter.count")


@pytest.mark.parametrize(("cls", "check"), BAD.items(), ids=[cls.__name__ for cls in BAD])
def test_a_bad_modality_is_caught_by_name(cls, check):
    finding = CHECKS[check].examine(subject(cls))
    assert finding.outcome == "failed", finding.note
    assert "likely cause:" in finding.note


def test_a_good_modality_is_not_blamed():
    documented = type("Documented", (Counter,), {"__doc__": "Counts.", "__module__": __name__})
    blamed = [
        f"{f.check.name}: {f.note}" for f in examine(MODALITY_CHECKS, subject(documented)) if f.outcome == "failed"
    ]
    assert not blamed


@pytest.mark.parametrize("name", ["thermal.heat", "thermal.flux-control"])
def test_a_scene_is_made_for_the_modalities_that_are_bundled(name):
    catalog = KnownCatalog(dict(ModalitySubject(Counter).catalog._known))
    scene = loads(made(name, catalog).encode(), catalog)
    assert any(device.plugin == FINGER for device in scene.devices)
    assert name.split(".")[1] in [part.name for part in scene.modalities]


def test_a_scene_without_a_touch_gets_one():
    """The operator's motion is replaced where it touches nothing, so that a touch begins, slides and ends."""
    one = subject(Counter)
    text = made("counter.count", one.catalog).replace('pos="-40 0 25 mm"', 'pos="-40 0 60 mm"')
    still = replace(one, scene=text.replace('pos="25 0 25 mm"', 'pos="25 0 60 mm"'))
    engine = still.engine()
    engine.run(still.seconds)
    contacts = engine.report()["contacts"]
    assert contacts and contacts[0]["end_s"] is not None


def test_the_catalog_of_the_suite_has_the_finger_only_there():
    assert FINGER not in Catalog().device_names
