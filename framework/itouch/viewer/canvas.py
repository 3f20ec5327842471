"""Draws a stage: sunlit solids with shadows, the grid and the workspace."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from pyglet import gl

from itouch.plugin import Record, Role
from itouch.viewer import colours, shaders, solids
from itouch.viewer.buffers import Frame, Paint, Program, ShadowMap, Triangles
from itouch.viewer.camera import Camera
from itouch.viewer.drawing import look, rectangle
from itouch.viewer.stage import Draw, Stage, from_pose

Matrix = NDArray[np.float64]

#: Edges of the unit box, shape (24, 3): what is seen through others is made of such boxes.
_EDGES = solids.box_edges((-0.5, -0.5, -0.5), (0.5, 0.5, 0.5)).astype(np.float64)
#: Where the sun stands, seen from the scene.
SUN = np.array([0.35, -0.45, 0.82]) / math.sqrt(0.35**2 + 0.45**2 + 0.82**2)


class Canvas:
    """Draws into the framebuffer that is bound; needs a current OpenGL 3.3 context."""

    def __init__(self, stage: Stage) -> None:
        self._stage = stage
        self._solid = Program(shaders.SOLID_VERTEX, shaders.SOLID_FRAGMENT)
        self._flat = Program(shaders.DEPTH_VERTEX, shaders.FLAT_FRAGMENT)
        self._depth = Program(shaders.DEPTH_VERTEX, shaders.DEPTH_FRAGMENT)
        self.paint = Paint(Program(shaders.PAINT_VERTEX, shaders.PAINT_FRAGMENT))
        self._shadows = ShadowMap()
        self._meshes = {key: _PerProgram(solid, (self._solid, self._flat, self._depth))
                        for key, solid in stage.solids.items()}  # fmt: skip

    def draw(self, state: Record, camera: Camera, frame: Frame, *, thermal: bool = False, aids: bool = True) -> None:
        """Draw a State as the camera sees it into a frame, which stays bound."""
        draws = self._stage.draws(state, thermal=thermal)
        low, high = self._stage.bounds(state)
        lit = _sunlight(low, high)
        self._cast(draws, lit)
        frame.begin()
        gl.glClear(gl.GL_COLOR_BUFFER_BIT | gl.GL_DEPTH_BUFFER_BIT)
        gl.glEnable(gl.GL_BLEND)
        gl.glBlendFunc(gl.GL_SRC_ALPHA, gl.GL_ONE_MINUS_SRC_ALPHA)
        gl.glDisable(gl.GL_DEPTH_TEST)
        whole = rectangle((-1.0, -1.0, 2.0, 2.0), (*look().ground, 1.0), (*look().sky, 1.0))
        self.paint.draw(gl.GL_TRIANGLES, whole, np.eye(4))
        gl.glEnable(gl.GL_DEPTH_TEST)
        seen = camera.projection(frame.width / frame.height) @ camera.view()
        if aids:
            self._aids(state, seen, float(low[2]), float(max(high[:2] - low[:2])))
        hidden = [draw for draw in draws if draw.through]
        self._lit([draw for draw in draws if draw.opacity == 1.0 and not draw.through], seen, lit, camera)
        self._ghosts(hidden, seen)
        self._lit(hidden, seen, lit, camera)
        self._lit([draw for draw in draws if draw.opacity < 1.0 and not draw.through], seen, lit, camera)

    def _cast(self, draws: list[Draw], lit: Matrix) -> None:
        self._shadows.begin()
        gl.glEnable(gl.GL_DEPTH_TEST)
        gl.glEnable(gl.GL_POLYGON_OFFSET_FILL)
        gl.glPolygonOffset(2.5, 8.0)
        self._depth.use()
        self._depth.matrix("seen", lit)
        for draw in draws:
            if draw.cast:
                self._depth.matrix("world", draw.matrix)
                self._meshes[draw.solid].draw(self._depth)
        gl.glDisable(gl.GL_POLYGON_OFFSET_FILL)

    def _ghosts(self, draws: list[Draw], seen: Matrix) -> None:
        """Show solids through what hides them: their faces faintly, their edges in full."""
        gl.glDepthFunc(gl.GL_GREATER)
        gl.glDepthMask(gl.GL_FALSE)
        gl.glEnable(gl.GL_CULL_FACE)
        self._flat.use()
        self._flat.matrix("seen", seen)
        for draw in draws:
            self._flat.matrix("world", draw.matrix)
            self._flat.vector("colour", *draw.colour, 0.22)
            self._meshes[draw.solid].draw(self._flat)
        gl.glDisable(gl.GL_CULL_FACE)
        for draw in draws:
            edges = _EDGES @ draw.matrix[:3, :3].T + draw.matrix[:3, 3]
            light = tuple(0.5 + 0.5 * part for part in draw.colour)
            self.paint.draw(gl.GL_LINES, tinted(edges.astype(np.float32), (light[0], light[1], light[2], 0.9)), seen)
        gl.glDepthMask(gl.GL_TRUE)
        gl.glDepthFunc(gl.GL_LESS)

    def _lit(self, draws: list[Draw], seen: Matrix, lit: Matrix, camera: Camera) -> None:
        program = self._solid
        program.use()
        program.matrix("seen", seen)
        program.matrix("lit", lit)
        program.vector("eye", *camera.eye.tolist())
        program.vector("sun", *SUN.tolist())
        program.unit("shadows", 0)
        gl.glActiveTexture(gl.GL_TEXTURE0)
        gl.glBindTexture(gl.GL_TEXTURE_2D, self._shadows.texture)
        for draw in draws:
            glass = draw.opacity < 1.0  # its inside is not seen, and it does not darken itself
            (gl.glEnable if glass else gl.glDisable)(gl.GL_CULL_FACE)
            program.vector("dark", 0.0 if glass else 1.0)
            program.matrix("world", draw.matrix)
            turned = np.asarray(np.linalg.inv(draw.matrix[:3, :3]).T, np.float64)
            program.matrix("turned", turned)
            program.vector("colour", *draw.colour, draw.opacity)
            program.vector("gloss", draw.gloss)
            self._meshes[draw.solid].draw(program)
        gl.glDisable(gl.GL_CULL_FACE)

    def _aids(self, state: Record, seen: Matrix, floor: float, width: float) -> None:
        step = 10.0 ** math.floor(math.log10(max(width, 1e-3) / 4.0))
        lines = solids.grid(max(1.5 * width, 4 * step), step) + np.array([0, 0, floor - 2e-4], np.float32)
        self.paint.draw(gl.GL_LINES, tinted(lines, (*look().grid, 0.8)), seen)
        for device in self._stage.tables:
            target = device.command(Role.SURFACE_POSE)
            if target is None or not target.low or not np.isfinite((*target.low[:3], *target.high[:3])).all():
                continue
            low, high = target.low[:3], target.high[:3]
            edges = solids.box_edges((low[0], low[1], low[2]), (high[0], high[1], high[2]))
            place = from_pose(np.asarray(device.mount))
            moved = edges @ place[:3, :3].T.astype(np.float32) + place[:3, 3].astype(np.float32)
            self.paint.draw(gl.GL_LINES, tinted(moved, (*colours.SPACE, 0.5)), seen)

    def pick(self, state: Record, camera: Camera, frame: Frame, x: int, y: int) -> str:
        """Return the name of the object or device at a pixel, counted from the lower left; empty if there is none."""
        draws = [draw for draw in self._stage.draws(state) if draw.owner]
        frame.begin()
        gl.glClearColor(0.0, 0.0, 0.0, 0.0)
        gl.glClear(gl.GL_COLOR_BUFFER_BIT | gl.GL_DEPTH_BUFFER_BIT)
        gl.glEnable(gl.GL_DEPTH_TEST)
        gl.glDisable(gl.GL_BLEND)
        self._flat.use()
        self._flat.matrix("seen", camera.projection(frame.width / frame.height) @ camera.view())
        for number, draw in enumerate(draws, 1):
            self._flat.matrix("world", draw.matrix)
            self._flat.vector("colour", (number & 255) / 255.0, (number >> 8) / 255.0, 0.0, 1.0)
            self._meshes[draw.solid].draw(self._flat)
        pixels = frame.read()
        if not (0 <= x < frame.width and 0 <= y < frame.height):
            return ""
        red, green, _ = pixels[frame.height - 1 - y, x]
        number = int(red) + 256 * int(green)
        return draws[number - 1].owner if 0 < number <= len(draws) else ""


class _PerProgram:
    """A solid with one vertex array a program, because their attributes may stand in other places."""

    def __init__(self, solid: solids.Solid, programs: tuple[Program, ...]) -> None:
        self._arrays = {program.id: Triangles(solid, program) for program in programs}

    def draw(self, program: Program) -> None:
        self._arrays[program.id].draw()


def tinted(points: NDArray[np.float32], colour: tuple[float, float, float, float]) -> NDArray[np.float32]:
    """Return rows of position and colour, shape (n, 7)."""
    return np.hstack([points, np.tile(np.array(colour, np.float32), (len(points), 1))])


def _sunlight(low: NDArray[np.float64], high: NDArray[np.float64]) -> Matrix:
    """Return the matrix of the sun's parallel view of a box."""
    middle, radius = (low + high) / 2, 1.3 * float(np.linalg.norm(high - low)) / 2 + 1e-3
    right = np.cross([0.0, 1.0, 0.0], SUN)
    right /= np.linalg.norm(right)
    view = np.eye(4)
    view[:3, :3] = (right, np.cross(SUN, right), SUN)
    view[:3, 3] = -view[:3, :3] @ (middle + 2 * radius * SUN)
    ortho = np.diag((1 / radius, 1 / radius, -1 / (1.5 * radius), 1.0))
    ortho[2, 3] = -4.0 / 3.0
    return ortho @ view
