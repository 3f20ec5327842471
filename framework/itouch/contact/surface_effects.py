"""Surface effects of objects as values (texture, layers, ...), and the table of them that the kernel reads."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from itouch.contact import effects as at
from itouch.contact.effects import EFFECTS_MEMORY
from itouch.contact.vectors import Floats

__all__ = ["AXES", "EFFECTS_MEMORY", "Effects", "Texture", "effects_table"]

AXES = {"triplanar": -1, "x": 0, "y": 1, "z": 2}


@dataclass(frozen=True, slots=True, eq=False)
class Texture:
    """A height map carved into a surface.

    Attributes
    ----------
    heights
        (rows, columns), 0 (carved by ``depth``) to 1 (at the surface).
    depth, pitch
        [m]; the pitch is the distance between samples.
    axis
        A value of AXES; -1 is triplanar.
    """

    heights: NDArray[np.float64]
    depth: float
    pitch: float
    axis: int = -1


@dataclass(frozen=True, slots=True, eq=False)
class Effects:
    """What one object's surface adds to the proxy's spring; :mod:`itouch.contact.effects` describes each effect.

    ``layers`` are (thickness [m], stiffness [N/m]) from the outside in; stick-slip has stiffness [N/m] and greatest
    force [N]; viscosity is in N s/m; the magnet has force [N] and range [m]; the steady vibration amplitude [N] and
    frequency [Hz]; a tap gain [N s/m], frequency [Hz] and time constant [s].
    """

    texture: Texture | None = None
    layers: tuple[tuple[float, float], ...] = ()
    stick_slip: tuple[float, float] = (0.0, 0.0)
    viscosity: float = 0.0
    magnet: tuple[float, float] = (0.0, 0.0)
    vibration: tuple[float, float] = (0.0, 0.0)
    tap: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def any(self) -> bool:
        """Whether there is any effect at all."""
        numbers = (*self.stick_slip, self.viscosity, *self.magnet, *self.vibration, *self.tap)
        return self.texture is not None or bool(self.layers) or any(numbers)


def effects_table(surfaces: Sequence[Effects]) -> tuple[Floats, NDArray[np.float32]] | None:
    """Return the table of effects and the samples of all height maps; None if no surface has an effect."""
    if not any(surface.any for surface in surfaces):
        return None
    table = np.zeros((len(surfaces), at.EFFECTS_WIDTH))
    samples: list[NDArray[np.float32]] = []
    used: dict[int, int] = {}
    total = 0
    for row, surface in zip(table, surfaces, strict=True):
        if surface.texture is not None:
            heights = surface.texture.heights
            if id(heights) not in used:
                used[id(heights)] = total
                samples.append(heights.ravel().astype(np.float32))
                total += heights.size
            texture = surface.texture
            row[at.TEXTURE_AT : at.TEXTURE_AXIS + 1] = (
                used[id(heights)], *heights.shape, texture.pitch, texture.depth, texture.axis,
            )  # fmt: skip
        row[at.SLIP_STIFFNESS : at.LAYERS] = (
            *surface.stick_slip, surface.viscosity, *surface.magnet, *surface.vibration, *surface.tap,
        )  # fmt: skip
        layers = surface.layers
        if len(layers) > at.MAX_LAYERS:
            raise ValueError(f"layers has {len(layers)} entries; at most {at.MAX_LAYERS} are allowed")
        row[at.LAYERS] = len(layers)
        row[at.LAYER_FIRST : at.LAYER_FIRST + 2 * len(layers)] = np.array(layers).ravel()
    flat = np.concatenate(samples) if samples else np.ones(1, np.float32)
    table.setflags(write=False)
    flat.setflags(write=False)
    return table, flat
