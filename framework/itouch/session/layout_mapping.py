"""The mapping of a stored State to this program's, field by field where the layout has changed."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from itouch.plugin import Record
from itouch.session.session_error import SessionError
from itouch.world import Model


@dataclass(frozen=True, slots=True)
class Difference:
    """How two layouts differ: names with their types.

    ``added`` fields are new here and take their defaults; ``widened`` ones hold the same numbers in a wider type;
    ``lost`` and ``changed`` can't be mapped.
    """

    added: tuple[str, ...]
    widened: tuple[str, ...]
    lost: tuple[str, ...]
    changed: tuple[str, ...]
    moved: bool

    @property
    def fits(self) -> bool:
        """Whether every stored number has a place."""
        return not (self.lost or self.changed)

    def lines(self) -> list[str]:
        """Return the difference in words, a line for each field."""
        found = [f"  + {text}: new, starts at its default" for text in self.added]
        found += [f"  ~ {text}: the same numbers in a wider type" for text in self.widened]
        found += [f"  - {text}: there is no such field any more" for text in self.lost]
        found += [f"  ! {text}" for text in self.changed]
        return found or (["  the order of the fields"] if self.moved else [])


def compare(old: np.dtype[Any], new: np.dtype[Any]) -> Difference:
    """Compare a stored layout with this program's."""
    before: Mapping[str, Any] = old.fields or {}
    after: Mapping[str, Any] = new.fields or {}
    added = tuple(f"{name}: {kind[0]}" for name, kind in after.items() if name not in before)
    lost = tuple(f"{name}: {kind[0]}" for name, kind in before.items() if name not in after)
    widened, changed = [], []
    for name, kind in before.items():
        if name not in after or kind[0] == after[name][0]:
            continue
        text = f"{name}: {kind[0]} -> {after[name][0]}"
        if _maps(kind[0], after[name][0]):
            widened.append(text)
        else:
            changed.append(f"{text}: its shape or type has changed")
    return Difference(added, tuple(widened), lost, tuple(changed), tuple(before) != tuple(after))


def _maps(old: np.dtype[Any], new: np.dtype[Any]) -> bool:
    """Tell whether the other type can hold every number of this type exactly, in the same shape."""
    same = tuple(n for n in old.shape if n != 1) == tuple(n for n in new.shape if n != 1)
    plain = old.base.names is None and new.base.names is None
    return same and plain and np.can_cast(old.base, new.base, "safe")


#: Former names of fields -> the present one, or None if the field was removed: of monitors before version 1.2, some of
#: which start again because they were counted in checks; of the operator's hand; and of a probe's surface, for what is
#: the carrying modality's own now.
_FORMER: dict[str, str | None] = {
    "contact_time": "surface.contact_time", "withdrawn": "surface.withdrawn", "strayed": None, "doubted": None,
    "near_since": None, "compared": None, "tracked": None, "track": None, "heat.touched": None, "heat.samples": None,
    "heat.temperatures": None, "heat.fluxes": None, "heat.driven_from": None, "hand.wanted": "hand.target_offset",
    "surface.press": None, "surface.free": None, "surface.unfelt": None, "surface.give": None, "surface.lag": None,
}  # fmt: skip

#: Fields of the modality that carries a surface by default -> the fields that held this before it was a modality.
_REMEMBERED = {
    "surface.takes": "surface.renders", "surface.arrived": "surface.settled", "surface.lost": "surface.missed",
    "surface.yields": "plate_yield",
}  # fmt: skip

#: The greatest code of ``surface.missed`` that is the modality's own; above it: safety keeps the surface away.
_LOST = 2.0


