"""The shipped material library: the paper's materials and the handbook's, read from their scene documents."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from contact_heat.layers import Layer
from itouch.plugin import ItouchError
from itouch.plugin.commands import framework

#: Documents of the library, in the shipped scenes' folder.
DOCUMENTS = ("materials.xml", "handbook.xml")

#: Source of a document's values for materials that do not name their own.
_SOURCES = {"materials.xml": "the I-Touch thermal display paper, section II-E"}
_FLAGS = {
    ("materials.xml", "wood"): "; specific heat and density stand swapped there, here they are the right way round"
}


@dataclass(frozen=True, slots=True)
class LibraryMaterial:
    """A material with its heat properties (SI), effusivity [W s^1/2 / m2K] and source."""

    name: str
    layer: Layer
    source: str

    @property
    def effusivity(self) -> float:
        """Thermal effusivity [W s^1/2 / m2K]."""
        return self.layer.effusivity


def library(documents: Sequence[str | Path] = ()) -> tuple[LibraryMaterial, ...]:
    """Return the materials of scene documents, by default those of the shipped library.

    Raises
    ------
    itouch.SceneError
        If a document can't be read.
    """
    paths = [Path(path) for path in documents] or [_shipped() / name for name in DOCUMENTS]
    return tuple(material for path in paths for material in _read(path))


def _shipped() -> Path:
    """Return the folder of the shipped scenes, in a wheel or in a checkout."""
    package = Path(framework().__file__).parent
    for folder in (package / "scenes", package.parents[1] / "scenes"):
        if (folder / DOCUMENTS[0]).is_file():
            return folder
    raise ItouchError("the shipped materials are missing from this installation; install itouch-py again")


def _read(path: Path) -> list[LibraryMaterial]:
    found = []
    for material in framework().load(path).materials:
        for part in material.parts:
            value = part.params
            if not hasattr(value, "specific_heat"):
                continue
            source = value.source or _SOURCES.get(path.name, "") + _FLAGS.get((path.name, material.name), "")
            layer = Layer(
                name=material.name,
                conductivity=value.conductivity,
                density=value.density,
                specific_heat=value.specific_heat,
            )
            found.append(LibraryMaterial(material.name, layer, source))
    return found
