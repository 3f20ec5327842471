"""What a number, a field and a problem are; the lowest layer."""

from itouch.schema.diagnostics import ItouchError, Place, Problem, SceneError
from itouch.schema.fields import (
    REQUIRED,
    Spec,
    child,
    children,
    choice,
    flag,
    integer,
    name,
    plugin_parts,
    quantity,
    ref,
    spec_of,
    specs,
    temperature,
    text,
    validate,
)

__all__ = [
    "REQUIRED",
    "ItouchError",
    "Place",
    "Problem",
    "SceneError",
    "Spec",
    "child",
    "children",
    "choice",
    "flag",
    "integer",
    "name",
    "plugin_parts",
    "quantity",
    "ref",
    "spec_of",
    "specs",
    "temperature",
    "text",
    "validate",
]
