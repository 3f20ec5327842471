"""A study led by another program, which sets what is touched, gives the signal, waits, reads what was felt, and marks.

Requests come in through the server and are carried out between two ticks, one at a time.  On the virtual clock time
passes only while a caller waits for something, so that the same requests give the same answers.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from itouch.loop import Clock, DeviceFaultError
from itouch.plugin import DeviceError, Role
from itouch.plugin.discovery import Catalog
from itouch.schema import ItouchError, SceneError
from itouch.session import SessionError
from itouch_tools.study.answer_sources import Stopped
from itouch_tools.study.machine import Sensed
from itouch_tools.study.reading import StudyFile
from itouch_tools.study.scene_switching import SceneSwitcher
from itouch_tools.study.server import Request, StudyServer
from itouch_tools.study.touches import felt_by, figures

#: Longest wait [s] that a caller may ask for, and how long [s] the server is watched in one go while time stands still.
LONGEST_WAIT, REST = 3600.0, 0.1


class AskedError(ItouchError, ValueError):
    """A request that can't be carried out, with a code and a sentence."""

    def __init__(self, code: str, sentence: str) -> None:
        super().__init__(sentence)
        self.code = code


@dataclass(frozen=True, slots=True)
class Waiting:
    """A request that is answered when ``so`` is true, or at the time ``until`` [s] of the servo's clock."""

    request: Request
    so: Callable[[Sensed], bool]
    until: float
    what: str


