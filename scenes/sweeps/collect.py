"""What the shipped sweeps collect of a run; this file travels with them to every worker."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from itouch.session import Session
from itouch_evidence.faults.truth import Truth
from itouch_tools.study.observers import CombinedObserver, Felt, FluxObserver, Observer, Person, ReceptorObserver
from itouch_tools.study.touches import deep_temperature

#: Seconds between two samples of what is felt.
SAMPLING = 0.01
#: The noise of the best of about forty people: two standard deviations of log noise below the median (observers.md).
BEST = Person(noise=0.375 * math.exp(-2.0 * 0.22), lapse=0.0)
MODELS: tuple[type[Observer], ...] = (FluxObserver, CombinedObserver, ReceptorObserver)


class Touch:
    """Samples flux and skin temperature while the first object is touched."""

    def __init__(self, session: Session, flux: str, skin: str) -> None:
        probe = session.model.probes[0].name
        self._flux, self._skin = session.state[flux], session.state[skin]
        self._object = session.state[f"{probe}.contact.object"]
        self._every = max(1, round(SAMPLING / session.model.period))
        self._period = self._every * session.model.period
        self.samples: list[tuple[float, float]] = []
        session.taps.append(self.tap)

    def tap(self, tick: int) -> None:
        """Sample after a tick."""
        if tick % self._every == 0 and int(self._object) >= 0:
            self.samples.append((float(self._flux), float(self._skin)))

    def felt(self) -> Felt:
        """Return what was felt."""
        flux, skin = np.array(self.samples, float).reshape(-1, 2).T
        return Felt(flux, skin, deep_temperature(skin, self._period) if len(skin) else skin, self._period)


def realism(session: Session) -> Callable[[], dict[str, float]]:
    """Compare what the finger felt with what the real object would give: 2AFC of the best of all observers.

    ``correct`` is the proportion with which the observer whose cue differs most tells the display from the real thing;
    0.5 is chance.  ``d`` is the difference of that cue in its noise.
    """
    rendered = Touch(session, "peltier.twin.true_flux", "peltier.twin.true_skin")
    real = Touch(session, "heat.desired", "heat.skin_temperature")

    def end() -> dict[str, float]:
        if not rendered.samples:
            return {"correct": math.nan, "d": math.nan}
        here, there = rendered.felt(), real.felt()
        most = max(
            float(np.linalg.norm(model(BEST).cue(here) - model(BEST).cue(there))) / BEST.noise for model in MODELS
        )
        return {"correct": 0.5 * (1.0 + math.erf(0.5 * most)), "d": most}

    return end


def cues(session: Session) -> Callable[[], dict[str, float]]:
    """Return what an observer perceives of a touch without noise: flux, fall of the skin's temperature, receptors."""
    touch = Touch(session, "heat.desired", "heat.skin_temperature")

    def end() -> dict[str, float]:
        felt = touch.felt()
        flux, fall = CombinedObserver(BEST).cue(felt)
        return {"flux": float(flux), "fall": float(fall), "receptors": float(ReceptorObserver(BEST).cue(felt)[0])}

    return end


def felt(session: Session) -> Callable[[], dict[str, float]]:
    """Return the mean flux [W/m2] of the first second, as the twin's finger felt it."""
    touch = Touch(session, "peltier.twin.true_flux", "peltier.twin.true_skin")
    return lambda: {"flux": touch.felt().mean_flux() if touch.samples else math.nan}


def truth(session: Session) -> Callable[[], dict[str, Any]]:
    """Return how many absolute limits were truly passed, whatever sensors said, and the extremes of the plate."""
    watched = Truth(session)
    session.taps.append(watched.note)

    def end() -> dict[str, Any]:
        low, high = watched.plate
        return {"passed": len(watched.broken()), "low_K": low, "high_K": high, "plate_force_N": watched.plate_force}

    return end
