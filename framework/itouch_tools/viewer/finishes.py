"""What the materials of a model look like: colour, finish, and the height map that is carved into them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from itouch.contact.heightmap import height_map
from itouch.contact.surface_effects import AXES
from itouch.recording.views import UNPAINTED
from itouch.world import Model
from itouch_tools.viewer.colours import Colour

#: The number of each finish in the shader, see ``shading``.
FINISHES = {"matte": 0, "metal": 1, "glass": 2, "wood": 3, "foam": 4}


@dataclass(frozen=True, slots=True, eq=False)
class CarvedSurface:
    """A height map that is carved into a surface.

    ``heights`` (rows, columns) are 0 to 1, the bottom row first; ``size`` is the width and the height of the map on the
    surface [m], ``depth`` how deep a height of 0 is carved [m]; ``axis`` as in ``itouch.contact.effects``.
    """

    heights: NDArray[np.float32]
    size: tuple[float, float]
    depth: float
    axis: int


@dataclass(frozen=True, slots=True)
class Finish:
    """How a material is drawn; ``kind`` is one of the numbers of FINISHES."""

    colour: Colour = UNPAINTED
    kind: int = 0
    carved: CarvedSurface | None = None


def finishes(model: Model) -> dict[str, Finish]:
    """Return how each material of a model is drawn, by name."""
    files = {file.file: file.data for file in model.files}
    found = {}
    for material in model.scene.materials:
        texture, visual = material.texture, material.visual
        carved = None
        if texture is not None and texture.file in files:
            heights = height_map(files[texture.file])
            rows, columns = heights.shape
            size = (texture.width, texture.width * rows / columns)
            lowest_first = np.ascontiguousarray(heights[::-1], np.float32)
            carved = CarvedSurface(lowest_first, size, texture.depth, AXES[texture.projection])
        kind = 0 if visual is None else FINISHES[visual.finish]
        found[material.name] = Finish(UNPAINTED if visual is None else visual.color, kind, carved)
    return found
