"""A recording as an arm (`recorded`): it reads the pose that was recorded, whatever force it is commanded."""

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
from itouch.schema.files import open_regular

#: Greatest file [bytes].
MOST = 256 << 20
#: How near [samples] to a sample its pose is taken as it is: recorded times are rounded.
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
    """Parameters with the file's content: times [s] from 0 on, rising, and poses (n, 7)."""

    params: RecordedParams
    times: list[float]
    poses: NDArray[np.float64]

    @property
    def duration(self) -> float:
        """How long it lasts [s]; what repeats has no end."""
        return 0.0 if self.params.repeat else self.times[-1]

    def at(self, time: float) -> list[float]:
        """Return the pose at a time [s]: between two samples on the straight way, turning evenly."""
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
    """Plays the recording on the session's own clock; forces do not move it."""

    def __init__(self, params: Any) -> None:
        super().__init__(params)
        self._played = params if isinstance(params, Played) else Recorded.bind(params, _read)

    def fields(self) -> tuple[Field, ...]:
        """Return how much of it has been played [s]."""
        return (Field("time", unit="s", doc="how much of the recording has been played", show="no"),)

    def reset(self, state: Record, rng: np.random.Generator) -> None:
        """Begin at its beginning."""
        state["time"] = 0.0

    def step(self, state: Record, command: Record, touch: TwinInputs, period: float) -> None:
        """Play on."""
        state["time"] = state["time"].item() + period

    def read(self, state: Record, reading: Record) -> bool | None:
        """Give the pose of this moment."""
        reading["pose"] = self._played.at(state["time"].item())
        return True


class Recorded(TwinOnlyArm):
    """A recording as an arm: it replays a recorded pose; forces are rendered and recorded, and move nothing."""

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
        """Return the parameters with what their file holds.

        Raises
        ------
        ParameterError
            If the file holds no such motion.
        """
        if not params.file:
            return Played(params, *example())
        data = read(params.file, MOST)
        try:
            found = from_csv(data) if params.file.lower().endswith(".csv") else None
            return Played(params, *(found or from_recording(params.file, data, params.track)))
        except ParameterError:
            raise
        except ValueError as error:
            raise ParameterError("file", f"'{params.file}' is not a motion: {error}") from error

    @classmethod
    def duration(cls, bound: Any) -> float:
        """Return how long the recording lasts [s]."""
        return bound.duration if isinstance(bound, Played) else 0.0

    @classmethod
    def discover(cls) -> tuple[Attached, ...]:
        """Tell that it needs nothing but a file."""
        return (Attached("a file that a scene names", True, "or, without one, a built-in example"),)


def _read(file: str, most: int) -> bytes:
    """Read a file outside of a session: its name is relative to where the program runs.

    Raises
    ------
    DeviceError
        If it can't be read.
    """
    try:
        if os.path.getsize(file) > most:
            raise DeviceError(f"'{file}' is larger than {most >> 20} MiB")
        with open_regular(file) as stream:
            return stream.read()
    except OSError as error:
        raise DeviceError(f"cannot read '{file}': {error.strerror or error}") from error