def _renamed(stored: NDArray[Any], state: Record, removed_fields: Collection[str]) -> NDArray[Any]:
    """Return a stored State with its fields renamed to their present names."""
    fields: Mapping[str, Any] = stored.dtype.fields or {}
    names: dict[str, str | None] = {}
    for name in fields:
        device, _, rest = name.partition(".")
        if name in removed_fields and name not in state:
            names[name] = None
        elif rest in _FORMER and f"{device}.{rest}" not in state:
            moved = _FORMER[rest]
            names[name] = f"{device}.{moved}" if moved is not None else None
        elif rest == "heat.samples" and f"{device}.heat.temperatures" in fields:
            names[name] = None
    copies = {
        f"{probe}.{new}": f"{probe}.{old}" for probe in {name.partition(".")[0] for name in fields}
        for new, old in _REMEMBERED.items() if f"{probe}.{new}" in state and f"{probe}.{new}" not in fields
        and f"{probe}.{old}" in fields
    }  # fmt: skip
    if not names and not copies:
        return stored
    kept = [(names.get(name, name) or "", kind[0], name) for name, kind in fields.items() if names.get(name, name)]
    kept += [(new, fields[old][0], old) for new, old in copies.items()]
    found = np.zeros(1, np.dtype([(new, kind) for new, kind, _ in kept]))
    for new, _, name in kept:
        found[new] = stored[name]
        if new.endswith(".surface.lost"):
            found[new][stored[name] > _LOST] = 0.0
    return found


@dataclass(frozen=True, slots=True)
class ChangedFields:
    """The fields that a model's modalities have changed since earlier versions, and how these are still read.

    ``removed_fields``: their content is no longer needed; ``extended_fields``: they have more numbers at the end of
    their rows.
    """

    removed_fields: frozenset[str] = frozenset()
    extended_fields: frozenset[str] = frozenset()


def changed_fields(model: Model) -> ChangedFields:
    """Return what the model's modalities say they have changed."""
    return ChangedFields(*(
        frozenset(f"{one.name}.{field}" for one in model.modalities for field in getattr(one.instance, what))
        for what in ("removed_fields", "extended_fields")
    ))  # fmt: skip


def _lengthened(stored: NDArray[Any], state: Record, names: Collection[str]) -> NDArray[Any]:
    """Return a stored State whose shorter rows go on as those of a fresh State do."""
    fields: Mapping[str, Any] = stored.dtype.fields or {}
    shorter = {
        name for name in names & fields.keys() & set(state.dtype.names or ())
        if (then := fields[name][0]) != (now := state.dtype[name]) and then.base == now.base
        and then.shape[:-1] == now.shape[:-1] and then.shape[-1:] < now.shape[-1:]
    }  # fmt: skip
    if not shorter:
        return stored
    kinds = [(name, state.dtype[name] if name in shorter else kind[0]) for name, kind in fields.items()]
    found = np.zeros(1, np.dtype(kinds))
    for name in fields:
        if name in shorter:
            found[name][0] = state[name]
            found[name][..., : stored[name].shape[-1]] = stored[name]
        else:
            found[name] = stored[name]
    return found


def adopt(
    stored: NDArray[Any], state: Record, versions: Mapping[str, str], changed: ChangedFields = ChangedFields()
) -> tuple[bytes, list[str]]:
    """Return the stored State in this program's layout, and a notice of how the layouts differ, if they do.

    Parameters
    ----------
    stored
        One record of State, shape (1,), with the dtype and the units in which it was written.
    state
        The State of a fresh engine, from which new fields take their defaults.  It is not changed.
    versions
        The plugins that wrote it, with their versions, for the message.
    changed
        The fields that modalities have changed, see `changed_fields`.

    Raises
    ------
    SessionError
        If a stored number has no place; every field that differs is named.
    """
    if stored.dtype == state.dtype:
        return stored.tobytes(), []
    stored = _lengthened(_renamed(stored, state, changed.removed_fields), state, changed.extended_fields)
    difference = compare(stored.dtype, state.dtype)
    listed = "\n".join(difference.lines())
    written = ", ".join(f"{name} {version}" for name, version in versions.items())
    if not difference.fits:
        raise SessionError(
            f"the layout of State has changed since the snapshot (written by {written}), and not all of it can be "
            f"mapped:\n{listed}"
        )
    mapped = state.copy()
    for name in stored.dtype.names or ():
        mapped[name][...] = stored[name][0].reshape(mapped[name].shape)
    return mapped.tobytes(), [f"the layout of State has changed since the snapshot:\n{listed}"] if listed else []
