"""A limit in words, with the unit that people use for it."""

from __future__ import annotations

_UNITS: dict[str, tuple[float, str]] = {
    "force": (1.0, "N"), "torque": (1.0, "N m"), "speed": (1.0, "m/s"), "speed_near": (1.0, "m/s"),
    "current": (1.0, "A"),
    "plate_force": (1.0, "N"), "contact_time": (1.0, "s"), "plate_rate": (1.0, "K/s"), "flux": (1e-3, "kW/m^2"),
    "dose": (1.0 / 60.0, "min CEM43"), "watchdog": (1e3, "ms"), "ramp": (1.0, "s"), "cold_time": (1.0, "s"),
}  # fmt: skip


def shown(name: str, value: float | tuple[float, ...] | list[float] | None) -> str:
    """Return a limit's value in words; a range is one of temperatures."""
    if value is None:
        return "none"
    if isinstance(value, (tuple, list)):
        low, high = (kelvin - 273.15 for kelvin in value)
        return f"{low:.4g} to {high:.4g} degC"
    factor, unit = _UNITS.get(name, (1.0, ""))
    return f"{value * factor:.4g} {unit}".rstrip()
