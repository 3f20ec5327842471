"""Parts of a faulty scene whose meaning is uncertain; problems that only follow from them are not reported."""

from __future__ import annotations

from dataclasses import dataclass

from itouch.scene.elements import Material

#: Kind and name of an element; a section's kind is ``section``, its name its tag.
Named = tuple[str, str]


@dataclass(frozen=True, slots=True)
class UncertainParts:
    """What other checks must not count on.

    Attributes
    ----------
    unsound
        Elements with a problem of their own, whether they are left out of the scene or not.  The name is empty where
        it could not be read, the kind where an element is not known in its place.
    whole
        Whether all files of the scene could be read.
    remnants
        Materials that are left out, as far as they could be read.
    wanted
        What the elements with a problem refer to.
    """

    unsound: frozenset[Named] = frozenset()
    whole: bool = True
    remnants: tuple[Material, ...] = ()
    wanted: frozenset[Named] = frozenset()


NOTHING_UNCERTAIN = UncertainParts()
