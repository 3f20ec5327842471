"""What a surface adds to the proxy's spring: layers, texture, stick-slip, viscosity, vibration, attraction.

The kernel runs between ``step`` and the force layer, and only where a scene asks for an effect.  It scales and turns
the spring's force in the result (layers, texture), and writes the force to be added to it (all other effects).

* Layers: the spring's force becomes a function of the whole deflection r = |proxy - HIP|: the sum over the layers of
  stiffness times the depth gone through each; it keeps its direction.  A radial force is the gradient of an energy.
* Texture: the surface is carved by delta = depth (1 - h), h the height map's value 0 to 1 at the place of the surface
  that is nearest to the HIP.  U = K/2 (d - delta)^2 while the HIP is d > delta deep; the force is -grad U, of which the
  part along the surface is K (d - delta) grad delta (Ho, Basdogan and Srinivasan 1999).  Friction stays within its
  cone about the normal force that is left.
* Stick-slip: a spring holds the HIP at a point of the surface up to a greatest force; beyond it, the spring lets go and
  takes hold at the point where the HIP is then.  It never holds with more than the normal force.
* Viscosity: -b times the HIP's velocity along the surface, relative to it; of several objects each by its share.
* Vibration: along the normal; a steady one while touched, and a decaying one after a tap, with an amplitude in
  proportion to the speed of impact (Okamura, Dennerlein and Howe 1998).  It never pulls the finger in.
* Attraction: towards the nearest surface, F (1 - (g / range)^2)^2 at the gap g < range, F in contact.
"""

import math

from itouch.blocks import Block
from itouch.contact import layout as at
from itouch.contact.kernel_decorators import entry, inner
from itouch.contact.outcome import surface_velocity
from itouch.contact.rotations import to_body, to_space
from itouch.contact.vectors import Floats, Vector, add, along, dot, norm, place_of, put, sub, vector

# --- the table of effects: one row per object -----------------------------------------------------------------
_effects = Block()
TEXTURE_AT = _effects.part()  # first sample of the height map; then rows, columns, pitch [m], depth [m]; no map: 0
TEXTURE_ROWS, TEXTURE_COLUMNS, TEXTURE_PITCH, TEXTURE_DEPTH, TEXTURE_AXIS = _effects.parts(1, 1, 1, 1, 1)
SLIP_STIFFNESS, SLIP_FORCE, VISCOSITY, MAGNET_FORCE, MAGNET_RANGE = _effects.parts(1, 1, 1, 1, 1)
BUZZ_FORCE, BUZZ_FREQUENCY, TAP_GAIN, TAP_FREQUENCY, TAP_TIME = _effects.parts(1, 1, 1, 1, 1)
MAX_LAYERS = 4
LAYERS = _effects.part()  # how many; then thickness [m] and stiffness [N/m] of each
LAYER_FIRST = _effects.part(2 * MAX_LAYERS)
EFFECTS_WIDTH = _effects.width

# --- what a probe remembers of the effects --------------------------------------------------------------------
_memory = Block()
TOUCHED = _memory.part()  # 1 + the object touched in the last tick; 0: none
SINCE = _memory.part()  # how long it has been touched [s]
IMPACT = _memory.part()  # speed of impact [m/s]
HELD = _memory.part()  # 1: stick-slip holds at a point
HELD_AT = _memory.part(3)  # three numbers: that point, in the object's frame [m]
EFFECTS_MEMORY = _memory.width

Height = tuple[float, float, float]


