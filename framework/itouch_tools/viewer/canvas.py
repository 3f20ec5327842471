"""Draws a scene graph: sunlit solids with shadows, the grid and the workspace."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from pyglet import gl

from itouch.plugin import Record, Role
from itouch_tools.viewer import colours, shaders, shading, solids
from itouch_tools.viewer.buffers import Frame, HeightMap, Paint, Program, ShadowMap, Triangles
from itouch_tools.viewer.camera import Camera
from itouch_tools.viewer.colours import look
from itouch_tools.viewer.finishes import FINISHES, CarvedSurface
from itouch_tools.viewer.flat_shapes import rectangle
from itouch_tools.viewer.scales import grid_step
from itouch_tools.viewer.scene_graph import Draw, SceneGraph, from_pose

Matrix = NDArray[np.float64]

#: Edges of the unit box, shape (24, 3): all that is shown through other solids is made of such boxes.
_EDGES = solids.box_edges((-0.5, -0.5, -0.5), (0.5, 0.5, 0.5)).astype(np.float64)
_NONE = np.empty((0, 3))
_GLASS = FINISHES["glass"]
#: Polygon offset of what is shown through other solids, to draw it a little farther away: factor of slope, and units.
_BEHIND = (1.0, 64.0)
#: Direction of the sun, seen from the scene: a unit vector.
SUN = np.array([0.35, -0.45, 0.82]) / math.sqrt(0.35**2 + 0.45**2 + 0.82**2)


class Canvas:
    """Draws into the framebuffer that is bound; needs a current OpenGL 3.3 context."""

    def __init__(self, graph: SceneGraph) -> None:
        self._graph = graph
        self._solid = Program(shading.VERTEX, shading.FRAGMENT)
        self._flat = Program(shaders.DEPTH_VERTEX, shaders.FLAT_FRAGMENT)
        self._depth = Program(shaders.DEPTH_VERTEX, shaders.DEPTH_FRAGMENT)
        self.paint = Paint(Program(shaders.PAINT_VERTEX, shaders.PAINT_FRAGMENT))
        self._shadows = ShadowMap()
        self._meshes = {key: _PerProgram(solid, (self._solid, self._flat, self._depth))
                        for key, solid in graph.solids.items()}  # fmt: skip
        self._edges = {key: solids.feature_edges(solid) for key, solid in graph.solids.items()
                       if key.startswith("object ")}  # fmt: skip
        self._maps = {id(carved): HeightMap(carved.heights) for carved in graph.carved}
        self._flat_map = HeightMap(np.ones((1, 1), np.float32))

    def draw(self, state: Record, camera: Camera, frame: Frame, *, thermal: bool = False, aids: bool = True) -> None:
        """Draw a State as the camera sees it into a frame, which stays bound."""
        draws = self._graph.draws(state, thermal=thermal)
        low, high = self._graph.bounds(state)
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
        hidden, clear = [draw for draw in draws if draw.through], [draw for draw in draws if draw.finish == _GLASS]
        solid = [draw for draw in draws if draw.opacity == 1.0 and not draw.through and draw.finish != _GLASS]
        self._lit(solid, seen, lit, camera)
        self._outline(solid, seen)
        self._lit(clear, seen, lit, camera)
        self._outline(clear, seen)
        gl.glEnable(gl.GL_POLYGON_OFFSET_FILL)
        gl.glPolygonOffset(*_BEHIND)  # a plate's top lies in the virtual surface: the surface is drawn in front of it
        self._ghosts(hidden, seen)
        self._lit(hidden, seen, lit, camera)
        gl.glDisable(gl.GL_POLYGON_OFFSET_FILL)
        self._lit([draw for draw in draws if draw.opacity < 1.0 and not draw.through], seen, lit, camera)

    def _outline(self, draws: list[Draw], seen: Matrix) -> None:
        """Draw the sharp edges of objects, a little nearer than they are, so that their own faces do not hide them."""
        near = np.diag((1.0, 1.0, 1.0, 1.0))
        near[2, 3] = -2e-4
        rows = [np.empty((0, 7), np.float32)]
        for draw in draws:
            edges = self._edges.get(draw.solid, _EDGES if draw.owner and draw.solid == "unit box" else _NONE)
            tint = (*(0.42 * part for part in draw.colour), 0.55) if draw.finish != _GLASS else (0.95, 1.0, 1.0, 0.75)
            moved = edges @ draw.matrix[:3, :3].T + draw.matrix[:3, 3]
            rows.append(tinted(moved.astype(np.float32), (tint[0], tint[1], tint[2], tint[3])))
        self.paint.draw(gl.GL_LINES, np.vstack(rows), near @ seen)

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
        program.vector("texel", 2.0 / (self._shadows.size * float(np.linalg.norm(lit[0, :3]))))
        program.vector("eye", *camera.eye.tolist())
        program.vector("sun", *SUN.tolist())
        program.unit("shadows", 0)
        program.unit("heights", 1)
        gl.glActiveTexture(gl.GL_TEXTURE0)
        gl.glBindTexture(gl.GL_TEXTURE_2D, self._shadows.texture)
        for draw in draws:
            glass = draw.opacity < 1.0  # its inner faces are not drawn, and it casts no shadow on itself
            (gl.glEnable if glass else gl.glDisable)(gl.GL_CULL_FACE)
            program.vector("dark", 0.0 if glass else 1.0)
            program.matrix("world", draw.matrix)
            turned = np.asarray(np.linalg.inv(draw.matrix[:3, :3]).T, np.float64)
            program.matrix("turned", turned)
            program.vector("colour", *draw.colour, draw.opacity)
            program.vector("gloss", draw.gloss)
            program.vector("finish", float(draw.finish))
            self._carve(draw.carved)
            self._meshes[draw.solid].draw(program)
        gl.glDisable(gl.GL_CULL_FACE)

    def _carve(self, carved: CarvedSurface | None) -> None:
        """Set the height map that is carved into what is drawn next; None: a flat one."""
        size = (1.0, 1.0, 0.0, -1.0) if carved is None else (*carved.size, carved.depth, float(carved.axis))
        self._solid.vector("carve", *size)
        found = self._flat_map if carved is None else self._maps[id(carved)]
        gl.glActiveTexture(gl.GL_TEXTURE1)
        gl.glBindTexture(gl.GL_TEXTURE_2D, found.texture)
        gl.glActiveTexture(gl.GL_TEXTURE0)

    def _aids(self, state: Record, seen: Matrix, floor: float, width: float) -> None:
        step = grid_step(width)
        lines, strength = solids.grid(max(1.5 * width, 4 * step), step)
        lines = lines + np.array([0, 0, floor - 2e-4], np.float32)
        rows = tinted(lines, (*look().grid, 1.0))
        rows[:, 6] *= strength
        self.paint.draw(gl.GL_LINES, rows, seen)
        for device in self._graph.tables:
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
        draws = [draw for draw in self._graph.draws(state) if draw.owner]
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
    """A solid with one vertex array per program, because the programs may have their attributes at other locations."""

    def __init__(self, solid: solids.Solid, programs: tuple[Program, ...]) -> None:
        self._arrays = {program.id: Triangles(solid, program) for program in programs}

    def draw(self, program: Program) -> None:
        self._arrays[program.id].draw()


def tinted(points: NDArray[np.float32], colour: tuple[float, float, float, float]) -> NDArray[np.float32]:
    """Return rows of position and colour, shape (n, 7).

    ``points`` (n, 3) [m] or [pixels], ``colour`` four numbers from 0 to 1.
    """
    return np.hstack([points, np.tile(np.array(colour, np.float32), (len(points), 1))])


def _sunlight(low: NDArray[np.float64], high: NDArray[np.float64]) -> Matrix:
    """Return the matrix (4, 4) of the sun's orthographic view of a box with these corners (3,) [m]."""
    middle, radius = (low + high) / 2, 1.3 * float(np.linalg.norm(high - low)) / 2 + 1e-3
    right = np.cross([0.0, 1.0, 0.0], SUN)
    right /= np.linalg.norm(right)
    view = np.eye(4)
    view[:3, :3] = (right, np.cross(SUN, right), SUN)
    view[:3, 3] = -view[:3, :3] @ (middle + 2 * radius * SUN)
    ortho = np.diag((1 / radius, 1 / radius, -1 / (1.5 * radius), 1.0))
    ortho[2, 3] = -4.0 / 3.0
    return ortho @ view
