"""A virtual Inverse Service with one arm: messages in, messages out, and a simulated finger that the arm pushes."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, field
from typing import Any

from itouch.plugin.impedance import Vector

#: A cursor's position in front of the arm [m], as in an example of the service's documentation.
CENTRE: Vector = (0.0, -0.12, 0.15)
#: Longest integration step [s], and longest time [s] that one call catches up on.
_STEP, _CATCH_UP = 1e-3, 0.25
_SHORT = (",", ":")


@dataclass(slots=True)
class Finger:
    """A finger on the arm: a mass that the hand holds through a spring and damper, and that the motors push.

    ``hand`` is the position to which the hand pulls it [m]; if ``led``, the caller sets its position instead.
    """

    hand: Vector = CENTRE
    mass: float = 0.15
    stiffness: float = 300.0
    damping: float = 8.0
    position: Vector = CENTRE
    velocity: Vector = (0.0, 0.0, 0.0)
    led: bool = False
    _now: float | None = None

    def advance(self, now: float, force: Vector) -> None:
        """Advance to a time [s] under a force [N]."""
        self._now = now if self._now is None else max(self._now, now - _CATCH_UP)
        while not self.led and now - self._now > 1e-9:
            step = min(_STEP, now - self._now)
            self._now += step
            place, speed = list(self.position), list(self.velocity)
            for i in range(3):
                pull = self.stiffness * (self.hand[i] - place[i]) - self.damping * speed[i]
                speed[i] += step * (pull + force[i]) / self.mass
                place[i] += step * speed[i]
            self.position, self.velocity = (place[0], place[1], place[2]), (speed[0], speed[1], speed[2])
        self._now = now


@dataclass(slots=True)
class Faults:
    """The faults to inject into the virtual service; each count goes down by one when its fault occurs.

    Attributes
    ----------
    mute, late
        Number of answers that never come; delay of the next answer [s].
    garbage, odd, nan, far
        Number of answers that are not JSON, or whose position is of another type, not a number, or out of reach.
    extra
        Number of answers that an unsolicited message precedes.
    bare, halved
        Number of answers that leave out the position, or part of it.
    hang_up
        Whether the connection is closed in the middle of the next answer.
    unplugged
        Whether the arm is missing from the list.
    unpowered, uncalibrated
        Whether the arm's status says that it has no power, or is not calibrated.
    """

    mute: int = 0
    late: float = 0.0
    garbage: int = 0
    odd: int = 0
    nan: int = 0
    far: int = 0
    extra: int = 0
    bare: int = 0
    halved: int = 0
    hang_up: bool = False
    unplugged: bool = False
    unpowered: bool = False
    uncalibrated: bool = False

    def take(self, name: str) -> bool:
        """Tell whether this fault occurs now, and count it down."""
        left: int = getattr(self, name)
        if left:
            setattr(self, name, left - 1)
        return bool(left)


@dataclass(slots=True)
class VirtualService:
    """Answers each message with one state update, and holds the force that was commanded last.

    The force is held until another one is commanded: what a real service does when its client is gone is not
    documented, and this is the worst that it could do.
    """

    device: str = "049D"
    finger: Finger = field(default_factory=Finger)
    faults: Faults = field(default_factory=Faults)
    others: tuple[str, ...] = ()
    buttons: dict[str, bool] = field(default_factory=lambda: {"a": False, "b": False, "c": False})
    sessions: bool = True
    force: Vector = (0.0, 0.0, 0.0)
    #: All forces that were commanded.
    asked: list[Vector] = field(default_factory=list)

    def inventory(self) -> str:
        """Return the first message: all devices with their configuration."""
        return self._dump(self._arms(full=True))

    def answer(self, text: str, now: float) -> list[str]:
        """Take a message at a time [s]; return the messages to send back, of which a mute fault drops the answer."""
        self._obey(text)
        self.finger.advance(now, self.force)
        sent = ['{"session":{"event":"focus_changed"}}'] if self.faults.take("extra") else []
        if self.faults.take("mute"):
            return sent
        if self.faults.take("garbage"):
            return [*sent, '{"inverse3": [{"device_id"']
        return [*sent, self._dump(self._arms(full=False))]

    def _obey(self, text: str) -> None:
        try:
            message = json.loads(text)
            for one in message.get("inverse3", []):
                values = one.get("commands", {}).get("set_cursor_force", {}).get("values")
                if one["device_id"] == self.device and values is not None and not self.faults.unplugged:
                    self.force = (float(values["x"]), float(values["y"]), float(values["z"]))
                    self.asked.append(self.force)
        except (ValueError, KeyError, TypeError, AttributeError):
            return  # a service answers even an invalid message

    def _dump(self, arms: list[dict[str, Any]]) -> str:
        grip = {"device_id": "61548", "state": {"orientation": _turn(), "buttons": dict(self.buttons)}}
        head = {"session_id": 7} if self.sessions else {}
        return json.dumps({**head, "inverse3": arms, "wireless_verse_grip": [grip]}, separators=_SHORT)

    def _arms(self, *, full: bool) -> list[dict[str, Any]]:
        faults = self.faults
        own = [] if faults.unplugged else [self._arm(self.device, full=full)]
        return [*(self._arm(name, full=full) for name in self.others), *own]

    def _arm(self, name: str, *, full: bool) -> dict[str, Any]:
        faults, mine = self.faults, name == self.device
        status = {
            "calibrated": not (mine and faults.uncalibrated), "in_use": False, "ready": True, "started": True,
            "power_supply": not (mine and faults.unpowered),
        }  # fmt: skip
        config = {
            "config": {"type": "inverse3", "handedness": "right", "preset": "defaults", "basis": {"permutation": "XYZ"}}
        }
        place = self._place(full) if mine else _vector(CENTRE)
        state: dict[str, Any] = {"cursor_position": place, "cursor_velocity": _vector(self.finger.velocity)}
        if mine and not full and faults.take("bare"):
            del state["cursor_position"]
        return {"device_id": name, **(config if full else {}), "state": state, "status": status}

    def _place(self, full: bool) -> Any:
        place: dict[str, Any] = _vector(self.finger.position)
        if full:
            return place
        if self.faults.take("odd"):
            return {**place, "y": "0.1"}
        if self.faults.take("nan"):
            return {**place, "z": math.nan}
        if self.faults.take("far"):
            return {**place, "x": 40.0}
        if self.faults.take("halved"):
            return {"x": place["x"]}
        return place


def _vector(value: Vector) -> dict[str, Any]:
    x, y, z = value
    return {"x": x, "y": y, "z": z}


def _turn() -> dict[str, float]:
    return {"w": 1.0, "x": 0.0, "y": 0.0, "z": 0.0}