@inner
def _sample(samples: Floats, first: int, rows: int, columns: int, u: float, v: float) -> Height:
    """Value of a map at (u, v) [samples], linear between samples, and its derivatives with respect to u and v."""
    x, y = u + 0.5 * columns - 0.5, v + 0.5 * rows - 0.5
    i, j = int(math.floor(x)), int(math.floor(y))
    s, t = x - i, y - j
    i0, j0 = i % columns, rows - 1 - j % rows
    i1, j1 = (i + 1) % columns, rows - 1 - (j + 1) % rows
    a, b = samples[first + j0 * columns + i0], samples[first + j0 * columns + i1]
    c, d = samples[first + j1 * columns + i0], samples[first + j1 * columns + i1]
    # Differences of samples are as precise as these, which are single: in compiled code `float` changes nothing, and in
    # Python it must come after the subtraction, for then both round alike.
    below, above, twist = float(b - a), float(d - c), float((d - c) - (b - a))
    low, high = float(a) + s * below, float(c) + s * above
    return low + t * (high - low), below + t * twist, high - low


@inner
def carved(table: Floats, obj: int, samples: Floats, q: Vector, n: Vector) -> tuple[float, Vector]:
    """Depth that the map carves out of the surface at ``q`` [m], and its gradient, both in the object's frame.

    The map lies in the object's frame with its middle at the origin and repeats in both directions.  It is projected
    along one axis, or along all three with weights by the surface's direction (triplanar): along z the map's columns
    run along x and its rows, from the last to the first, along y; along y they are x and z, along x they are y and z.

    ``n`` is the surface's unit normal there.

    ``table`` (objects, EFFECTS_WIDTH); ``samples`` (n,), the values of all maps, 0 to 1, row by row.
    """
    first, rows, columns = int(table[obj, 0]), int(table[obj, 1]), int(table[obj, 2])
    pitch, depth, axis = table[obj, 3], table[obj, 4], int(table[obj, 5])
    value, gx, gy, gz, total = 0.0, 0.0, 0.0, 0.0, 0.0
    for c in range(3):
        weight = 1.0 if axis == c else 0.0
        if axis < 0:
            weight = n[c] * n[c]
            weight *= weight
        if weight < 1e-6:
            continue
        u, v = (q[1] if c == 0 else q[0]) / pitch, (q[1] if c == 2 else q[2]) / pitch
        h, hu, hv = _sample(samples, first, rows, columns, u, v)
        value, total = value + weight * h, total + weight
        hu, hv = weight * hu / pitch, weight * hv / pitch
        if c == 0:
            gy, gz = gy + hu, gz + hv
        elif c == 1:
            gx, gz = gx + hu, gz + hv
        else:
            gx, gy = gx + hu, gy + hv
    if total == 0.0:
        return 0.0, (0.0, 0.0, 0.0)
    cut = depth * (1.0 - value / total)
    scale = -depth / total
    return cut, (scale * gx, scale * gy, scale * gz)


@inner
def layered(table: Floats, obj: int, stiffness: float, r: float) -> float:
    """Force of a deflection through an object's layers [N].

    ``table`` (objects, EFFECTS_WIDTH); ``stiffness`` beyond the layers [N/m], deflection ``r`` [m].
    """
    force, rest = 0.0, r
    for i in range(int(table[obj, LAYERS])):
        part = min(rest, table[obj, LAYER_FIRST + 2 * i])
        force += min(table[obj, LAYER_FIRST + 2 * i + 1], stiffness) * part
        rest -= part
    return force + stiffness * rest


@inner
def _texture(
    table: Floats, samples: Floats, poses: Floats, result: Floats, hip: Vector, proxy: Vector
) -> tuple[float, Vector]:
    """Depth carved out of the surface at the HIP [m] and its gradient along the surface, means over the contacts."""
    depth, slope = 0.0, (0.0, 0.0, 0.0)
    for c in range(int(result[at.RESULT_COUNT])):
        row = at.RESULT_CONTACTS + c * at.CONTACT_WIDTH
        obj, share = int(result[row + at.CONTACT_OBJECT]), result[row + at.CONTACT_SHARE]
        if share <= 0.0 or table[obj, TEXTURE_DEPTH] <= 0.0:
            continue
        n, point = vector(result, row + at.CONTACT_NORMAL), vector(result, row + at.CONTACT_POINT)
        aside = sub(hip, proxy)
        aside = along(aside, -dot(aside, n), n)
        q = to_body(poses, obj, sub(add(point, aside), place_of(poses, obj)))
        local = to_body(poses, obj, n)
        cut, rise = carved(table, obj, samples, q, local)
        rise = to_space(poses, obj, along(rise, -dot(rise, local), local))
        depth, slope = depth + share * cut, along(slope, share, rise)
    return depth, slope


