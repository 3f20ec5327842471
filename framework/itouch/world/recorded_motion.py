"""A recorded motion: where a finger was, from a recording that the scene names."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from itouch.contact.meshfile import MeshError
from itouch.recording.reader import MAX_MOTION, parse, unread
from itouch.recording.recording_error import RecordingError
from itouch.scene import Scene
from itouch.scene.elements import Operator
from itouch.schema import Problem
from itouch.schema.diagnostics import did_you_mean
from itouch.world.scene_files import SceneFiles


@dataclass(frozen=True, slots=True, eq=False)
class RecordedMotion:
    """The positions [m] of a fingertip, shape (n, 3), and the time from one to the next [s]."""

    positions: NDArray[np.float64]
    period: float


def recorded_motion(
    scene: Scene, operator: Operator | None, reader: SceneFiles, problems: list[Problem]
) -> RecordedMotion | None:
    """Return the motion in an operator's file, or None; what is wrong becomes a problem."""
    if operator is None or not operator.motion.file:
        return None
    motion = operator.motion
    place = scene.places.of(motion, "file") or scene.places.of(motion)
    try:
        data = reader.read(motion.file, MAX_MOTION)
        content = parse(motion.file, data, len(data))
    except (MeshError, RecordingError) as error:
        problems.append(Problem("bad-recording", f"the motion can't be read: {error}", place))
        return None
    name = motion.recorded_probe or operator.probe
    rows = content.rows.get(name)
    names = [track for track, table in content.rows.items() if "hip" in (table.dtype.names or ())]
    if rows is None or name not in names or not len(rows):
        sentence = f"'{motion.file}' has no recorded probe named '{name}'"
        damage = unread(content, f"no place of a probe '{name}'")
        told = damage if damage else (sentence, did_you_mean(name, names, "its probes are"))
        problems.append(Problem("bad-recording", told[0], place, told[1]))
        return None
    positions = np.array(rows["hip"], np.float64)
    if positions.ndim != 2 or positions.shape[1] != 3 or not np.isfinite(positions).all():
        problems.append(Problem("bad-recording", f"'{motion.file}' holds places that are not numbers", place))
        return None
    positions.setflags(write=False)
    return RecordedMotion(positions, float(content.session["period"]) * content.tracks[name].every)
