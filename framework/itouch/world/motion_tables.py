"""The motions of a world's objects, compiled to the tables that move them."""

from __future__ import annotations

import io
import itertools
import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from itouch.arms.pose_table import checked, read_columns
from itouch.contact import Shape
from itouch.contact import object_motion as at
from itouch.contact.meshfile import MeshError
from itouch.dynamics import Bodies, Body, BodyError, available, build_bodies
from itouch.dynamics.bodies import FREE, MOVED, STILL
from itouch.plugin import poses as pose
from itouch.scene import Scene, elements
from itouch.schema import Problem
from itouch.world.rig import DeviceModel, orientation
from itouch.world.scene_files import SceneFiles
from itouch.world.surfaces import material_of

Floats = NDArray[np.float64]

#: Greatest file of a recorded motion [bytes], and how many rows it may have.
MAX_BYTES = 64 << 20
MAX_ROWS = 1_000_000
#: How far a recorded motion may go along each axis [m]; as in a ``pos`` of the scene.
FARTHEST = 100.0
#: How far [m and rad] the end of a motion that repeats may be from its beginning.
CLOSED = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class Carried:
    """An object that a device carries: its number, the device, its pose on the device's end (7,) [m; quaternion]."""

    index: int
    device: str
    offset: tuple[float, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Motions:
    """How the objects of a world move; see ``itouch.contact.object_motion`` for the tables.

    Attributes
    ----------
    scripts, pieces
        (n, SCRIPT_WIDTH) and (m, PIECE_WIDTH).
    carried
        Objects that devices carry.
    duration
        Longest script that does not repeat [s].
    bodies
        The world of rigid bodies, if any object is one.
    """

    scripts: Floats
    pieces: Floats
    carried: tuple[Carried, ...] = ()
    duration: float = 0.0
    bodies: Bodies | None = None

    def __bool__(self) -> bool:
        return bool(len(self.scripts) or self.carried or self.bodies)


NO_MOTIONS = Motions(np.zeros((0, at.SCRIPT_WIDTH)), np.zeros((0, at.PIECE_WIDTH)))


def build_motions(
    scene: Scene,
    rows: Floats,
    shapes: Sequence[Shape],
    devices: Mapping[str, DeviceModel],
    reader: SceneFiles,
    problems: list[Problem],
    shapeless: Collection[int] = (),
) -> Motions:
    """Return how the objects move; ``rows`` are their poses at start (n, 7) [m; quaternion].

    ``shapeless`` are those, by index, whose shape could not be made: as rigid bodies they are not looked at.
    """
    scripts: list[tuple[float, ...]] = []
    pieces: list[tuple[float, ...]] = []
    carried: list[Carried] = []
    duration = 0.0
    for index, element in enumerate(scene.objects):
        ways = [what for what in ("motion", "pose_from", "dynamics") if getattr(element, what)]
        if len(ways) > 1:
            listed = " and ".join(way.replace("_", "-") for way in ways)
            sentence = f"object '{element.name}' moves by {listed}; one of them must do"
            problems.append(Problem("exclusive", sentence, scene.places.of(element), "remove the others"))
        elif element.pose_from:
            if element.pose_from in devices:
                carried.append(Carried(index, element.pose_from, tuple(rows[index])))
        elif element.motion is not None:
            path = _path(scene, element, rows[index], reader, problems)
            if not path:
                continue
            time = path[-1][at.PIECE_START] + path[-1][at.PIECE_TIME]
            _check_closed(scene, element, path, problems)
            scripts.append((index, len(pieces), len(pieces) + len(path), time, float(element.motion.repeat)))
            pieces += path
            duration = max(duration, 0.0 if element.motion.repeat else time)
    tables = (
        np.array(scripts, np.float64).reshape(-1, at.SCRIPT_WIDTH),
        np.array(pieces, np.float64).reshape(-1, at.PIECE_WIDTH),
    )  # fmt: skip
    for table in tables:
        table.setflags(write=False)
    return Motions(*tables, tuple(carried), duration, _bodies(scene, rows, shapes, shapeless, problems))


def _bodies(
    scene: Scene, rows: Floats, shapes: Sequence[Shape], shapeless: Collection[int], problems: list[Problem]
) -> Bodies | None:
    """Return the world of rigid bodies; None if no object is one, or if it cannot be made, which becomes a problem."""
    free = [element for element in scene.objects if element.dynamics is not None]
    if not free:
        return None
    if not available():
        sentence = f"object '{free[0].name}' is a rigid body, which needs MuJoCo, and that is not installed"
        advice = "pip install 'itouch-py[dynamics]'"
        problems.append(Problem("missing-extra", sentence, scene.places.of(free[0].dynamics), advice))
        return None
    formed = [index for index in range(len(shapes)) if index not in shapeless]
    bodies = [_body(scene, scene.objects[index], rows[index], shapes[index]) for index in formed]
    if not any(body.kind == FREE for body in bodies):
        return None
    try:
        made = build_bodies(bodies, scene.world.gravity, 1.0 / scene.rates.servo)
        return None if shapeless else made
    except BodyError as error:
        element = scene.objects[formed[error.index]]
        what = "be a rigid body" if element.dynamics is not None else "be met by rigid bodies"
        sentence = f"object '{element.name}' cannot {what}: {error}"
        problems.append(Problem("dynamics", sentence, scene.places.of(element.dynamics or element)))
        return None


def _body(scene: Scene, element: Any, row: Floats, shape: Shape) -> Body:
    physics = element.dynamics
    material = material_of(scene, element)
    rough = material.contact.dynamic_friction if material is not None and material.contact is not None else 0.0
    place = tuple(row.tolist())
    if physics is None:
        return Body(shape, place, MOVED if element.motion or element.pose_from else STILL, friction=rough)
    friction = rough if physics.friction is None else physics.friction
    return Body(shape, place, FREE, physics.mass, physics.inertia, friction, physics.damping)


def _path(
    scene: Scene, element: Any, start: Floats, reader: SceneFiles, problems: list[Problem]
) -> list[tuple[float, ...]]:
    """Return the pieces of one object's script."""
    motion = element.motion
    if bool(motion.file) == bool(motion.keys):
        if ("object", element.name) not in scene.uncertain.unsound:  # else one may be there that could not be read
            sentence = f"the motion of '{element.name}' needs either a file or <to> elements"
            problems.append(Problem("one-of", sentence, scene.places.of(motion)))
        return []
    if not motion.file:
        return _keys(scene, motion, start, problems)
    place = scene.places.of(motion, "file")
    try:
        table = read_motion(reader.read(motion.file, MAX_BYTES))
    except MeshError as error:
        code = error.code if error.code != "mesh-too-large" else "motion"
        problems.append(Problem(code, error.sentence, place, error.advice))
        return []
    except ValueError as error:
        sentence = f"'{motion.file}' is not a table of a motion: {error}"
        advice = "columns t x y z, or t x y z qw qx qy qz, in SI or with their units: t [ms],x [mm]"
        problems.append(Problem("motion", sentence, place, advice))
        return []
    if table.shape[1] == 4:
        table = np.hstack([table, np.tile(start[3:], (len(table), 1))])
    return [_piece(a[0] - table[0, 0], b[0] - a[0], False, a[1:], b[1:]) for a, b in itertools.pairwise(table)]


def _keys(
    scene: Scene, motion: elements.ObjectMotion, start: Floats, problems: list[Problem]
) -> list[tuple[float, ...]]:
    pieces: list[tuple[float, ...]] = []
    here, time = np.array(start), 0.0
    for key in motion.keys:
        there = here.copy()
        if key.pos is not None:
            there[:3] = key.pos
        if key.quat is not None or key.rpy is not None:
            there[3:] = orientation(key, scene, problems)
        pieces.append(_piece(time, key.in_, True, here, there))
        time += key.in_
        if key.hold > 0.0:
            pieces.append(_piece(time, key.hold, True, there, there))
            time += key.hold
        here = there
    return pieces


def _piece(start: float, time: float, smooth: bool, a: Floats, b: Floats) -> tuple[float, ...]:
    return (start, time, float(smooth), *a[:3], *(b[:3] - a[:3]), *a[3:], *_turn(a[3:], b[3:]))


def _turn(a: Floats, b: Floats) -> tuple[float, ...]:
    """Return the rotation vector [rad] in the world from one orientation to another, the short way round."""
    w, x, y, z = pose.multiply(b, pose.conjugate(a))
    sine = math.sqrt(x * x + y * y + z * z)
    if sine < 1e-15:
        return (0.0, 0.0, 0.0)
    scale = 2.0 * math.atan2(sine, abs(w)) / sine * (1.0 if w >= 0.0 else -1.0)
    return (scale * x, scale * y, scale * z)


def _check_closed(scene: Scene, element: Any, path: list[tuple[float, ...]], problems: list[Problem]) -> None:
    if not element.motion.repeat or ("object", element.name) in scene.uncertain.unsound:
        return
    first, last = np.array(path[0]), np.array(path[-1])
    end = last[at.PIECE_FROM : at.PIECE_WAY] + last[at.PIECE_WAY : at.PIECE_QUATERNION]
    away = float(np.linalg.norm(end - first[at.PIECE_FROM : at.PIECE_WAY]))
    turn = last[at.PIECE_TURN :]
    angle = float(np.linalg.norm(turn))
    half = np.array([math.cos(angle / 2), *(turn * (math.sin(angle / 2) / angle if angle else 0.5))])
    q = pose.multiply(half, last[at.PIECE_QUATERNION : at.PIECE_TURN])
    aside = float(np.linalg.norm(_turn(first[at.PIECE_QUATERNION : at.PIECE_TURN], q)))
    if away > CLOSED or aside > CLOSED:
        far = f"{away * 1e3:.3g} mm and {math.degrees(aside):.3g} deg"
        sentence = f"the motion of '{element.name}' repeats, but ends {far}"
        advice = "end its last target where it begins"
        place = scene.places.of(element.motion, "repeat")
        problems.append(Problem("motion", f"{sentence} away from where it begins", place, advice))


def read_motion(data: bytes) -> Floats:
    """Read a table of poses over time, (rows, 4) or (rows, 8): t from 0 [s], x y z [m], and the quaternion w x y z.

    Raises
    ------
    ValueError
        If it is no such table: columns must be known, times rise, numbers be finite and within ``FARTHEST``,
        quaternions not zero.
    """
    table = _npy(data) if data.startswith(b"\x93NUMPY") else read_columns(data)
    if table.ndim != 2 or table.shape[1] not in (4, 8) or not 2 <= len(table) <= MAX_ROWS:
        raise ValueError(f"it has the shape {table.shape}; it must be (2 to {MAX_ROWS} rows, 4 or 8 columns)")
    times, poses = checked(table[:, 0], table[:, 1:])
    far = (np.abs(poses[:, :3]) > FARTHEST).any(axis=1)
    if far.any():
        raise ValueError(f"row {int(np.argmax(far)) + 1} lies farther than {FARTHEST:g} m from the world's origin")
    return np.column_stack([times, poses[:, : table.shape[1] - 1]])


def _npy(data: bytes) -> Floats:
    try:
        table = np.load(io.BytesIO(data), allow_pickle=False)
    except (ValueError, OSError, EOFError, TypeError) as error:
        raise ValueError(f"its array cannot be read ({error})") from None
    if table.dtype.kind not in "fiu":
        raise ValueError(f"its array holds {table.dtype}; it must hold real numbers")
    return np.asarray(table, np.float64)
