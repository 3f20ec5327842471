"""Before the touch: which object the finger approaches, the plate's start temperature for it, and when it is ready.

With ``equalise`` the plate is ready after the same time for every object, long enough for the longest switch: neither
a delay nor its absence reveals the material.  (What the table does before a touch depends on finger and shape alone.)
"""

from __future__ import annotations

import math

import numpy as np

from itouch.plugin import Record
from itouch_thermal.display.column import F_PORT
from itouch_thermal.flux.aiming import READY, TOUCHED, aim_at, judged, neutral
from itouch_thermal.flux.onset import converted
from itouch_thermal.flux.setting import FluxModel


def coming(model: FluxModel, state: Record) -> int:
    """Return the object that the plate will render, -1: none; it is the one below, even if a taller one is nearer."""
    names = model.names
    near: int = state[names.near_object].item()
    below: int = state[names.below].item()
    return below if near >= 0 and below >= 0 else near


def aim(model: FluxModel, state: Record, index: int, tick: int) -> None:
    """Aim for the object that the finger approaches; if nothing is known of its heat, the start temperature stays."""
    names = model.names
    state[names.preset_begun] = tick
    if index < 0:
        return
    state[names.approached] = index
    wanted = _wanted(model, state, index)
    if wanted is not None:
        _set(model, state, wanted)


def equal(model: FluxModel, state: Record, period: float) -> None:
    """Aim for the skin's temperature during calibration, so that a plate that is felt then does not cool the finger."""
    names, valid = model.names, model.skin_valid
    seen = bool(model.skin_from) and (not valid or state[valid].item() >= 0.5)
    state[names.approached] = -1
    wanted = neutral(
        state[names.calm].reshape(1), state[names.looked].reshape(1), state[names.covered], model.finger.tissue,
        model.finger.resting_flux, state[model.skin_from].item() if seen else math.nan, model.skin,
        on_plate(model, state), model.expected, period, model.lead,
    )  # fmt: skip
    _set(model, state, wanted)


def on_plate(model: FluxModel, state: Record) -> bool:
    """Tell whether the finger is on the plate: by the measured force, else as the virtual contact says."""
    if model.force_from:
        return bool(abs(state[model.force_from][2].item()) > TOUCHED)
    return model.in_contact(state)


def follow(model: FluxModel, state: Record, tick: int) -> None:
    """Renew the start temperature for the near object now and then, as it and the skin recover from the last touch."""
    if tick % model.again >= model.hold:
        return
    wanted = _wanted(model, state, state[model.names.approached].item())
    if wanted is not None and abs(wanted - state[model.names.start_temperature].item()) > READY / 2.0:
        _set(model, state, wanted)


def _wanted(model: FluxModel, state: Record, index: int) -> float | None:
    """Return the start temperature [K] for an object, as warm as it and the skin are now; None: it is unknown."""
    return model.start(index, _skin(model, state), model.warmed(index, state))


def _skin(model: FluxModel, state: Record) -> float:
    """Return the skin's temperature [K]: as read, else that of the model finger, or without one that of the scene."""
    if model.skin_from and not (model.maybe_blind and state[model.skin_valid].item() < 0.5):
        return float(state[model.skin_from].item())
    if not model.heat or model.law is None or model.preview is None:
        return model.skin
    column, modes = model.law.fine, np.empty(len(model.preview.into))
    converted(model.preview.into, state[model.names.finger], modes)
    return float(column.rest + column.tissue[F_PORT] @ modes)


def _set(model: FluxModel, state: Record, wanted: float) -> None:
    names, (low, high) = model.names, model.band
    aim_at(state[names.start_temperature].reshape(1), state[names.plate_limited].reshape(1), wanted, low, high)


def judge(model: FluxModel, state: Record, error: float, tick: int) -> None:
    """Write the readiness of a plate that differs from its start temperature by an error [K]."""
    names = model.names
    passed = 1.0
    if model.preset_time > 0.0:
        passed = (tick - state[names.preset_begun].item()) * model.period / model.preset_time
    readiness = judged(error, passed)
    state[names.readiness] = readiness
    state[names.plate_ready] = int(readiness >= 1.0)
