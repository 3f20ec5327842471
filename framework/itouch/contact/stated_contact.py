"""Contacts that somebody else has computed: checked, and written as the result that a step of contact would have."""

from typing import NamedTuple

import numpy as np

from itouch.contact import layout as at
from itouch.contact.array_views import borrowed
from itouch.contact.kernel_decorators import entry, inner
from itouch.contact.outcome import clear, report_near, surface_velocity
from itouch.contact.scratch import Mesh, empty_site, put_near_objects, site_rows
from itouch.contact.vectors import Floats, along, dot, norm, put, sub, vector

#: What is returned if the result was written, or why it was not: something that is said is not a finite number, or one
#: that nothing in a contact can be; an object is none of the scene; a normal has not the length 1; no step of contact
#: has such a number of contacts, shares or distance.
WRITTEN, NOT_A_NUMBER, NO_SUCH_OBJECT, NOT_A_NORMAL, NOT_A_RESULT = 0, 1, 2, 3, 4
#: How far the length of a normal may be from 1, and a share beyond it.
_UNIT = 1e-6
#: Greatest number that is taken for one of a contact (SI): what is computed from these stays finite.
GREATEST = 1e15


class StatedContact(NamedTuple):
    """What is said of a contact, in the world frame.

    Attributes
    ----------
    touched
        (1,) number of the object that is touched; below 0: none, then the rest is not looked at.
    force, normal, point
        (3,) each: the force on the probe [N]; the outward unit normal of the surface that is touched, and the touched
        point [m].
    proxy
        (3,) where the centre of the probe's sphere would be, were the surface not to give way [m]; or (0,): where it
        touches ``point`` from outside.
    """

    touched: Floats
    force: Floats
    normal: Floats
    point: Floats
    proxy: Floats


@inner
def _index(number: float, count: int) -> bool:
    """Whether a number is the index of one of ``count`` things, or -1: none."""
    return bool(-1.0 <= number < count and number == np.floor(number))


@inner
def _can_be(number: float) -> bool:
    """Whether a number may be one of a contact; NaN may not."""
    return bool(abs(number) <= GREATEST)


@inner
def _contacts(said: Floats, objects: int) -> int:
    """Check the contacts in a result that is said, (RESULT_SIZE,), and how many there are; return as ``found`` does."""
    count = said[at.RESULT_COUNT]
    some = count > 0.0
    if not (_index(count, at.MAX_CONTACTS + 1) and count >= 0.0 and some == (said[at.RESULT_PRIMARY] >= 0.0)):
        return NOT_A_RESULT
    for c in range(int(count)):
        row = at.RESULT_CONTACTS + c * at.CONTACT_WIDTH
        if not (_index(said[row + at.CONTACT_OBJECT], objects) and said[row + at.CONTACT_OBJECT] >= 0.0):
            return NO_SUCH_OBJECT
        if not 0.0 <= said[row + at.CONTACT_SHARE] <= 1.0 + _UNIT:
            return NOT_A_RESULT
    return WRITTEN


@entry
def found(world: Floats, said: Floats, result: Floats) -> int:
    """Take over a whole result that somebody else has written; return WRITTEN, or why it was not taken over.

    ``world`` (objects, WORLD_WIDTH); ``said`` and ``result`` (RESULT_SIZE,).  Compiled code uses its indices without a
    further check.
    """
    for i in range(at.RESULT_SIZE):
        if not _can_be(said[i]) and not (i == at.RESULT_DISTANCE and said[i] == np.inf):
            return NOT_A_NUMBER
    objects = world.shape[0]
    if not (_index(said[at.RESULT_PRIMARY], objects) and _index(said[at.RESULT_NEAREST], objects)):
        return NO_SUCH_OBJECT
    wrong = _contacts(said, objects)
    if wrong != WRITTEN:
        return wrong
    if said[at.RESULT_DISTANCE] < 0.0:
        return NOT_A_RESULT
    if said[at.RESULT_COUNT] > 0.0 and abs(norm(vector(said, at.RESULT_NORMAL)) - 1.0) > _UNIT:
        return NOT_A_NORMAL
    for i in range(at.RESULT_SIZE):
        result[i] = said[i]
    return WRITTEN


