"""The twin of an instrumented sample: finger, film and sample, stepped by the live solver, and four sensors."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from contact_heat.layers import ROOM, Back, Film, Initial, Side
from itouch.plugin import Field, Record, Role, Twin, TwinInputs, gaussian
from itouch_thermal.display.column import Array
from itouch_thermal.film.film_params import WOOD, FilmParams
from itouch_thermal.heat import FINGER, finger_side
from itouch_thermal.laws import law_of, press_factor

#: Indices in ``memory``: time in the phase, whether it touches, number of touches begun, force of this touch, last flux
#: and face temperature, states of the lagging sensors, time since the start, and present force.
TIME, TOUCHING, COUNT, WANTED, FLUX, FACE, FLUX_LAG, FILM_LAG, CLOCK, FORCE, MEMORY = range(11)
#: Time constant with which the finger's force rises [s].
_RISE = 0.02


def sample_side(params: FilmParams, ambient: float) -> Side:
    """Return the sample under its film, at rest at the room's temperature [K]; air is behind it if it has an end."""
    layers = params.sample or (WOOD,)
    ends = layers[-1].thickness is not None
    return Side(
        layers=(params.film, *layers),
        initial=Initial(kind="uniform", temperature=ambient),
        back=Back(kind="convection", temperature=ambient, coefficient=10.0) if ends else None,
        air=Film(coefficient=params.recovery, ambient=ambient),
    )


class FilmTwin(Twin):
    """A finger that touches a sample repeatedly, with pauses."""

    params: Any

    def __init__(self, params: FilmParams) -> None:
        super().__init__(params)
        self._ambient = ROOM
        self._law = law_of(params.laws, params.contact_resistance)
        self._built: dict[float, tuple[Array, Array, Array, Array]] = {}

    def set_environment(self, ambient: float, skin_temperature: float | None) -> None:
        """Set the room's temperature [K]; the finger is the twin's own."""
        self._ambient = ambient
        self._built.clear()

    def _for(self, period: float) -> tuple[Array, Array, Array, Array]:
        """Return both models and their states at rest for a step of a period [s]; built once each."""
        from contact_heat import live

        if period not in self._built:
            p = self.params
            finger = finger_side(p.tissue or FINGER, p.core, p.skin_temperature, self._ambient)
            body = sample_side(p, self._ambient)
            self._built[period] = (
                live.side_model(finger, period, finger=True), live.side_model(body, period, finger=False),
                live.initial_state(finger, period, finger=True), live.initial_state(body, period, finger=False),
            )  # fmt: skip
        return self._built[period]

    def fields(self) -> tuple[Field, ...]:
        """Return the State: modes, phase and sensors."""
        _, _, skin, body = self._for(1e-3)
        return (
            Field("true_flux", unit="W/m^2", role=Role.HEAT_FLUX, doc="true flux out of the finger", show="no"),
            Field("finger", "f8", 2 * len(skin), unit="K", doc="modes of the finger"),
            Field("sample", "f8", 2 * len(body), unit="K", doc="modes of film and sample"),
            Field("begun", "i8", low=0, high=1, unit="1", doc="1 once the modes are those of rest"),
            Field("memory", "f8", MEMORY, unit="mixed", doc="phase, forces and sensors"),
            Field("noise", "u8", 1, unit="1", doc="word of the noise generator"),
        )

    def reset(self, state: Record, rng: np.random.Generator) -> None:
        """Start at rest."""
        state["begun"] = 0
        state["true_flux"] = 0.0
        state["memory"][:] = 0.0
        state["memory"][[FACE, FILM_LAG]] = self._ambient
        state["noise"] = rng.integers(0, 1 << 63)

    def step(self, state: Record, command: Record, touch: TwinInputs, period: float) -> None:
        """Advance by one period [s]."""
        from contact_heat import live

        p, memory = self.params, state["memory"]
        above, below, rest, still = self._for(period)
        skin, body = state["finger"][: len(rest)], state["sample"][: len(still)]
        if not state["begun"].item():
            skin[:], body[:] = rest, still
            state["begun"] = 1
        if self._phase(state, period) and p.recovers:
            skin[:], body[:] = rest, still
            memory[FLUX], memory[FACE], memory[FILM_LAG] = 0.0, self._ambient, self._ambient
        before, face = memory[FLUX].item(), memory[FACE].item()
        if memory[TOUCHING].item():
            time = memory[TIME].item()
            force = memory[WANTED].item() * -math.expm1(-time / _RISE)
            resistance = self._law.at(memory[WANTED].item()) * press_factor(time, p.press)
            flux = float(live.contact_step(above, skin, below, body, resistance))
            into = 0.5 * (flux + before) if before else flux
        else:
            live.air_step(above, skin)
            live.air_step(below, body)
            force, flux = 0.0, 0.0
            into = p.recovery * (self._ambient - face)
        now = float(live.surface_temperature(below, body))
        # The film measures the flux at its middle: the flux that entered less the heat kept by its upper half.
        seen = into - 0.5 * p.film_capacity * (now - face) / period
        memory[FLUX], memory[FACE], memory[FORCE] = flux, now, force
        memory[FLUX_LAG] += _share(period, p.flux_lag) * (seen - memory[FLUX_LAG])
        memory[FILM_LAG] += _share(period, p.film_lag) * (now - memory[FILM_LAG])
        memory[CLOCK] += period
        state["true_flux"] = flux

    def _phase(self, state: Record, period: float) -> bool:
        """Begin and end touches; return whether one has just ended."""
        p, memory = self.params, state["memory"]
        memory[TIME] += period
        touching = bool(memory[TOUCHING].item() > 0.0)
        over = memory[TIME].item() >= (p.hold if touching else p.pause) - 0.5 * period
        if not over or (not touching and memory[COUNT].item() >= p.touches):
            return False
        memory[TIME] = 0.0 if touching else period
        memory[TOUCHING] = 0.0 if touching else 1.0
        if not touching:
            memory[COUNT] += 1.0
            memory[WANTED] = p.force * max(0.2, 1.0 + p.force_spread * gaussian(state, "noise"))
        return touching

    def read(self, state: Record, reading: Record) -> bool | None:
        """Write the sensors' readings; every call draws new noise."""
        p, memory = self.params, state["memory"]
        drifted = p.flux_bias + p.flux_drift * memory[CLOCK].item()
        flux = memory[FLUX_LAG].item() + drifted + p.flux_noise * gaussian(state, "noise")
        reading["heat_flux"] = min(p.full_scale, max(-p.full_scale, flux))
        film = memory[FILM_LAG].item() + p.film_noise * gaussian(state, "noise")
        if p.has_thermometer:
            reading["film_temperature"] = film
        reading["wrench"][:] = 0.0
        reading["wrench"][2] = -memory[FORCE].item() - p.force_noise * gaussian(state, "noise")
        clear = memory[TOUCHING].item() == 0.0
        reading["skin_valid"] = float(clear)
        if clear:
            reading["skin_temperature"] = self._skin(state) + p.skin_noise * gaussian(state, "noise")
        return True

    def _skin(self, state: Record) -> float:
        from contact_heat import live

        if not state["begun"].item():
            return float(self.params.skin_temperature)
        period = next(iter(sorted(self._built, reverse=True)))
        above, _, rest, _ = self._built[period]
        return float(live.surface_temperature(above, state["finger"][: len(rest)]))


def _share(period: float, lag: float) -> float:
    return -math.expm1(-period / lag) if lag > 0.0 else 1.0
