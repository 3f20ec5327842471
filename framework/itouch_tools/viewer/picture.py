"""One whole picture of the window: the scene, text over it, curves beside it, and a time line below it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pyglet import gl

from itouch.plugin import Record
from itouch.world import Model
from itouch_tools.viewer import charts, colours, legend, menu, overlay, timeline_drawing
from itouch_tools.viewer.buffers import Frame
from itouch_tools.viewer.camera import Camera
from itouch_tools.viewer.canvas import Canvas
from itouch_tools.viewer.colours import DARK, LIGHT, Tint, draw_in, look
from itouch_tools.viewer.flat_shapes import Rectangle, border, pixels, rectangle
from itouch_tools.viewer.overlay import SessionStatus, TextLines
from itouch_tools.viewer.scene_graph import NAMED, SceneGraph
from itouch_tools.viewer.signals import Curves, Ring
from itouch_tools.viewer.temperatures import plate_temperature, skin_named, skin_temperature
from itouch_tools.viewer.text import Text

_ALARM_EDGE: Tint = (1.00, 0.45, 0.30, 1.0)
#: Greatest share of a picture's width that the curves or the list of keys take.
_BESIDE = 0.32
#: Greatest share of a picture's height that curves take below the scene.
_UNDER = 0.40


@dataclass(slots=True)
class Choices:
    """What the person at the window has chosen to see."""

    thermal: bool = False
    aids: bool = True
    curves: bool = True
    #: Whether the curves stand below the scene, not beside it; None: below in a picture that is taller than wide.
    under: bool | None = None
    help: bool = False
    #: Whether a button opens the list of keys, and the mouse can press keys in it.
    menu: bool = False
    names: bool = True
    words: bool = True
    light: bool = False
    #: Whether the sound is on; None: there is no sound.
    sound: bool | None = None
    #: Factor of the size of words, 1 to 2.5.
    larger: float = 1.0


class Picture:
    """Draws a State with everything around it into frames; needs a current OpenGL context.

    ``bar`` is the area of the time line in the last picture, ``menu`` the places in it that the mouse can press;
    ``pointed`` is the position of the mouse [pixels].
    """

    def __init__(self, model: Model, *, scale: float = 1.0, ring: Curves | None = None) -> None:
        self.model, self.graph = model, SceneGraph(model)
        self.canvas, self.text = Canvas(self.graph), Text()
        self.ring: Curves = ring or Ring(model)
        self.camera = Camera()
        self.choices, self.scale = Choices(), scale
        self.bar: Rectangle | None = None
        self.menu: list[menu.Place] = []
        self.pointed = (-1.0, -1.0)
        #: Whether the last picture had its curves below the scene.
        self.under = False
        self._framed = False

    def draw(self, state: Record, frame: Frame, now: SessionStatus) -> None:
        """Draw a State into a frame, which stays bound."""
        chosen, size = self.choices, max(7.0, 8.0 * self.scale) * self.choices.larger
        draw_in(LIGHT if chosen.light else DARK)
        docked = chosen.help or (chosen.curves and self.ring.charts)
        self.under = chosen.under if chosen.under is not None else frame.height > frame.width
        below = bool(docked) and self.under and not chosen.help  # the list of keys needs the whole height
        beside = min(_BESIDE * frame.width, 46 * size) if docked and not below else 0.0
        under = min(_UNDER * frame.height, 34 * size) if below else 0.0
        self.camera.aside, self.camera.under = beside / frame.width, under / frame.height
        if not self._framed:
            self.reframe(state, frame)
        self.canvas.draw(state, self.camera, frame, thermal=chosen.thermal, aids=chosen.aids)
        gl.glDisable(gl.GL_DEPTH_TEST)
        seen = pixels(frame.width, frame.height)
        self.text.begin()
        foot = self._foot(frame, now, beside, under, seen, size)
        self.menu = self._buttons(frame.width - beside, foot, seen, size) if chosen.menu else []
        if chosen.names:
            self._names(state, frame, foot, frame.width - beside, size)
        upper = frame.height - size
        if chosen.words:
            upper = self._headline(overlay.headline(self.model, state), frame.width - beside, upper, seen, size)
            legend_top = self._scale(state, frame, foot, seen, min(size, 0.40 * (frame.width - beside) / legend.WIDE))
            words = overlay.status(self.model, state, now)
            room = int((frame.width - beside - 5 * size) / self.text.width(size))
            lines = int(min(upper - legend_top, 0.32 * frame.height) / (2.0 * size)) - 1
            self._corner(overlay.fitted(words, room, lines), frame, size, upper=upper)
        if docked and not chosen.help:
            area = (frame.width - beside - size, size, beside, frame.height - 2 * size)
            area = (size, size, frame.width - 2 * size, under) if below else area
            charts.draw(self.ring, self.canvas.paint, self.text, area, seen, size, pointed=self.pointed)
        if now.picked:
            words = overlay.properties(self.model, state, now.picked)
            self._corner(words, frame, size, upper=foot + 10.0 * size + 2.0 * size * (len(words.lines) + 0.4))
        if chosen.help:
            self._help(now, (frame.width - beside - size, size, beside, frame.height - 2 * size), frame, size)
        self.text.draw()

    def _foot(
        self, frame: Frame, now: SessionStatus, beside: float, under: float, seen: NDArray[np.float64], size: float
    ) -> float:
        """Draw the time line and the alarm; return the height above which there is room for the rest [pixels]."""
        width, foot = frame.width - beside - (3 if beside else 2) * size, size + (under + size if under else 0.0)
        self.bar = None
        if now.timeline is not None:
            area = (size, foot, width, 5.6 * size)
            timeline_drawing.draw(now.timeline, self.canvas.paint, self.text, area, seen, size)
            self.bar = timeline_drawing.bar(area, size)
            foot += area[3] + size
        large = 1.15 * size
        words = overlay.alarm(now, int((width - 5 * size) / self.text.width(large)))
        if words is not None:
            area = (size, foot, width, 2.0 * large * (len(words.lines) + 0.6))
            self.canvas.paint.draw(gl.GL_TRIANGLES, rectangle(area, look().alarm), seen)
            self.canvas.paint.draw(gl.GL_TRIANGLES, border(area, 0.25 * size, _ALARM_EDGE), seen)
            for index, (line, weight) in enumerate(words.lines):
                y = foot + area[3] - 2.0 * large * (index + 1.1) + 0.3 * size
                self.text.put(line, 2.5 * size, y, look().tint(weight), size=large)
            foot += area[3] + size
        return foot

    def _scale(self, state: Record, frame: Frame, foot: float, seen: NDArray[np.float64], size: float) -> float:
        """Draw the legend; return the height above which there is room for the rest [pixels]."""
        skin = skin_temperature(state, self.model)
        marks = {} if skin is None else {skin_named(state, self.model): skin}
        for device in self.model.devices.values():
            plate = plate_temperature(state, device)
            if plate is not None:
                marks["plate" if "plate" not in marks else f"plate {device.name}"] = plate
        told = ", ".join(f"{name} {kelvin - 273.15:.1f}" for name, kelvin in marks.items())
        title = f"{told} degC" if marks and len(told) < 44 else "skin, plates [degC]" if marks else ""
        title = title or ("objects [degC]" if self.choices.thermal else "")
        ends = self.graph.range
        area = legend.draw(self.canvas.paint, self.text, (size, foot), seen, size, title=title, marks=marks, ends=ends,
                           skin=colours.PROXY if skin is None else ends.colour(skin),
                           metre=self.camera.metre(frame.height))  # fmt: skip
        return area[1] + area[3] + size

    def _names(self, state: Record, frame: Frame, foot: float, room: float, size: float) -> None:
        """Draw the name of each object below it, where the object is wide enough and nothing is in the way.

        Where colours show temperatures, the temperature is added.
        """
        if len(self.model.objects) > NAMED:
            return
        written: list[tuple[float, float, float]] = []
        rows = [np.empty((0, 7), np.float32)]
        for element, corners in zip(self.model.scene.objects, self.graph.corners(state), strict=True):
            name = element.name
            if self.choices.thermal:
                kelvin = self.model.scene.world.temperature if element.temperature is None else element.temperature
                name += f" {kelvin - 273.15:.1f} degC"
            found = [self.camera.project(corner, frame.width, frame.height) for corner in corners]
            places = [place for place in found if place is not None]
            if len(places) < len(found):
                continue
            left, right = min(x for x, _ in places), max(x for x, _ in places)
            wide, x = len(name) * self.text.width(0.9 * size), (left + right) / 2
            y = min(y for _, y in places) - 1.5 * size
            low = foot + (12.0 * size if x - wide / 2 < (legend.WIDE + 2.0) * size else 0.0)
            free = all(abs(y - v) > 1.5 * size or abs(x - u) > (wide + w) / 2 + size for u, v, w in written)
            if free and right - left > wide and y > low and x + wide / 2 < room:
                written.append((x, y, wide))
                ground = (x - wide / 2 - 0.5 * size, y - 0.55 * size, wide + size, 1.9 * size)
                rows.append(rectangle(ground, (*look().panel[:3], 0.62)))
                self.text.put(name, x, y, look().words, size=0.9 * size, anchor="center")
        self.canvas.paint.draw(gl.GL_TRIANGLES, np.vstack(rows), pixels(frame.width, frame.height))

    def reframe(self, state: Record, frame: Frame) -> None:
        """Fit everything into the picture, with room for the arrow of a force."""
        low, high = self.graph.bounds(state)
        room = np.array([0.0, 0.0, 0.5 * self.graph.arrow_length(state)])
        self.camera.frame(low, high + room, frame.width / frame.height)
        self._framed = True

    def _corner(self, words: TextLines, frame: Frame, size: float, *, upper: float) -> None:
        if not words.lines:
            return
        self._panel(size, upper, words, frame, size)
        for index, (line, weight) in enumerate(words.lines):
            self.text.put(line, 2 * size, upper - 2.0 * size * (index + 1) + 0.1 * size, look().tint(weight), size=size)

    def _headline(self, words: str, room: float, upper: float, seen: NDArray[np.float64], size: float) -> float:
        """Draw the one large line across the top; return the height below which there is room for the rest [pixels]."""
        width = room - 2 * size
        large = min(1.9 * size, 1.9 * size * (width - 2 * size) / max(1.0, len(words) * self.text.width(1.9 * size)))
        height = 2.0 * large + 0.8 * size
        area = (size, upper - height, width, height)
        self.canvas.paint.draw(gl.GL_TRIANGLES, rectangle(area, look().panel), seen)
        self.text.put(words, 2 * size, upper - height + 0.55 * height - 0.45 * large, look().words, size=large)
        return upper - height - size

    def _buttons(self, right: float, foot: float, seen: NDArray[np.float64], size: float) -> list[menu.Place]:
        """Draw the buttons in the lower right of the scene: the menu, and the sound where there is one."""
        said = [(menu.BUTTON, "H")]
        if self.choices.sound is not None:
            said.append((menu.SOUND[self.choices.sound], "U"))
        places = []
        for words, key in said:
            width = len(words) * self.text.width(size) + 2 * size
            place = menu.Place((right - 2 * size - width, foot, width, 2.4 * size), key)
            ground = look().axis if place.holds(*self.pointed) else look().panel
            self.canvas.paint.draw(gl.GL_TRIANGLES, rectangle(place.area, ground), seen)
            self.text.put(words, place.area[0] + size, foot + 0.75 * size, look().words, size=size)
            places.append(place)
            right = place.area[0] + size
        return places

    def _help(self, now: SessionStatus, area: Rectangle, frame: Frame, size: float) -> None:
        """Draw the list of keys in place of the curves, so that the scene stays visible; what is on is in green."""
        left, bottom, width, height = area
        for _ in range(24):
            letter = self.text.width(size)
            listed = menu.rows(playback=now.timeline is not None, width=int((width - 2 * size) / letter))
            if 2.0 * size * (len(listed) + 0.5) <= height or size < 7.0:
                break
            size *= 0.95  # smaller words are better than keys that are left out
        seen = pixels(frame.width, frame.height)
        self.canvas.paint.draw(gl.GL_TRIANGLES, rectangle(area, look().help), seen)
        places = menu.places(listed, area, letter, size) if self.choices.menu else []
        for place in places:
            if place.holds(*self.pointed):
                self.canvas.paint.draw(gl.GL_TRIANGLES, rectangle(place.area, look().fine), seen)
        self.menu += places
        for index, row in enumerate(listed):
            y = bottom + height - 2.0 * size * (index + 1)
            on = row.keys in menu.SHOWS and getattr(self.choices, menu.SHOWS[row.keys])
            if y > bottom:
                self.text.put(row.text, left + size, y, look().tint("good" if on else "plain"), size=size)

    def _panel(self, left: float, upper: float, words: TextLines, frame: Frame, size: float) -> None:
        width = max(len(line) for line, _ in words.lines) * self.text.width(size) + 2 * size
        height = 2.0 * size * (len(words.lines) + 0.4)
        area = (left, upper - height, width, height)
        self.canvas.paint.draw(gl.GL_TRIANGLES, rectangle(area, look().panel), pixels(frame.width, frame.height))
