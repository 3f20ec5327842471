"""A recording as an arm (`recorded`): it reads the recorded pose, whatever force it is commanded."""

from __future__ import annotations

import math
import os
from bisect import bisect_right
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from itouch.arms.pose_table import example, from_csv, from_recording
from itouch.arms.twin_only import TwinOnlyArm
from itouch.plugin import (
    ROTATIONS,
    Attached,
    Channel,
    DeviceError,
    Field,
    OperatorInput,
    ParameterError,
    Record,
    Twin,
    TwinInputs,
    pose,
    schema,
)
from itouch.recording.reader import MAX_MOTION
from itouch.schema.regular_files import open_regular

#: Nearer than this to a sample [samples], its pose is used as it is: recorded times are rounded.
_NEAR = 1e-6


@dataclass(frozen=True, slots=True)
class RecordedParams:
    """A recording, or a table of poses, as an arm."""

    file: str = schema.file(
        default="", doc="a recording (.mcap) or a table (.csv); empty: an example, a finger that comes down and goes up"
    )
    track: str = schema.text(default="", doc="device or probe of a recording; default: the only one that has a pose")
    repeat: bool = schema.flag(default=False, doc="whether it starts again when it is over; else it rests at its end")
    rotations: str = schema.choice(
        "locked", "sensed", default="locked", doc="whether its end cannot turn, or the recorded turning is read"
    )


@dataclass(frozen=True, slots=True, eq=False)
class Played:
    """Parameters with the file's content: increasing times from 0 on [s], and poses (n, 7) [m; quaternion]."""

    params: RecordedParams
    times: list[float]
    poses: NDArray[np.float64]

    @property
    def duration(self) -> float:
        """How long it lasts [s]; 0 if it repeats and so has no end."""
        return 0.0 if self.params.repeat else self.times[-1]

    def at(self, time: float) -> list[float]:
        """Return the pose at a time [s]: positions are interpolated linearly, quaternions linearly and normalized."""
        times = self.times
        if self.params.repeat and time > times[-1]:
            time = math.fmod(time, times[-1])
        after = min(max(bisect_right(times, time), 1), len(times) - 1)
        begin, end = times[after - 1], times[after]
        part = min(max((time - begin) / (end - begin), 0.0), 1.0)
        if min(part, 1.0 - part) < _NEAR:
            row: list[float] = self.poses[after if part > 0.5 else after - 1].tolist()
        else:
            row = _between(self.poses[after - 1].tolist(), self.poses[after].tolist(), part)
        if self.params.rotations == "locked":
            row[3:] = (1.0, 0.0, 0.0, 0.0)
        return row


def _between(here: list[float], there: list[float], part: float) -> list[float]:
    sign = math.copysign(1.0, sum(a * b for a, b in zip(here[3:], there[3:], strict=True)))
    place = [a + part * (b - a) for a, b in zip(here[:3], there[:3], strict=True)]
    turn = [a + part * (sign * b - a) for a, b in zip(here[3:], there[3:], strict=True)]
    size = math.sqrt(sum(q * q for q in turn))
    return [*place, *(q / size for q in turn)]


class RecordedTwin(Twin):
    """Plays the recording by the session's clock; forces do not move it."""

    def __init__(self, params: Any) -> None:
        super().__init__(params)
        self._played = params if isinstance(params, Played) else Recorded.bind(params, _read)

    def fields(self) -> tuple[Field, ...]:
        """Return the field with the time that has been played [s]."""
        return (Field("time", unit="s", doc="how much of the recording has been played", show="no"),)

    def reset(self, state: Record, rng: np.random.Generator) -> None:
        """Start at the beginning."""
        state["time"] = 0.0

    def step(self, state: Record, command: Record, touch: TwinInputs, period: float) -> None:
        """Advance the time by one period [s]."""
        state["time"] = state["time"].item() + period

    def read(self, state: Record, reading: Record) -> bool | None:
        """Read the pose of this moment."""
        reading["pose"] = self._played.at(state["time"].item())
        return True


class Recorded(TwinOnlyArm):
    """A recording as an arm: it replays a recorded pose; forces are rendered and recorded, but move nothing."""

    Params = RecordedParams
    reads = (pose(),)
    Twin: ClassVar[type[Twin] | None] = RecordedTwin
    operator_input = OperatorInput(input_source="recording")

    @classmethod
    def channels(cls, params: Any) -> tuple[tuple[Channel, ...], tuple[Channel, ...]]:
        """Return the channels; rotations that are not read are locked."""
        own = params.params if isinstance(params, Played) else params
        return (pose(locked=ROTATIONS if own.rotations == "locked" else ()),), cls.commands

    @classmethod
    def bind(cls, params: Any, read: Callable[[str, int], bytes]) -> Played:
        """Return the parameters with the content of their file.

        Raises
        ------
        ParameterError
            If the file does not contain such a motion.
        """
        if not params.file:
            return Played(params, *example())
        data = read(params.file, MAX_MOTION)
        try:
            found = from_csv(data) if params.file.lower().endswith(".csv") else None
            return Played(params, *(found or from_recording(params.file, data, params.track)))
        except ParameterError:
            raise
        except ValueError as error:
            raise ParameterError("file", f"'{params.file}' is not a motion: {error}") from error

    @classmethod
    def motion_duration(cls, bound: Any) -> float:
        """Return how long the recording lasts [s]."""
        return bound.duration if isinstance(bound, Played) else 0.0

    @classmethod
    def discover(cls) -> tuple[Attached, ...]:
        """Return that it needs nothing but a file."""
        return (Attached("a file that a scene names", True, "or, without one, a built-in example"),)


def _read(file: str, most: int) -> bytes:
    """Read a file without a session, with its name relative to the working folder.

    Raises
    ------
    DeviceError
        If it cannot be read, or is too large.
    """
    try:
        if os.path.getsize(file) > most:
            raise DeviceError(f"'{file}' is larger than {most >> 20} MiB")
        with open_regular(file) as stream:
            return stream.read()
    except OSError as error:
        raise DeviceError(f"cannot read '{file}': {error.strerror or error}") from error
