"""Dataclass fields as grammar: one declaration gives parsing, checks, messages, editor schema and reference.

A scene element is a frozen dataclass whose fields are declared by the functions here.  The attribute
``static-friction`` is the field ``static_friction``; a field named like a Python keyword has a trailing underscore
(``in_``).

>>> from dataclasses import dataclass
>>> @dataclass(frozen=True)
... class Lever:
...     travel: float = quantity("m", low=1e-3, high=0.2, default=0.05, doc="stroke of the lever")
>>> spec_of(Lever, "travel").unit
'm'
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import MISSING, dataclass
from functools import cache
from typing import Any, Literal, get_args

from itouch.schema.roles import Role
from itouch.schema.units import SYMBOLS, parse_unit

Kind = Literal[
    "quantity", "hold", "integer", "text", "file", "name", "ref", "choice", "flag", "child", "children", "plugin"
]

#: Marks a field that must be given.
REQUIRED = MISSING
#: What the XML namespace of a plugin's elements and attributes begins with; its name follows.
PLUGIN_NAMESPACE = "urn:itouch:plugin:"

_KEY = "itouch"
#: By how much rounding may take a temperature that is written in degC past the end of its range [K].
ROUNDING = 1e-9


@dataclass(frozen=True, slots=True)
class Spec:
    """What a field may hold; the grammar of one attribute or child element."""

    kind: Kind
    doc: str = ""
    unit: str = ""
    size: int | tuple[int, ...] = 1
    low: float = -math.inf
    high: float = math.inf
    open_low: bool = False
    absolute: bool = False
    values: tuple[str, ...] = ()
    target: str = ""
    reads: tuple[str | Role, ...] = ()
    commands: tuple[str | Role, ...] = ()
    elements: tuple[type, ...] = ()
    tag: str = ""

    @property
    def scalar(self) -> bool:
        """Whether the value is one number rather than a tuple."""
        return self.size == 1

    def range_text(self) -> str:
        """Return the allowed range in words, or an empty string if there is none."""
        unit = f" {self.unit}" if self.unit else ""
        if math.isfinite(self.low) and math.isfinite(self.high):
            return f"{'above ' if self.open_low else ''}{self.low:g} to {self.high:g}{unit}"
        if math.isfinite(self.low):
            return f"{'more than' if self.open_low else 'at least'} {self.low:g}{unit}"
        if math.isfinite(self.high):
            return f"at most {self.high:g}{unit}"
        return ""

    def admits(self, value: float) -> bool:
        """Tell whether a number is in the range.

        An end of a range of temperatures belongs to it however it was written: -20 degC are 253.14999999999998 K.
        """
        slack = ROUNDING if self.absolute else 0.0
        return (value > self.low if self.open_low else value >= self.low - slack) and value <= self.high + slack


class ParameterError(ValueError):
    """A parameter that cannot work: ``field`` names it, so that the problem points at its attribute.

    ``advice`` says what to do; empty: the message does.
    """

    advice: str = ""

    def __init__(self, field: str, message: str, advice: str = "") -> None:
        super().__init__(message)
        self.field, self.advice = field, advice


def _make(spec: Spec, default: Any) -> Any:
    return dataclasses.field(default=default, metadata={_KEY: spec}, kw_only=True)


def quantity(
    unit: str,
    *,
    size: int | tuple[int, ...] = 1,
    low: float = -math.inf,
    high: float = math.inf,
    positive: bool = False,
    absolute: bool = False,
    default: Any = REQUIRED,
    doc: str = "",
) -> Any:
    """Declare a number, or a tuple of ``size`` numbers, with a unit; ``positive`` means more than zero.

    Raises
    ------
    ValueError
        If the unit is none of those that a scene may write: no scene could give it.
    """
    try:
        parse_unit(unit)
    except ValueError:
        raise ValueError(f"unit {unit!r} is not known: declare it in {', '.join(SYMBOLS)}, degC, "
                         "or a product of these such as 'N*s/m'; '' is a plain number") from None  # fmt: skip
    low = 0.0 if positive else low
    spec = Spec("quantity", doc, unit, size, low, high, positive, absolute or unit == "degC")
    return _make(spec, default)


def temperature(
    *, low: float = 0.0, high: float = 5000.0, size: int = 1, default: Any = REQUIRED, doc: str = ""
) -> Any:
    """Declare an absolute temperature [K]; files may write degC."""
    return quantity("K", low=low, high=high, size=size, absolute=True, default=default, doc=doc)


def hold(*, high: float, default: Any = REQUIRED, doc: str = "") -> Any:
    """Declare a duration [s] of at most ``high``, or a wait for a condition: a float, or an `Until`."""
    return _make(Spec("hold", doc, "s", low=0.0, high=high), default)


def integer(*, low: float = -math.inf, high: float = math.inf, default: Any = REQUIRED, doc: str = "") -> Any:
    """Declare a whole number."""
    return _make(Spec("integer", doc, low=low, high=high), default)


def text(*, default: Any = REQUIRED, doc: str = "") -> Any:
    """Declare free text."""
    return _make(Spec("text", doc), default)


def file(*, default: Any = REQUIRED, doc: str = "") -> Any:
    """Declare the path of a file in the scene's folder; it is written relative to the file that names it.

    The value of the field is relative to the scene's folder.
    """
    return _make(Spec("file", doc), default)


def name(*, default: Any = REQUIRED, doc: str = "its name, unique in the scene") -> Any:
    """Declare the name that other elements refer to."""
    return _make(Spec("name", doc), default)


def ref(
    target: str,
    *,
    reads: tuple[str | Role, ...] = (),
    commands: tuple[str | Role, ...] = (),
    default: Any = REQUIRED,
    doc: str = "",
) -> Any:
    """Declare a reference to a named ``device``, ``probe``, ``object``, ``material`` or ``modality``.

    For a device, ``reads`` and ``commands`` say which channels it must have: by a role, or by a name.
    """
    return _make(Spec("ref", doc, target=target, reads=reads, commands=commands), default)


def choice(*values: str, default: Any = REQUIRED, doc: str = "") -> Any:
    """Declare one word of a closed set."""
    return _make(Spec("choice", doc, values=values), default)


def flag(*, also: tuple[str, ...] = (), default: Any = REQUIRED, doc: str = "") -> Any:
    """Declare a yes or no; ``also`` are further words that are allowed, which become the value as they are."""
    return _make(Spec("flag", doc, values=also), default)


def child(element: type, *, tag: str = "", default: Any = None, doc: str = "") -> Any:
    """Declare a child element that occurs at most once."""
    return _make(Spec("child", doc, elements=(element,), tag=tag), default)


def children(element: type | tuple[type, ...], *, tag: str = "", doc: str = "") -> Any:
    """Declare child elements of one or several kinds, any number of them, kept in file order as a tuple."""
    elements = element if isinstance(element, tuple) else (element,)
    return _make(Spec("children", doc, elements=elements, tag=tag), ())


def tag_of(element: type, spec: Spec | None = None) -> str:
    """Return the tag of an element class: that of the field, else the class's TAG, else its name."""
    own: str = spec.tag if spec is not None and spec.tag else getattr(element, "TAG", "")
    return own or xml_name(element.__name__.lower())