@entry
def given(
    world: Floats, mesh: Mesh | None, poses: Floats, twists: Floats, hip_at: Floats, radius: float, near: float,
    said: StatedContact, result: Floats,
) -> int:  # fmt: skip
    """Write the result of a probe's contact from what is said of it; return WRITTEN, or why nothing was written.

    Parameters
    ----------
    world, mesh, poses, twists, radius, near, result
        As in ``itouch.contact.step.step``.
    hip_at
        (3,) centre of the probe's sphere [m].
    said
        What is said of the contact.
    """
    hip, n, where, push = vector(hip_at, 0), (0.0, 0.0, 1.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    if not np.isfinite(said.touched[0]):
        return NOT_A_NUMBER
    answer, obj = borrowed(result), int(said.touched[0])
    if not np.isfinite(dot(hip, hip)):  # as in a step of contact: nothing is touched from nowhere
        clear(answer)
        return WRITTEN
    if said.touched[0] >= 0.0:
        if obj >= world.shape[0] or obj != said.touched[0]:
            return NO_SUCH_OBJECT
        n, where, push = vector(said.normal, 0), vector(said.point, 0), vector(said.force, 0)
        for i in range(3):
            if not (_can_be(said.normal[i]) and _can_be(said.point[i]) and _can_be(said.force[i])):
                return NOT_A_NUMBER
        for i in range(said.proxy.shape[0]):
            if not _can_be(said.proxy[i]):
                return NOT_A_NUMBER
        if abs(norm(n) - 1.0) > _UNIT:
            return NOT_A_NORMAL
    clear(answer)
    put(answer, at.RESULT_PROXY, hip)
    if said.touched[0] >= 0.0:
        depth = max(0.0, dot(n, sub(where, hip)) + radius)
        put(answer, at.RESULT_PROXY, vector(said.proxy, 0) if said.proxy.shape[0] else along(hip, depth, n))
        put(answer, at.RESULT_FORCE, push)
        put(answer, at.RESULT_NORMAL, n)
        answer[at.RESULT_COUNT], answer[at.RESULT_PRIMARY], answer[at.RESULT_PENETRATION] = 1.0, obj, depth
        answer[at.RESULT_SLIP] = at.SLIP_SLIDE
        answer[at.RESULT_STIFFNESS] = norm(push) / depth if depth > 0.0 else 0.0
        first = at.RESULT_CONTACTS
        answer[first + at.CONTACT_OBJECT], answer[first + at.CONTACT_SHARE] = obj, 1.0
        answer[first + at.CONTACT_PENETRATION] = depth
        put(answer, first + at.CONTACT_NORMAL, n)
        put(answer, first + at.CONTACT_POINT, where)
        put(answer, at.RESULT_SURFACE_VELOCITY, surface_velocity(borrowed(poses), borrowed(twists), obj, where))
    own_site = np.empty((site_rows(world.shape[0]), at.SITE_WIDTH))
    site, now = borrowed(own_site), borrowed(poses)
    empty_site(site)
    put_near_objects(site, borrowed(world), now, now, hip, radius, near)
    report_near(site, borrowed(mesh), hip, radius, near, answer)
    if said.touched[0] < 0.0 and answer[at.RESULT_NEAREST] >= 0.0:
        # A finger may be inside a shape and touch nothing, if what is touched has another shape: it is then as far from
        # that surface as it is inside, for else a contact would not end before it has left the shape.
        away = dot(vector(answer, at.RESULT_NEAREST_NORMAL), sub(hip, vector(answer, at.RESULT_NEAREST_POINT)))
        answer[at.RESULT_DISTANCE] = max(answer[at.RESULT_DISTANCE], radius - away)
    own_site[0, 0] = radius  # a last use: the scratch must live until here
    return WRITTEN