class Served:
    """Runs the scenes of a study as callers ask.

    Parameters
    ----------
    file, catalog
        The study, whose factors and staircases can be set.
    server
        The server through which requests come in.
    clock
        The loop's clock.
    seed
        Seed of the twins' noise.

    Raises
    ------
    SceneError, SessionError
        If the first condition can't be presented.
    """

    def __init__(self, file: StudyFile, catalog: Catalog, server: StudyServer, *, clock: Clock, seed: int = 0) -> None:
        self._file, self.server, self._virtual = file, server, clock.pace != "real"
        self.switcher = SceneSwitcher(file, catalog, seed=seed, clock=clock)
        self.switcher.on_wait = self._waited
        self._levels = self._first()
        self.switcher.prepare(self._levels)
        self._went = False
        self._waits: list[Waiting] = []
        self._outside: Callable[[], None] | None = None
        self.ended = False
        self._words: Mapping[str, Callable[[Request], None]] = {
            "describe": self._describe, "set": self._set, "go": self._go, "wait": self._wait,
            "now": self._now, "felt": self._felt, "mark": self._mark, "stop": self._stop,
        }  # fmt: skip

    def _first(self) -> dict[str, str]:
        """Return the first condition: what is touched until something is set."""
        study = self._file.study
        first = self._file.conditions()[0] if study.factors else {}
        return {**first, **{one.name: f"{one.standard:.9g}" for one in study.staircases}}

    def run(self) -> None:
        """Carry out requests until somebody asks for the end.

        Raises
        ------
        DeviceFaultError
            If a device failed; it was made safe, and all waiting callers were told.
        """
        try:
            self.switcher.begin()
            while not self.ended:
                if self._virtual and not self._waits:
                    self._look(REST)
                else:
                    self.switcher.run(self._step)
                if self._outside is not None:
                    act, self._outside = self._outside, None
                    act()
        except DeviceFaultError as error:
            self._tell_all("fault", str(error))
            raise
        finally:
            self._tell_all("ended", "the served study has ended")
            self.switcher.close()

    def end(self) -> None:
        """Ask for the end; may be called from a signal handler."""
        self.ended = True

    def _step(self) -> bool:
        """Do what is due after a tick; return whether the loop must pause or end."""
        if self._waits:
            self._meet(self.switcher.sensed())
        self._look(0.0)
        return self.ended or self._outside is not None or (self._virtual and not self._waits)

    def _meet(self, sensed: Sensed) -> None:
        """Answer callers whose wait is met or has run out, and drop those who have gone."""
        for one in list(self._waits):
            gone = one.request.caller.gone
            so = not gone and one.so(sensed)
            over = one.what == "contact" and sensed.over and self._went
            if gone or so or over or sensed.seconds >= one.until:
                self._waits.remove(one)
                if not gone:
                    self.server.answer(one.request, met=so, **self._told(sensed))

    def _look(self, rest: float) -> None:
        request = self.server.look(rest)
        if request is None:
            return
        act = self._words.get(request.what)
        if act is None:
            self.server.refuse(
                request, "unknown-word", f"there is no '{request.what}'; words: {', '.join(self._words)}"
            )
            return
        self._guarded(act, request)

    def _guarded(self, act: Callable[[Request], None], request: Request) -> None:
        try:
            act(request)
        except AskedError as error:
            self.server.refuse(request, error.code, str(error))
        except SceneError as error:
            self.server.refuse(request, "bad-level", "; ".join(problem.sentence for problem in error.problems))
        except (DeviceFaultError, DeviceError):
            raise
        except (ItouchError, ValueError, TypeError, KeyError) as error:
            self.server.refuse(request, "refused", str(error) or type(error).__name__)

    def _tell_all(self, code: str, sentence: str) -> None:
        for one in self._waits:
            self.server.refuse(one.request, code, sentence)
        self._waits.clear()

    def _describe(self, request: Request) -> None:
        study = self._file.study
        self.server.answer(
            request, study=self._file.name, object=study.contact.object_, period_s=self.switcher.session.model.period,
            pace="fast" if self._virtual else "real",
            factors={factor.name: list(factor.names) for factor in study.factors},
            staircases={one.name: {"low": one.low, "high": one.high, "unit": one.unit} for one in study.staircases},
            levels=dict(self._levels),
        )  # fmt: skip

    def _set(self, request: Request) -> None:
        """Arrange for other levels to be presented, outside the loop; those that are not named stay."""
        given = request.given.get("levels")
        if not isinstance(given, dict):
            raise AskedError("bad-line", "'set' takes \"levels\": {FACTOR: LEVEL}")
        levels = {**self._levels, **{str(name): self._level(str(name), value) for name, value in given.items()}}
        excluded = self._file.excluded_by(levels)
        if excluded is not None:
            raise AskedError(
                "excluded", f"the study leaves out '{excluded.where}': set other levels, all of them in the same 'set'"
            )
        if self.switcher.sensed().object >= 0:
            raise AskedError("in-contact", "the scene can't change while something is touched: wait for the release")

        def present() -> None:
            self._guarded(lambda asked: self._presented(asked, levels), request)

        self._outside = present

    def _waited(self, cue: str) -> None:
        """Look at the server while the rig waits for a person, so that a caller may end the study meanwhile."""
        request = self.server.look(0.0)
        if request is not None and request.what == "stop":
            self._stop(request)
            raise Stopped
        if request is not None:
            said = {"lift": "the finger to lift", "hold": "somebody to hold the dead-man's switch"}[cue]
            self.server.refuse(request, "busy", f"the rig waits for {said}")

    def _presented(self, request: Request, levels: dict[str, str]) -> None:
        try:
            self.switcher.present(levels)
        except (SceneError, SessionError):
            self.switcher.wake()  # the previous scene goes on
            raise
        self._levels, self._went = levels, False
        self.server.answer(request, levels=levels, **self._told(self.switcher.sensed()))

    def _level(self, name: str, value: Any) -> str:
        study = self._file.study
        factor = next((one for one in study.factors if one.name == name), None)
        if factor is not None:
            if value not in factor.names:
                raise AskedError("unknown-level", f"'{value}' is not a level of '{name}': {', '.join(factor.names)}")
            return str(value)
        one = next((each for each in study.staircases if each.name == name), None)
        if one is None:
            known = ", ".join([*(each.name for each in study.factors), *(each.name for each in study.staircases)])
            raise AskedError("unknown-factor", f"the study varies no '{name}'; it varies {known}")
        number = _number(value, f"a level of '{name}'", one.low, one.high)
        return f"{number:.9g}"

    def _go(self, request: Request) -> None:
        self.switcher.go()
        self._went = True
        self.server.answer(request, **self._told(self.switcher.sensed()))

    def _wait(self, request: Request) -> None:
        given, wanted = request.given, self.switcher.feeling.index
        seconds = _number(given.get("seconds", 60.0), "'seconds'", 0.0, LONGEST_WAIT)
        what = str(given.get("for", "seconds"))
        skin = 0.0
        if what == "skin":
            if not self.switcher.feeling.measures_skin:
                raise AskedError("no-skin", "nothing of this scene measures the skin's temperature")
            skin = 273.15 + _number(given.get("skin_degC"), "'skin_degC'", -50.0, 100.0)
        within = _number(given.get("within_K", 0.5), "'within_K'", 0.0, 100.0)
        so: dict[str, Callable[[Sensed], bool]] = {
            "seconds": lambda sensed: False,
            "ready": lambda sensed: sensed.ready,
            "contact": lambda sensed: sensed.object == wanted,
            "release": lambda sensed: sensed.object < 0,
            "skin": lambda sensed: sensed.skin is not None and abs(sensed.skin - skin) <= within,
        }
        if what not in so:
            raise AskedError("unknown-word", f"'{what}' is not a thing to wait for; there are {', '.join(so)}")
        sensed = self.switcher.sensed()
        if so[what](sensed):
            self.server.answer(request, met=True, **self._told(sensed))
            return
        self._waits.append(Waiting(request, so[what], sensed.seconds + seconds, what))

    def _now(self, request: Request) -> None:
        self.server.answer(request, **self._told(self.switcher.sensed()))

    def _told(self, sensed: Sensed) -> dict[str, Any]:
        """Return what can be read at any time, as copies of State's values."""
        session = self.switcher.session
        state, probe = session.state, session.model.probes[0].name
        names = session.model.objects
        told: dict[str, Any] = {
            "seconds": round(sensed.seconds, 6), "tick": session.ticks,
            "touched": names[sensed.object] if sensed.object >= 0 else None, "ready": sensed.ready,
            "over": sensed.over and self._went, "force_N": _finite(state[f"{probe}.total_force"]),
            "skin_degC": None if sensed.skin is None else _finite(sensed.skin - 273.15),
        }  # fmt: skip
        flux = self._flux()
        return {**told, "flux_W_m2": None if flux is None else _finite(state[flux])}

    def _flux(self) -> str | None:
        """Return the field of the flux out of the finger: the twin's true one, else the measured one, else None."""
        model = self.switcher.session.model
        try:
            return felt_by(model)[0]
        except ItouchError:
            pass
        for device in model.devices.values():
            channel = device.reading(Role.HEAT_FLUX)
            if channel is not None:
                return f"{device.name}.{channel.name}"
        return None

    def _felt(self, request: Request) -> None:
        """Answer with what was felt in the touch since the last ``set``; with ``samples`` the curves, too."""
        if self.switcher.sensed().object >= 0:
            raise AskedError("in-contact", "the touch has not ended: wait for the release")
        touch = self.switcher.felt("")
        told: dict[str, Any] = {"void": touch.void, "figures": figures(touch)}
        if request.given.get("samples"):
            felt = touch.felt
            told["samples"] = {
                "period_s": felt.period, "flux_W_m2": [_finite(one) for one in felt.flux],
                "skin_degC": [_finite(one - 273.15) for one in felt.skin],
            }  # fmt: skip
        self.server.answer(request, **told)

    def _mark(self, request: Request) -> None:
        session = self.switcher.session
        session.mark(str(request.given.get("name", "")), request.given.get("payload"))
        self.server.answer(request, tick=session.ticks, seconds=round(session.seconds, 6))

    def _stop(self, request: Request) -> None:
        self.server.answer(request, ended=True)
        self.ended = True


def _number(value: Any, what: str, low: float, high: float) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
        raise AskedError("bad-number", f"{what} is a number from {low:g} to {high:g}, not {value!r}")
    return float(value)


def _finite(value: Any) -> float | None:
    number = float(value)
    return round(number, 6) if math.isfinite(number) else None