def plugin_parts(*, doc: str = "") -> Any:
    """Declare that elements of plugin namespaces are allowed here; they become a tuple of plugin parts."""
    return _make(Spec("plugin", doc), ())


def xml_name(field_name: str) -> str:
    """Turn a field name into the attribute's: ``static_friction`` -> ``static-friction``, ``in_`` -> ``in``."""
    return field_name.rstrip("_").replace("_", "-")


def specs(cls: type) -> dict[str, Spec]:
    """Return the grammar of a dataclass: field name -> spec, in declared order.

    A class from elsewhere is grammar too if the metadata of its fields are the arguments of a ``Spec``: a library need
    not know this program to declare what its fields may hold.  Metadata with another meaning are ignored.
    """
    found = {}
    for field in dataclasses.fields(cls):
        if _KEY in field.metadata:
            found[field.name] = field.metadata[_KEY]
        elif field.metadata.get("kind") in _KINDS and _ARGUMENTS.issuperset(field.metadata):
            found[field.name] = _foreign(field)
    return found


_KINDS: tuple[object, ...] = get_args(Kind)
_ARGUMENTS: frozenset[object] = frozenset(field.name for field in dataclasses.fields(Spec))


@cache
def _foreign(field: dataclasses.Field[Any]) -> Spec:
    return Spec(**field.metadata)


def spec_of(cls: type, field_name: str) -> Spec:
    """Return the spec of one field."""
    return specs(cls)[field_name]


def default_of(cls: type, field_name: str) -> Any:
    """Return the default of a field, or REQUIRED; raise ValueError if the class has no such field."""
    for field in dataclasses.fields(cls):
        if field.name == field_name:
            return field.default
    raise ValueError(f"{cls.__name__} has no field '{field_name}'")


def constraint(cls: type, kind: str) -> tuple[tuple[str, ...], ...]:
    """Return the EXCLUSIVE, TOGETHER, ONE_OF or REQUIRES constraint that a class declares; empty if it has none."""
    found: tuple[tuple[str, ...], ...] = getattr(cls, kind, ())
    return found


def check_range(spec: Spec, field_name: str, value: float | tuple[float, ...]) -> None:
    """Check numbers against a spec's range and finiteness.

    Raises
    ------
    ValueError
        Naming the field, the value and the allowed range.
    """
    for number in (value,) if isinstance(value, (int, float)) else value:
        if not math.isfinite(number) or not spec.admits(number):
            raise ValueError(f"{field_name} = {number!r} is out of range: {spec.range_text() or 'a finite number'}")


def host_port(address: str, *, port: int | None = None) -> tuple[str, int]:
    """Return the host and the port of ``HOST:PORT``; with ``port``, an address may do without one.

    An IPv6 address stands in brackets, as in ``[::1]:502``; they are not part of the host.

    Raises
    ------
    ValueError
        If the text is not of that form, or the port is not one of 1 to 65535.
    """
    host, colon, number = address.rpartition(":")
    if port is not None and (not colon or address.endswith("]")):
        host, number = address, str(port)
    good = number.isascii() and number.isdecimal() and len(number) <= 5 and 0 < int(number) < 65536
    bare = host[1:-1] if host.startswith("[") and host.endswith("]") else host
    if not good or not bare or (":" in bare) != (bare != host) or any(c in "[]" or c.isspace() for c in bare):
        form = "HOST:PORT" if port is None else "HOST or HOST:PORT"
        raise ValueError(f"'{address}' must be {form}, with a port of 1 to 65535")
    return bare, int(number)


def validate(instance: Any) -> None:
    """Check every quantity of a dataclass instance that was built in Python; call it from ``__post_init__``.

    Raises
    ------
    ValueError
        Naming the field and the allowed range.
    """
    for field_name, spec in specs(type(instance)).items():
        value = getattr(instance, field_name)
        if spec.kind not in ("quantity", "integer") or value is None:
            continue
        if not isinstance(value, (int, float, tuple)) or isinstance(value, bool):
            raise ValueError(f"{field_name} = {value!r} is not a number")
        check_range(spec, field_name, value)
