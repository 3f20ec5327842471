"""Which recorded flux curve is played for each object, and which modality's computed flux it replaces."""

from __future__ import annotations

from itouch.plugin import ParameterError, World
from itouch_thermal.flux.curve import LARGEST_FILE, Curve, decode_curve
from itouch_thermal.flux.flux_control_params import FluxControlParams


def curves_of(params: FluxControlParams, world: World) -> tuple[Curve | None, ...]:
    """Return the recorded curve of each object, None for those that have none.

    Raises
    ------
    ValueError
        If a file can't be read, or an object has neither a curve nor a modality that computes its flux.
    """
    if params.target != "file":
        return (None,) * len(world.objects)
    read: dict[str, Curve] = {}
    files = {curve.material: curve.file for curve in params.curves}
    for curve in params.curves:
        read[curve.file] = _read(world, curve.file, f"curve of '{curve.material}': ")
    if params.file:
        read[params.file] = _read(world, params.file, "")
    found: list[Curve | None] = []
    for element in world.objects:
        name = files.get(element.material_name, params.file)
        if not name and not params.desired_from:
            raise ValueError(
                f"object '{element.name}' of '{element.material_name}' has no flux curve: give 'file', a <curve>, or "
                "'desired-from'"
            )
        found.append(read[name] if name else None)
    return tuple(found)


def _read(world: World, name: str, what: str) -> Curve:
    try:
        return decode_curve(world.read(name, LARGEST_FILE), name)
    except ValueError as error:
        raise ParameterError("file", f"{what}{error}") from error


def played_curves(name: str, world: World) -> tuple[Curve | None, ...]:
    """Return the recorded curve that replaces, for each object, the flux that modality ``name`` computes, or None."""
    for params in world.modalities.values():
        if isinstance(params, FluxControlParams) and params.desired_from == name and params.target == "file":
            try:
                return curves_of(params, world)
            except ValueError:
                break  # reported for the controller, at its place in the scene
    return (None,) * len(world.objects)
