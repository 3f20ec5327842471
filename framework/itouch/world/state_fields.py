"""The fields of State of a probe and of a hand, as tables; `state` puts them together with those of plugins."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any

import numpy as np

from itouch.plugin import Field
from itouch.plugin.record import dtype_of
from itouch.schema.plugin_errors import ReturnedError

#: How many cells the tissue of a finger has under a worn device.
CELLS = 24

#: The figures that one tick writes; their order is that of ``itouch.loop.render``.
FIGURES = (
    Field(
        "hip", "f8", 3, unit="m", doc="position of the fingertip's centre (haptic interface point), from `pose-from`"
    ),
    Field("velocity", "f8", 3, unit="m/s", doc="its velocity, filtered over 2 ms"),
    Field("proxy", "f8", 3, unit="m", doc="where the fingertip would be if objects were impenetrable"),
    Field(
        "force",
        "f8",
        3,
        unit="N",
        doc="force of the virtual coupling, stiffness x (proxy - hip); zero in free space",
        show="wish: force | virtual",
    ),
    Field("normal", "f8", 3, unit="1", doc="outward normal of the touched surface"),
    Field("point", "f8", 3, unit="m", doc="touched point of the surface"),
    Field("penetration", unit="m", doc="depth of the hip below where the surface stops the probe"),
    Field("normal_force", unit="N", doc="share of the contact force along the normal, at least 0"),
    Field("near_distance", unit="m", doc="distance to the nearest object, infinite if none is near"),
    Field("time_to_contact", unit="s", doc="distance over approach speed, infinite unless approaching"),
    Field(
        "contact_force",
        "f8",
        3,
        unit="N",
        doc="`force` with damping and the surface's effects: the virtual force on the finger",
    ),
    Field("effect_force", "f8", 3, unit="N", doc="what textures, stick-slip, viscosity, magnets and vibration add"),
    Field("area", unit="m^2", doc="contact area by Hertz's law"),
    Field(
        "plate_gap",
        unit="m",
        doc="surface height less plate top; above 0 the plate is too low",
        show="page: gap between plate and virtual surface",
    ),
    Field("surface_height", unit="m", doc="height of the highest virtual surface under the finger"),
    Field("plate_yield", unit="m", doc="how far the plate yields to a force above its limit"),
    Field("plate_top", unit="m", doc="height of the plate's top, by the table's reading"),
    Field("tracking", unit="m", doc="distance of the plate from its command"),
)

#: What a tick remembers of a carried surface; its order is that of ``itouch.loop.surface.surface_memory``.
SURFACE = (
    Field("surface.renders", unit="1", doc="1: the contact is the plate's to render, 0: the arm's alone"),
    Field("surface.present", unit="1", doc="1: the plate is at the finger in a contact, or still felt"),
    Field("surface.settled", unit="1", doc="1: the plate is where the virtual surface is, 0: it comes or goes"),
    Field("surface.clear", unit="1", doc="1: it has left the finger as far as it goes, where it does not render"),
    Field("surface.share", unit="1", doc="the arm's part of the normal force, -1: no contact"),
    Field("surface.pressed", unit="s", doc="how long there has been a virtual contact"),
    Field("surface.felt", unit="1", doc="1 if the plate was felt in this contact"),
    Field("surface.felt_weight", unit="1", doc="weight of the measured force in `felt_force`"),
    Field(
        "felt_force", unit="N", doc="force the contact is felt with: the plate's where it is present, else the virtual"
    ),
    Field(
        "surface.missed",
        unit="1",
        doc="1: the plate was not felt where it should be, 2: it was felt below that, 3: withdrawn (T4); its force is "
        "the arm's",
    ),
    Field("surface.misses", unit="1", doc="how often the plate was missed"),
    Field("surface.missed_at", unit="s", doc="when it was missed first"),
    Field("surface.missed_depth", unit="m", doc="how far the finger then seemed to be in the plate"),
    Field("surface.missed_load", unit="N", doc="what the plate's force then read"),
    Field("surface.cut", unit="N", doc="what the plate takes of the force that the arm may give"),
    Field("surface.upright", unit="1", doc="cosine of the tilt of the surface below the finger against the plate"),
    Field(
        "surface.climb",
        unit="m/s",
        doc="how fast the height of that surface changes as the finger goes on, or as the object moves",
    ),
    Field("surface.changing", unit="s", doc="how much longer the force is blended between plate and arm"),
    Field("surface.load", unit="N", doc="force on the plate a tick ago"),
    Field("surface.level", unit="m", doc="height of the finger's lowest point, smoothed"),
    Field("surface.sink", unit="m/s", doc="how fast that rises, smoothed"),
    Field("surface.acceleration", unit="m/s^2", doc="how fast that changes, smoothed"),
    Field("surface.off", unit="m", doc="how much deeper it seems to be in the plate than the force explains, smoothed"),
    Field("surface.lingers", unit="s", doc="how long the plate is felt since the virtual contact ended, -1: no more"),
    Field("surface.lets_go", unit="s", doc="how long the plate has not been felt since then, while it may bounce"),
    Field("surface.lingered", unit="s", doc="the longest time that it was felt so"),
    Field("surface.lingered_at", unit="s", doc="when that ended"),
    Field("surface.wanted", "f8", 3, unit="N", doc="what the arm was to give, were the force not led over"),
    Field("surface.virtual", "f8", 3, unit="N", doc="the virtual force a tick ago"),
    Field("surface.stirs", unit="N", doc="by how much it changed a tick ago"),
    Field("surface.stirred", unit="N", doc="by how much it changed two ticks ago"),
    Field("surface.goes_x", unit="m/s", doc="how fast the finger goes in x, smoothed"),
    Field("surface.goes_y", unit="m/s", doc="how fast the finger goes in y, smoothed"),
    Field("surface.lifts", unit="m/s", doc="how fast the object lifts the surface under the finger, smoothed"),
    Field("surface.slope_x", unit="1", doc="how steep the surface is in x where the finger will be in 3 ms"),
    Field("surface.slope_y", unit="1", doc="how steep it is there in y"),
    Field("surface.turns", unit="m/s^2", doc="how fast `climb` will change in 3 ms because the slope does"),
    Field("surface.hastens", unit="m/s^2", doc="how fast `climb` changes because finger or object change their speed"),
    Field("surface.rises", unit="m/s", doc="how fast the plate rises as its surface does, or by itself, smoothed"),
    Field("surface.variance", unit="N^2", doc="of the noise of the plate's force sensor, as read in the air"),
    Field("surface.heard", unit="s", doc="for how long that was measured"),
    Field("surface.read_last", unit="N", doc="what that sensor read last"),
    Field("surface.read_before", unit="N", doc="what it read before that"),
    Field("surface.depth", unit="m", doc="how far the finger then seemed to be in the plate"),
    Field("surface.heard_at", unit="tick", doc="behind a wire: the tick in which its newest reading was measured"),
    Field("surface.averaged_at", unit="tick", doc="the same of the newest reading that is in the average"),
    Field("surface.averaged", unit="N", doc="what it reads, with its noise averaged out"),
    Field("surface.loud", unit="N", doc="rms of its noise, if it is a loud one; else 0"),
    Field("surface.borne", unit="N", doc="force on the plate, as far as the noise does not explain it"),
    Field("surface.unsure", unit="N", doc="how far the true one may be from that because of the noise"),
)


def probe_fields(objects: int, *, carried: bool = True) -> tuple[Field, ...]:
    """Return the State of a probe in a scene with this many objects.

    ``carried``: whether a plate is brought to its finger.  Where none is, its gap and its force stay zero, and are no
    curves: they would tell of a plate that is exactly where it should be.
    """
    found = (
        *FIGURES,
        *SURFACE,
        Field("object", "i8", low=-1, high=objects - 1, unit="1", doc="number of the touched object, -1: none"),
        Field(
            "near_object",
            "i8",
            low=-1,
            high=objects - 1,
            unit="1",
            doc="number of the nearest object, -1: none within `near`",
        ),
        Field(
            "below",
            "i8",
            low=-1,
            high=objects - 1,
            unit="1",
            doc="number of the object whose surface a table goes to, -1: none",
        ),  # fmt: skip
        Field(
            "beside",
            "i8",
            low=-1,
            high=objects - 1,
            unit="1",
            doc="number of the object that begins beside the touched place, within the fingertip's radius, -1: none",
        ),
        Field(
            "beside_distance",
            unit="m",
            doc="how far that is along the surface, more if it is lower, below 0 if more of the finger is over it than "
            "over the one that is touched, infinite if there is none",
        ),
        Field(
            "plate",
            "i8",
            unit="1",
            doc="1 if the plate is what touches the finger, in a contact or still felt after it",
        ),
        Field("contact.object", "i8", low=-1, high=objects - 1, unit="1", doc="object of the open contact, -1: none"),
        *_CONTACT,
        *PLATE,
    )
    return found if carried else tuple(replace(f, show="no") if f.name in _OF_A_PLATE else f for f in found)


#: Curves of a session's page that there are only where a plate is brought to the finger.
_OF_A_PLATE = ("plate_gap", "plate_force")

#: The open contact.
_CONTACT = (
    Field("contact.begin", "i8", unit="tick", doc="when the contact began"),
    Field("contact.separated", "i8", unit="tick", doc="for how long the probe has been clear of the object"),
    Field("contact.plate", "i8", unit="1", doc="1 if the plate was there at any time of the contact"),
    Field("contact.plate_ticks", "i8", low=0, unit="tick", doc="for how long the plate was there"),
    Field(
        "contact.plate_missed",
        "i8",
        unit="1",
        doc="1: the plate should have been felt in it and was not; 2: it was withdrawn in it (T4); 3: both",
    ),
    Field("contact.plate_gap", unit="m", doc="`plate_gap` at the beginning, along the normal"),
    Field("contact.peak_force", unit="N", doc="greatest `total_force` so far"),
    Field("contact.peak_penetration", unit="m", doc="greatest depth so far"),
    Field("contact.peak_area", unit="m^2", doc="greatest contact area so far"),
    Field("contact.impact_speed", unit="m/s", doc="approach speed at the beginning"),
    Field("contact.physical_begin", "i8", unit="tick", doc="when the finger met the true plate"),
    Field("plate_touched", "i8", unit="tick", doc="when the finger began to touch the true plate, -1: it does not"),
)
#: The true plate under a finger's twin; its order is that of ``itouch.twin.mechanics``.
PLATE = (
    Field(
        "plate_force",
        unit="N",
        doc="force of the plate on the finger (of twins: the true one)",
        show="page: force | plate",
    ),  # fmt: skip
    Field("plate_true_top", unit="m", doc="true height of the plate's top (twins)"),
    Field("plate_distance", unit="m", doc="true distance of finger and plate (twins); below 0 the pad is pressed"),
    Field(
        "total_force",
        unit="N",
        doc="what is felt: magnitude of the arm's force and the plate's together",
        show="force | felt",
    ),  # fmt: skip
)


def stiffness_fields(objects: int) -> tuple[Field, ...]:
    """Return the State of a probe whose contact a modality computes: how stiff and damped each object is to be."""
    stiff = "stiffness with which each object is to be rendered now"
    return (
        Field("coupling.stiffness", "f8", (objects,), low=0.0, unit="N/m", doc=stiff),
        Field("coupling.damping", "f8", (objects,), low=0.0, unit="N*s/m", doc="damping, likewise"),
    )


def coupling_fields(objects: int) -> tuple[Field, ...]:
    """Return the State of a probe whose arm is behind a wire: how late it is (`itouch.loop.late_coupling`)."""
    late = "how old the pose is and for how long a force has acted, together, a mean"
    lost = "greatest part of its stiffness that a touched object was rendered without"
    return (
        Field("coupling.delay", low=0.0, high=0.1, unit="s", doc=late),
        Field("coupling.lost", low=0.0, high=1.0, unit="1", doc=lost),
        Field("coupling.lost_object", "i8", low=0, high=max(0, objects - 1), unit="1", doc="number of that object"),
    )


def rising_fields() -> tuple[Field, ...]:
    """Return the State of a probe whose surface is behind a wire: how fast that rises (`itouch.loop.surface.plate`)."""
    return (
        Field("rising.read_at", unit="tick", doc="when the newest reading of its surface's pose was measured"),
        Field("rising.read_top", unit="m", doc="how high its surface was by that reading"),
        Field("rising.by_readings", unit="m/s", doc="how fast it rose by the last two of them"),
        Field("rising.between", unit="m/s", doc="how fast it rose where no reading has come, by what is said of it"),
    )


def skin_fields(worn: int, cells: int) -> tuple[Field, ...]:
    """Return the State of a finger's skin under this many worn devices, with this many cells of tissue."""
    return (
        Field("skin", "f8", 3, unit="K", doc="temperature of the skin under what is worn: now, lowest, highest so far"),
        Field("tissue", "f8", cells, unit="K", doc="how much warmer the tissue is than at rest, from the skin inwards"),
        Field("taken", "f8", worn, unit="W/m^2", doc="heat that each worn device takes from the finger"),
    )


