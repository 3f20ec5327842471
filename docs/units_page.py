"""The reference of units, out of the closed table."""

from __future__ import annotations

_HEAD = """# Units

Generated from the table that reads the files. A number in a scene, a material, a calibration or a curve may carry one
unit at its end, for all its components; without one it is in SI: metres, kilograms, seconds, kelvin, amperes, radians.
No file and no option changes what a number without a unit means.

| symbols | quantity | one of them in SI |
|---|---|---|
"""
_TAIL = """
Products and powers are written `N*s/m`, `W/(m*K)`, `kg/m^3`, `m^2*K/W`, `1/s`. Temperatures on the Celsius scale are
`degC` or `°C`; only absolute temperatures take it. A temperature *difference*, or an error of a sensor, is in `K` or
`mK`. `temperature="22"` is 22 K, and the message for it asks whether 22 degC was meant. There are no other units: a
pound or an inch is an error.

```xml
<material name="granite">
  <contact stiffness="2.0 N/mm" damping="2 N*s/m"/>
  <thermal:material conductivity="2.9 W/(m*K)" specific-heat="820 J/(kg*K)" density="2650 kg/m^3"/>
</material>
```

In Python everything is in SI and kelvin; recordings too, with the unit beside each channel. JSON reports, CSV exports
and screens are in the units that their names end with (`_mm`, `_ms`, `_K`, `_W_m2`), temperatures in degrees Celsius.
"""
#: Symbol -> the quantity of its kind.
KINDS = {
    "m": "length", "kg": "mass", "s": "time", "K": "temperature", "A": "current", "rad": "angle", "N": "force",
    "J": "energy", "W": "power", "V": "voltage", "ohm": "resistance", "Pa": "pressure", "Hz": "frequency",
    "%": "ratio",
}  # fmt: skip


def page() -> str:
    """Return the reference of units as Markdown."""
    from itouch.schema.units import SYMBOLS

    rows = []
    for first, quantity in KINDS.items():
        same = [symbol for symbol, (_, dimension) in SYMBOLS.items() if dimension == SYMBOLS[first][1]]
        values = ", ".join(f"{SYMBOLS[symbol][0]:.6g}" for symbol in same)
        rows.append(f"| {', '.join(f'`{symbol}`' for symbol in same)} | {quantity} | {values} |")
    return _HEAD + "\n".join(rows) + "\n" + _TAIL