@inner
def _spring(
    table: Floats, samples: Floats, world: Floats, poses: Floats, stiffness: Floats, hip: Vector, result: Floats
) -> None:
    """Turn and scale the spring's force in ``result``, for texture and layers."""
    n, k = vector(result, at.RESULT_NORMAL), result[at.RESULT_STIFFNESS]
    force = vector(result, at.RESULT_FORCE)
    push = dot(force, n)
    cut, slope = _texture(table, samples, poses, result, hip, vector(result, at.RESULT_PROXY))
    if cut > 0.0 or norm(slope) > 0.0:
        tangential, static = along(force, -push, n), 0.0
        for c in range(int(result[at.RESULT_COUNT])):
            row = at.RESULT_CONTACTS + c * at.CONTACT_WIDTH
            obj = int(result[row + at.CONTACT_OBJECT])
            static += result[row + at.CONTACT_SHARE] * world[obj, at.WORLD_STATIC_FRICTION]
        push = max(push - k * cut, 0.0)
        size = norm(tangential)
        keep = min(1.0, static * push / size) if size > 0.0 else 0.0
        force = along(along(along((0.0, 0.0, 0.0), keep, tangential), push, n), push, slope)
    r = norm(force) / k if k > 0.0 else 0.0
    if r > 0.0:
        scale = 0.0
        for c in range(int(result[at.RESULT_COUNT])):
            row = at.RESULT_CONTACTS + c * at.CONTACT_WIDTH
            obj = int(result[row + at.CONTACT_OBJECT])
            own = stiffness[obj]
            scale += result[row + at.CONTACT_SHARE] * (layered(table, obj, own, r) / (own * r) if own > 0.0 else 1.0)
        force = along((0.0, 0.0, 0.0), scale, force)
    put(result, at.RESULT_FORCE, force)


@inner
def _stick_slip(table: Floats, poses: Floats, obj: int, hip: Vector, n: Vector, push: float, memory: Floats) -> Vector:
    """Return the force [N] that holds the HIP at a point of the surface; beyond the greatest force, let go."""
    k, most = table[obj, SLIP_STIFFNESS], min(table[obj, SLIP_FORCE], push)
    centre = place_of(poses, obj)
    if memory[HELD] > 0.0:
        pull = sub(add(to_space(poses, obj, vector(memory, HELD_AT)), centre), hip)
        pull = along(pull, -dot(pull, n), n)
        if k * norm(pull) <= most:
            return along((0.0, 0.0, 0.0), k, pull)
    memory[HELD] = 1.0
    put(memory, HELD_AT, to_body(poses, obj, sub(hip, centre)))
    return (0.0, 0.0, 0.0)


@inner
def _vibration(table: Floats, obj: int, push: float, memory: Floats) -> float:
    """Force along the normal [N]: steady while touched, decaying after a tap; it pulls no harder than ``push``."""
    time = memory[SINCE]
    force = table[obj, BUZZ_FORCE] * math.sin(2.0 * math.pi * table[obj, BUZZ_FREQUENCY] * time)
    if table[obj, TAP_GAIN] > 0.0:
        size = table[obj, TAP_GAIN] * memory[IMPACT] * math.exp(-time / table[obj, TAP_TIME])
        force += size * math.sin(2.0 * math.pi * table[obj, TAP_FREQUENCY] * time)
    return float(max(force, -push))


