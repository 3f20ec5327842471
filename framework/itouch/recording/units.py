"""Units of State fields that are no device channels, by the last part of their name."""

_UNITS = {
    "m": "hip proxy point penetration near_distance plate_gap surface_height plate_yield plate_top tracking "
    "plate_true_top plate_distance position target offset",
    "m/s": "velocity",
    "N": "force normal_force contact_force peak_force plate_force total_force",
    "s": "time_to_contact",
    "K": "skin_temperature true_skin true_plate plate_temperature",
    "W/m^2": "desired flux true_flux heat_flux obtained",
    "m^2*K/W": "resistance",
    "A": "current",
}
_BY_NAME = {name: unit for unit, names in _UNITS.items() for name in names.split()}


def unit_of(field: str) -> str:
    """Return the unit of a field, or an empty string if it is a plain number or not known."""
    return _BY_NAME.get(field.rsplit(".", 1)[-1], "")
