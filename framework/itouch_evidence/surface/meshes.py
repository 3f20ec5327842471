"""Random meshes made from a seed, and strokes over them or over shipped meshes."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray

from itouch_evidence.surface.scenes import RADIUS, Slope

Floats = NDArray[np.float64]

KINDS = ("terrain", "torus", "lump", "saddle")
SHIPPED = ("pebble.stl", "relief.obj")
#: Half width of the square in which strokes run [mm], and spacing of the vertices of height fields [mm].
REACH, CELL = 22.0, 2.0


def make(folder: Path, kind: str, seed: int, *, deep: float = 4.0, speed: float = 40.0, **scene: object) -> Slope:
    """Write a random mesh into the folder of scenes, and return a scene with strokes over it.

    Parameters
    ----------
    folder
        The folder of the shipped scenes; the mesh is written to its ``meshes``.
    kind, seed
        One of ``KINDS``, and the seed of mesh and strokes.
    deep, speed
        How deep below the surface the hand aims [mm], and how fast it moves from target to target [mm/s].
    scene
        Further fields of ``Slope``.
    """
    rng = np.random.default_rng(seed)
    mesh = {"terrain": _terrain, "torus": _torus, "lump": _lump, "saddle": _saddle}[kind](rng)
    mesh.vertices = mesh.vertices.round(3)  # so that the file is the same on every machine
    name = f"{kind}{seed}.stl"
    mesh.export(folder / "meshes" / name)
    return _scene(mesh, name, rng, deep, speed, scene)


def shipped(folder: Path, name: str, seed: int, *, deep: float = 4.0, speed: float = 40.0, **scene: object) -> Slope:
    """Return a scene with strokes over a shipped mesh, one of ``SHIPPED``; all else as in ``make``."""
    mesh = trimesh.load_mesh(folder / "meshes" / name)
    return _scene(mesh, name, np.random.default_rng(seed), deep, speed, scene)


def _scene(
    mesh: trimesh.Trimesh, name: str, rng: np.random.Generator, deep: float, speed: float, scene: dict[str, object]
) -> Slope:
    sides = "" if mesh.is_watertight else ' sides="one"'
    world = f'<mesh name="thing" file="meshes/{name}" pos="0 0 0 mm"{sides} material="stuff"/>'
    return Slope(world, _strokes(mesh, rng, deep, speed), **scene)  # type: ignore[arg-type]


def _field(height: Floats, line: Floats) -> trimesh.Trimesh:
    """Return the mesh of a height field: heights (n, n) over a square grid whose coordinates are ``line`` (n,) [mm]."""
    n = len(line)
    x, y = np.meshgrid(line, line, indexing="ij")
    points = np.column_stack((x.ravel(), y.ravel(), height.ravel()))
    a = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    faces = np.concatenate((np.column_stack((a, a + n, a + n + 1)), np.column_stack((a, a + n + 1, a + 1))))
    return trimesh.Trimesh(points, faces, process=False)


def _line() -> Floats:
    return np.arange(-40.0, 40.0 + CELL / 2, CELL)


def _terrain(rng: np.random.Generator) -> trimesh.Trimesh:
    line = _line()
    x, y = np.meshgrid(line, line, indexing="ij")
    height = np.full(x.shape, 10.0)
    for _ in range(6):
        length, turn, phase = rng.uniform(25.0, 60.0), rng.uniform(0, 2 * math.pi), rng.uniform(0, 2 * math.pi)
        steep = rng.uniform(0.1, 0.45)  # greatest slope of this wave
        wave = 2 * math.pi / length
        height += steep / wave * np.sin(wave * (x * math.cos(turn) + y * math.sin(turn)) + phase)
    return _field(np.clip(height, -8.0, 25.0), line)


def _saddle(rng: np.random.Generator) -> trimesh.Trimesh:
    line = _line()
    x, y = np.meshgrid(line, line, indexing="ij")
    bend = rng.uniform(0.008, 0.02)
    return _field(np.clip(10.0 + bend * (x**2 - y**2), -10.0, 25.0), line)


def _torus(rng: np.random.Generator) -> trimesh.Trimesh:
    mesh: trimesh.Trimesh = trimesh.creation.torus(rng.uniform(18.0, 26.0), rng.uniform(7.0, 12.0), 48, 24)
    turn = rng.uniform(-0.4, 0.4)
    tilted = np.eye(4)
    tilted[1:3, 1:3] = ((math.cos(turn), -math.sin(turn)), (math.sin(turn), math.cos(turn)))
    mesh.apply_transform(tilted)
    return mesh


def _lump(rng: np.random.Generator) -> trimesh.Trimesh:
    mesh = trimesh.creation.icosphere(3, rng.uniform(20.0, 26.0))
    points = mesh.vertices.copy()
    way = points / np.linalg.norm(points, axis=1)[:, None]
    for _ in range(4):
        wave = rng.normal(0.0, 2.0, 3)
        points += way * (rng.uniform(0.3, 1.2) * np.sin(way @ wave + rng.uniform(0, 6)))[:, None]
    return trimesh.Trimesh(points, mesh.faces, process=False)


def _height(mesh: trimesh.Trimesh, x: float, y: float) -> float:
    """Return the height at which the fingertip's centre would rest at (x, y) [mm]; 4 mm where the mesh has no vertex.

    It is found from the mesh's vertices alone, which is accurate enough to aim a hand.
    """
    points = mesh.vertices
    away = (points[:, 0] - x) ** 2 + (points[:, 1] - y) ** 2
    near = away < RADIUS**2
    if not near.any():
        return 4.0
    return float((points[near, 2] + np.sqrt(RADIUS**2 - away[near])).max())


def _strokes(mesh: trimesh.Trimesh, rng: np.random.Generator, deep: float, speed: float) -> str:
    """Return the motion of a touch and three straight strokes, through targets ``deep`` mm below the mesh's surface."""
    corners = rng.uniform(-REACH, REACH, (4, 2))
    x, y = corners[0]
    up = _height(mesh, x, y)
    moves = [
        f'<to pos="{x:.2f} {y:.2f} {up + 15.0:.2f} mm" in="0.1 s" hold="0.2 s"/>',
        f'<to pos="{x:.2f} {y:.2f} {up - deep:.2f} mm" in="0.5 s" hold="0.2 s"/>',
    ]
    for start, end in zip(corners[:-1], corners[1:], strict=True):
        length = float(np.linalg.norm(end - start))
        pieces = max(1, round(length / 8.0))
        for i in range(1, pieces + 1):
            x, y = start + (end - start) * (i / pieces)
            moves.append(
                f'<to pos="{x:.2f} {y:.2f} {_height(mesh, x, y) - deep:.2f} mm" '
                f'in="{max(0.08, length / pieces / speed):.3f} s"/>'
            )
    moves.append(f'<to pos="{x:.2f} {y:.2f} {_height(mesh, x, y) + 15.0:.2f} mm" in="0.5 s"/>')
    return "".join(moves)
