"""A session as a browser's scene: solids are sent once, then frames, forces and temperatures follow State."""

from __future__ import annotations

import base64
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from itouch.plugin import Record, poses
from itouch.recording.views import WORLD, Frame, Solid, View, arrow_of
from itouch.session.viewer_geometry import view_of
from itouch.world import Model
from itouch_tools.viewer import colours
from itouch_tools.viewer.scene_graph import NAMED, SceneGraph
from itouch_tools.viewer.temperatures import plate_temperature, skin_temperature

#: The step of temperature [K] that changes a colour.
STEP = 0.1
_RADII = {"shaft_radius": 0.0012, "head_radius": 0.003, "head_length": 0.008}
_LINES = (0.40, 0.43, 0.48)
_NOWHERE = np.zeros((1, 2, 3))
#: Direction from the scene to the browser's camera at first: in front, above, a little to the side.
_FROM = np.array([0.35, -1.0, 0.75])


class BrowserScene:
    """The nodes of one session in a server of `viser`; ``show`` brings them up to date.

    A frame's node is a child of its parent frame's node, so positions and rotations are State's own numbers.
    """

    def __init__(self, server: Any, model: Model, state: Record) -> None:
        self._server, self._model = server, model
        self._view: View = view_of(model, state)
        self._frames: dict[str, Any] = {}
        self._paths = {WORLD: "/world"}
        self._colours: dict[str, int] = {}
        self._shown: dict[str, list[float]] = {}
        self._parents = {frame.name: frame.parent for frame in self._view.frames}
        for name in self._parents:
            self._frames[name] = server.scene.add_frame(self._path(name), show_axes=False)
        self._solids = {solid.name: self._put(solid) for solid in self._view.solids}
        self._arrows = {
            force.name: server.scene.add_arrows(f"{self._paths[force.frame]}/{_part(force.name)}", _NOWHERE,
                                                _bytes(colours.FORCE), visible=False, **_RADII)
            for force in self._view.forces
        }  # fmt: skip
        self._warmths = {
            warmth.name: server.scene.add_label(f"{self._paths[warmth.frame]}/{_part(warmth.name)}", "",
                                                position=(0.0, 0.0, 0.012), anchor="bottom-left")
            for warmth in self._view.warmths
        }  # fmt: skip
        self._name_objects()
        self._words = server.gui.add_markdown("")
        self.show(state)
        self._look(state)

    def show(self, state: Record, words: str = "") -> None:
        """Show a State, and words beside it; what did not change is not sent, and what changed arrives together."""
        with self._server.atomic():
            for frame in self._view.frames:
                self._place(frame, state)
            for force in self._view.forces:
                self._force(force.name, np.asarray(state[force.field], float))
            for warmth in self._view.warmths:
                kelvin = float(np.ravel(state[warmth.field])[0])
                text = f"{kelvin - 273.15:.1f} °C" if math.isfinite(kelvin) and kelvin > 0.0 else ""
                _set(self._warmths[warmth.name], "text", text)
            self._heat(state)
            _set(self._words, "content", words)

    def _path(self, frame: str) -> str:
        """Return a frame's path in the tree of nodes: below its parent, down from the world."""
        if frame not in self._paths:
            self._paths[frame] = f"{self._path(self._parents[frame])}/{_part(frame)}"
        return self._paths[frame]

    def _place(self, frame: Frame, state: Record) -> None:
        numbers = np.ravel(state[frame.field])[frame.first : frame.first + frame.size].tolist()
        if not all(map(math.isfinite, numbers)) or self._shown.get(frame.name) == numbers:
            return
        self._shown[frame.name] = numbers
        pose = np.array([*numbers, 1.0, 0.0, 0.0, 0.0] if frame.size == 3 else numbers)
        if frame.fixed:
            pose = poses.compose(np.array(frame.fixed), pose)
        node = self._frames[frame.name]
        node.position, node.wxyz = pose[:3], pose[3:]

    def _force(self, name: str, vector: NDArray[np.float64]) -> None:
        node, ends = self._arrows[name], arrow_of(vector.tolist())
        _set(node, "visible", ends is not None)
        numbers = [] if ends is None else list(ends)
        if numbers and self._shown.get(name) != numbers:
            self._shown[name] = numbers
            node.points = np.array([[[0.0, 0.0, 0.0], numbers]])

    def _heat(self, state: Record) -> None:
        """Colour faces and the finger by their temperatures, as the window does."""
        skin = skin_temperature(state, self._model)
        warm = {probe.name: skin for probe in self._model.probes}
        for device in self._model.devices.values():
            warm[f"{device.name}/face"] = plate_temperature(state, device)
        for name, kelvin in warm.items():
            if kelvin is None or not math.isfinite(kelvin) or name not in self._solids:
                continue
            step = round(kelvin / STEP)
            if self._colours.get(name) != step:
                self._colours[name] = step
                self._solids[name].color = _bytes(colours.of_temperature(kelvin))

    def _put(self, solid: Solid) -> Any:
        """Add a solid, which does not change within its frame, and return its node."""
        scene, path = self._server.scene, f"{self._paths[solid.frame]}/{_part(solid.name)}"
        place: dict[str, Any] = {"position": solid.pose[:3], "wxyz": solid.pose[3:], "color": _bytes(solid.colour)}
        if len(solid.colour) == 4 and solid.colour[3] < 1.0:
            place["opacity"] = solid.colour[3]
        if solid.kind == "box":
            return scene.add_box(path, dimensions=solid.sizes, **place)
        if solid.kind == "ball":
            return scene.add_icosphere(path, radius=solid.sizes[0], **place)
        if solid.kind == "rod":
            return scene.add_cylinder(path, radius=solid.sizes[0], height=2 * solid.sizes[1], **place)
        points = np.frombuffer(base64.b64decode(solid.points), "<f4").reshape(-1, 3)
        corners = np.frombuffer(base64.b64decode(solid.corners), "<u4").reshape(-1, 3)
        return scene.add_mesh_simple(path, points, corners, **place)

    def _name_objects(self) -> None:
        """Add the names of objects, unless there are too many."""
        if len(self._model.objects) > NAMED:
            return
        for name in self._model.objects:
            solid = next((one for one in self._view.solids if one.name == f"object/{name}"), None)
            if solid is not None:
                self._server.scene.add_label(f"{self._paths[solid.frame]}/{_part(solid.name)}:name", name,
                                             position=solid.pose[:3], anchor="top-center")  # fmt: skip

    def _look(self, state: Record) -> None:
        """Let browsers begin with everything in the picture, over a grid of centimetres."""
        low, high = SceneGraph(self._model).bounds(state)
        middle, size = (low + high) / 2, max(0.05, float(np.linalg.norm(high - low)))
        camera = self._server.initial_camera
        camera.position, camera.look_at, camera.near = middle + 0.9 * size * _FROM, middle, 0.002
        self._server.scene.add_grid("/grid", 1.0, 1.0, cell_size=0.01, section_size=0.1, position=(0.0, 0.0, -1e-3),
                                    cell_color=_bytes(colours.GRID), section_color=_bytes(_LINES))  # fmt: skip


def _set(node: Any, name: str, value: Any) -> None:
    """Set a node's property if it differs: each setting is a message to every browser."""
    if getattr(node, name) != value:
        setattr(node, name, value)


def _part(name: str) -> str:
    """Return a name as one part of a path."""
    return name.replace("/", ":")


def _bytes(colour: Sequence[float]) -> tuple[int, int, int]:
    red, green, blue = (round(255 * min(1.0, max(0.0, part))) for part in colour[:3])
    return red, green, blue
