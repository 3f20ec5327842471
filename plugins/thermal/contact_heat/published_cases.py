"""The contacts behind published figures: a fingertip that has rested in air touches 20 mm blocks at 23 degC."""

from __future__ import annotations

from dataclasses import replace

from contact_heat.contact import Contact
from contact_heat.layers import Back, Initial, Layer, Side

_ROOM, _BLOOD = 296.15, 310.15

#: Epidermis as in the paper, dermis and fat as in burn models; core held at 37 degC.
FINGERTIP = Side(
    layers=(
        Layer(name="epidermis", thickness=7e-4, conductivity=0.34, density=1200.0, specific_heat=3340.0),
        Layer(
            name="dermis", thickness=1.5e-3, conductivity=0.45, density=1200.0, specific_heat=3300.0, perfusion=5000.0
        ),
        Layer(name="fat", thickness=4.4e-3, conductivity=0.19, density=1000.0, specific_heat=2500.0, perfusion=5000.0),
    ),
    initial=Initial(kind="steady", coefficient=10.0, ambient=_ROOM),
    back=Back(kind="temperature", temperature=_BLOOD),
    arterial=_BLOOD,
)

SENSOR = Layer(name="flux sensor", thickness=3.75e-5, conductivity=2.5, density=8933.0, specific_heat=385.0)
ALUMINIUM = Layer(name="aluminium", thickness=0.02, conductivity=200.0, density=2750.0, specific_heat=900.0)
WOOD = Layer(name="wood", thickness=0.02, conductivity=0.11, density=415.0, specific_heat=2720.0)
FOAM = Layer(name="polystyrene", thickness=0.02, conductivity=0.027, density=55.0, specific_heat=1210.0)


def block(*layers: Layer) -> Side:
    """Return an object made of layers, in air at room temperature."""
    back = Back(kind="convection", temperature=_ROOM, coefficient=10.0)
    return Side(layers=layers, initial=Initial(kind="uniform", temperature=_ROOM), back=back)


def published_cases() -> dict[str, Contact]:
    """Return the stated cases by name."""
    return {
        "wood, R 0": Contact(FINGERTIP, block(WOOD), 0.0),
        "sensor + al, R 1e-4": Contact(FINGERTIP, block(SENSOR, ALUMINIUM), 1e-4),
        "polystyrene, R 2e-3": Contact(FINGERTIP, block(FOAM), 2e-3),
    }


def many_layers() -> Contact:
    """Return a contact with 16 layers on each side."""
    tissue = tuple(replace(layer, thickness=(layer.thickness or 0.0) / 5.0) for layer in FINGERTIP.layers * 5)
    finger = replace(FINGERTIP, layers=(*tissue, tissue[-1]))
    stack = (SENSOR, *((replace(WOOD, thickness=1e-3), replace(ALUMINIUM, thickness=2e-4)) * 7), WOOD)
    return Contact(finger, block(*stack), 1e-3)