@inner
def _drag(
    table: Floats, poses: Floats, twists: Floats, velocity: Vector, n: Vector, drag: Vector, result: Floats
) -> Vector:
    """Return the drag [N] of all touched objects by their shares; ``drag`` is that of the one that bears most.

    Alone it would step where two objects of a groove change places, and be the file's order's where both bear the same.
    """
    found, obj = drag, result[at.RESULT_PRIMARY]
    for c in range(1, int(result[at.RESULT_COUNT])):
        row = at.RESULT_CONTACTS + c * at.CONTACT_WIDTH
        other, share = int(result[row + at.CONTACT_OBJECT]), result[row + at.CONTACT_SHARE]
        if other != obj and share > 0.0:
            relative = sub(velocity, surface_velocity(poses, twists, other, vector(result, row + at.CONTACT_POINT)))
            own = along((0.0, 0.0, 0.0), -table[other, VISCOSITY], along(relative, -dot(relative, n), n))
            found = along(found, share, sub(own, drag))
    return found


@inner
def _touch(
    table: Floats, poses: Floats, twists: Floats, velocity: Vector, hip: Vector, period: float, memory: Floats,
    result: Floats,
) -> Vector:  # fmt: skip
    """Return the force to be added to the spring's while an object is touched [N]."""
    obj, n = int(result[at.RESULT_PRIMARY]), vector(result, at.RESULT_NORMAL)
    relative = sub(velocity, vector(result, at.RESULT_SURFACE_VELOCITY))
    closing = -dot(relative, n)
    if memory[TOUCHED] != obj + 1.0:
        memory[TOUCHED], memory[SINCE], memory[HELD], memory[IMPACT] = obj + 1.0, 0.0, 0.0, max(closing, 0.0)
    else:
        memory[SINCE] += period
    push = max(dot(vector(result, at.RESULT_FORCE), n), 0.0)
    extra = along((0.0, 0.0, 0.0), -table[obj, VISCOSITY], along(relative, closing, n))
    extra = _drag(table, poses, twists, velocity, n, extra, result)
    if table[obj, SLIP_FORCE] > 0.0:
        extra = add(extra, _stick_slip(table, poses, obj, hip, n, push, memory))
    return along(extra, _vibration(table, obj, push, memory), n)


@entry
def render_effects(
    table: Floats,
    samples: Floats,
    world: Floats,
    poses: Floats,
    twists: Floats,
    stiffness: Floats,
    hip_at: Floats,
    velocity_at: Floats,
    period: float,
    memory: Floats,
    result: Floats,
    extra: Floats,
) -> int:
    """Render the effects of one probe for one tick; return 0.

    Parameters
    ----------
    table, samples
        From ``itouch.contact.surface_effects``: (n, EFFECTS_WIDTH), and the samples of all height maps.
    world, poses, twists, stiffness, hip_at
        As in ``step``.
    velocity_at
        Velocity of the HIP, (3,) [m/s].
    period
        Length of a tick [s].
    memory
        (EFFECTS_MEMORY,) what the probe remembers; all zero before the first tick.
    result
        The result of ``step``; its force is rewritten.
    extra
        (3,), written: the force on the operator to be added to that force [N].
    """
    hip, force = vector(hip_at, 0), (0.0, 0.0, 0.0)
    if result[at.RESULT_PRIMARY] >= 0.0:
        _spring(table, samples, world, poses, stiffness, hip, result)
        force = _touch(table, poses, twists, vector(velocity_at, 0), hip, period, memory, result)
    else:
        memory[:] = 0.0
    near = int(result[at.RESULT_NEAREST])
    if near >= 0 and table[near, MAGNET_FORCE] > 0.0:
        gap = min(result[at.RESULT_DISTANCE] / table[near, MAGNET_RANGE], 1.0)
        pull = -table[near, MAGNET_FORCE] * (1.0 - gap * gap) ** 2
        force = along(force, pull, vector(result, at.RESULT_NEAREST_NORMAL))
    put(extra, 0, force)
    return 0
