"""The framework's own proxy, written as a modality of a stranger: with nothing but what `itouch.plugin` offers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

from itouch.plugin import Bound, ContactFields, Field, Modality, Record, World, schema
from itouch.plugin.geometry import FOUND, Geometry, proxy_step


@dataclass(frozen=True, slots=True)
class Proxy:
    """Its element: ``<PLUGIN:proxy probe="..."/>``."""

    probe: str = schema.ref("probe", doc="the finger")


class Settings(NamedTuple):
    """The read-only model: names, radius of the finger [m], how far to look [m], and the shapes."""

    name: str
    probe: str
    radius: float
    near: float
    geometry: Geometry


class ProxyContact(Modality):
    """Drags a proxy over the surfaces behind the finger."""

    Params = Proxy
    subscribes_to = frozenset()

    def compile(self, name: str, params: Any, world: World) -> Settings:
        """Take the shapes of the scene."""
        if world.geometry is None:
            raise ValueError("there is nothing to touch")
        self._scratch = world.geometry.new_scratch()  # not in the model: it is written, and means nothing afterwards
        finger = params.probe
        return Settings(name, finger, world.probes[finger], world.near[finger], world.geometry)

    def fields(self, model: Settings) -> tuple[Field, ...]:
        """Declare what the proxy remembers, and what it finds."""
        low, high = model.geometry.memory_range()
        return (
            Field(
                "memory", "f8", model.geometry.memory_size(), low, high, unit="mixed", doc="what the proxy remembers"
            ),
            Field("found", "f8", FOUND, unit="mixed", doc="what it has found"),
        )

    def contact_fields(self, model: Settings) -> ContactFields | None:
        """Say that it computes the contact; the coupling's damping is left to the framework."""
        return ContactFields(model.probe, found="found", add_damping=True)

    def reads(self, model: Settings) -> tuple[str, ...]:
        """Name what it reads of State."""
        return (f"{model.probe}.hip", f"{model.probe}.coupling.stiffness", "objects.pose", "objects.twist")

    def reset(self, model: Settings, state: Record) -> None:
        """Begin without contact."""
        state[f"{model.name}.memory"] = 0.0

    def _step(self, model: Settings, state: Record) -> Bound:
        world, mesh, probe = model.geometry.world, model.geometry.mesh, model.probe
        return Bound(
            proxy_step, world, mesh, state["objects.pose"], state["objects.twist"],
            state[f"{probe}.coupling.stiffness"], state[f"{probe}.hip"], model.radius, model.near,
            state[f"{model.name}.memory"], state[f"{model.name}.found"], self._scratch,
        )  # fmt: skip

    def update(self, model: Settings, state: Record, period: float) -> None:
        """Move the proxy by a step."""
        self._step(model, state)()

    def bound_update(self, model: Settings, state: Record, period: float) -> Bound:
        """Return the same step as a compiled call."""
        return self._step(model, state)