#: The State of the operator's hand that leads a finger's twin.
HAND = (
    Field("position", "f8", 3, unit="m", doc="where the operator's finger twin is"),
    Field("velocity", "f8", 3, unit="m/s", doc="velocity of the operator's finger twin"),
    Field("target", "f8", 3, unit="m", doc="where the hand wants it to be: the scripted or recorded motion"),
    Field("ticks", "i8", low=0, unit="tick", doc="how long the motion has run"),
    Field("offset", "f8", 3, unit="m", doc="what the operator has added to the motion by hand"),
    Field("steered", "i8", unit="1", doc="1 while somebody steers the finger"),
    Field("target_offset", "f8", 3, unit="m", doc="where somebody steers `offset` to"),
)


def wait_fields(waits: int) -> tuple[Field, ...]:
    """Return the State of a hand that waits this many times for the skin on its way."""
    return (
        Field("baseline", low=0.0, unit="K", doc="the skin at the session's start, averaged over a second"),
        Field("averaged", "i8", low=0, unit="tick", doc="over how many readings so far; all once touched"),
        Field("skin", low=0.0, unit="K", doc="the skin now, averaged over 0.1 s"),
        Field("fresh", "i8", low=0, unit="tick", doc="for how long it has been read without a break"),
        Field("wait_begin", "i8", waits, low=-1, unit="tick", doc="when each wait for the skin began, -1: not yet"),
        Field("waited", "i8", waits, low=0, unit="tick", doc="how long each wait has lasted"),
        Field(
            "wait_end", "i8", waits, low=0, high=2, unit="1",
            doc="how each wait ended: 0 not yet, 1 the skin was back, 2 it was not after the longest time",
        ),
        Field("wait_skin", "f8", waits, low=0.0, unit="K", doc="the skin at the end of each wait, 0: never read"),
    )  # fmt: skip


def declared_by(method: Callable[..., Any], *given: Any) -> tuple[Field, ...]:
    """Return the fields of State that a plugin's ``fields`` declares.

    Raises
    ------
    ReturnedError
        If it returns anything else, or one name twice.
    """
    told = method(*given)
    if not isinstance(told, Iterable) or isinstance(told, str):
        raise ReturnedError(method, f"it returned {told!r:.40}; a tuple of Field is wanted, () if there are none")
    fields = tuple(told)
    for field in fields:
        if not isinstance(field, Field):
            raise ReturnedError(method, f"it returned {field!r:.40} among its fields, which is not a Field")
    try:
        kinds = [np.dtype(field.dtype) for field in fields]
        for field, kind in zip(fields, kinds, strict=True):
            columns = [kind[name] for name in kind.names] if kind.names else [kind]
            if not all(column.base.kind in "biuf" for column in columns):
                raise ReturnedError(
                    method, f"field '{field.name}' of type {kind} has no numbers, which State is made of"
                )
        dtype_of(fields)
    except ReturnedError:
        raise
    except ValueError as error:
        raise ReturnedError(method, str(error)) from error
    return fields
