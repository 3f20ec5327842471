"""The place of each number in the contact engine's flat arrays: memory of a probe, result, scratch rows.

The engine reads and writes flat ``float64`` arrays, because the framework owns the memory: the probe's memory is a
field of its State record, the result a field that is rewritten on every tick. Every index has its name
here, and follows from the widths of what stands before it.
"""

from typing import Final

import numpy as np

from itouch.blocks import Block

ZERO = np.int64(0)  # plain literals would make the compiler specialise on each of them
ONE = np.int64(1)

# --- Geometry.world: one row per object -----------------------------------------------------------------------
_world = Block()
WORLD_KIND: Final = _world.part()
WORLD_SIZE: Final = _world.part(3)  # three numbers whose meaning depends on the kind
WORLD_BOUND: Final = _world.part()  # radius of a sphere about the object's origin that holds it [m]
WORLD_STATIC_FRICTION: Final = _world.part()
WORLD_DYNAMIC_FRICTION: Final = _world.part()
WORLD_SIDES: Final = _world.part()  # ONE_SIDED, TWO_SIDED or SOLID
WORLD_MESH: Final = _world.part()  # the row of the mesh's root in the table of nodes
WORLD_SHADING: Final = _world.part()  # 1: force shading by vertex normals
WORLD_SKIN: Final = _world.part()  # least radius with which a probe is treated on a surface without thickness [m]
WORLD_WIDTH: Final = _world.width

KIND_PLANE: Final = 0
KIND_SPHERE: Final = 1
KIND_BOX: Final = 2
KIND_CAPSULE: Final = 3
KIND_CYLINDER: Final = 4
KIND_MESH: Final = 5

ONE_SIDED: Final = 0  # a surface that lets through what comes from behind
TWO_SIDED: Final = 1
SOLID: Final = 2  # has an inside that a probe is pushed out of

# --- one contact ----------------------------------------------------------------------------------------------
_contact = Block()
CONTACT_OBJECT: Final = _contact.part()
CONTACT_FEATURE: Final = _contact.part()  # primitive: code of face, edge or vertex; mesh: index of the face
CONTACT_NORMAL: Final = _contact.part(3)  # three numbers, out of the object, world frame
CONTACT_POINT: Final = _contact.part(3)  # three numbers, on the virtual surface, world frame [m]
CONTACT_PENETRATION: Final = _contact.part()  # depth of the HIP below what the probe's centre may not cross [m]
CONTACT_SHARE: Final = _contact.part()  # share of the normal force, 0..1; the shares of all contacts add up to 1
CONTACT_WIDTH: Final = _contact.width
#: Most contacts of one probe at the same time.
MAX_CONTACTS: Final = 4

# --- the result of one step -----------------------------------------------------------------------------------
_result = Block()
RESULT_FORCE: Final = _result.part(3)  # three numbers: stiffness x (proxy - HIP), on the operator, world frame [N]
RESULT_PROXY: Final = _result.part(3)  # three numbers: centre of the proxy [m]
RESULT_NORMAL: Final = _result.part(3)  # three numbers: direction of the normal force; 0 without contact
RESULT_STIFFNESS: Final = _result.part()  # the stiffness used: the contacts' values weighted by their shares [N/m]
RESULT_COUNT: Final = _result.part()  # contacts that are filled in below
RESULT_PRIMARY: Final = _result.part()  # object with the largest share; -1 without contact
RESULT_SLIP: Final = _result.part()  # SLIP_NONE, SLIP_STICK or SLIP_SLIDE
RESULT_PENETRATION: Final = _result.part()  # penetration of the primary contact [m]
RESULT_SURFACE_VELOCITY: Final = _result.part(
    3
)  # three numbers: the primary object's surface at the contact point [m/s]
RESULT_NEAREST: Final = _result.part()  # nearest object within ``near`` of the probe's surface; -1 if there is none
RESULT_DISTANCE: Final = _result.part()  # its distance from the probe's surface, 0 in contact [m]; inf if there is none
RESULT_NEAREST_POINT: Final = _result.part(3)  # three numbers: its nearest point, world frame [m]
RESULT_NEAREST_NORMAL: Final = _result.part(3)  # three numbers: its normal there, world frame
RESULT_CONTACTS: Final = _result.part(
    MAX_CONTACTS * CONTACT_WIDTH
)  # MAX_CONTACTS rows of CONTACT_WIDTH, largest share first
RESULT_SIZE: Final = _result.width

SLIP_NONE: Final = 0
SLIP_STICK: Final = 1
SLIP_SLIDE: Final = 2

# --- what a probe remembers between steps ---------------------------------------------------------------------
_memory = Block()
MEMORY_READY: Final = _memory.part()  # 0: the next step is a reset
MEMORY_PROXY: Final = _memory.part(3)  # three numbers
MEMORY_SLIP: Final = _memory.part()
MEMORY_COUNT: Final = _memory.part()  # contacts remembered
MEMORY_CONTACTS: Final = _memory.part(
    2 * MAX_CONTACTS
)  # MAX_CONTACTS pairs (object, feature or triangle), largest share first
MEMORY_POSES: Final = _memory.width  # seven numbers per object: the poses of the last step

# --- the site of one step: a scratch table, one kind of row after the other -----------------------------------
# A half-space of positions that the probe's centre may take: rows 0 to MAX_PLANES - 1.
_plane = Block()
PLANE_OBJECT: Final = _plane.part()
PLANE_FEATURE: Final = _plane.part()
PLANE_NORMAL: Final = _plane.part(3)  # three numbers, world frame
PLANE_GAP: Final = _plane.part()  # distance of the solver's anchor from the plane; < 0: the anchor violates it [m]
PLANE_LOAD: Final = _plane.part()  # multiplier: this plane's share of (solution - goal) [m]
PLANE_FRAME: Final = _plane.part()  # row of the object
MAX_PLANES: Final = 16

# A triangle that the solver keeps in view.
SEED_FIRST: Final = MAX_PLANES
_seed = Block()
SEED_FRAME: Final = _seed.part()  # row of the object
SEED_TRIANGLE: Final = _seed.part()
SEED_BEGAN: Final = _seed.part()  # 1: the step began with a contact here
SEED_LAST: Final = SEED_FIRST + 8

# How many rows are in use.
ENDS: Final = SEED_LAST
_end = Block()
END_SEEDS: Final = _end.part()
END_FRAMES: Final = _end.part()
END_TOUCH: Final = _end.part()  # and the greatest gap that counts as contact [m]
END_OLD: Final = _end.part(3)  # and the place of the proxy at the end of the last step: three numbers

# An object that is near enough to matter.
FRAME_FIRST: Final = ENDS + 1
FRAME_POSE: Final = 12  # width of a pose: position, then rotation row by row (object frame -> world)
_frame = Block()
FRAME_OBJECT: Final = _frame.part()
FRAME_MOVED: Final = _frame.part()  # 1: the pose differs from that of the last step
FRAME_NOW: Final = _frame.part(2 * FRAME_POSE)  # its pose, then that of the last step where it differs
FRAME_KIND: Final = _frame.part()
FRAME_SIZE: Final = _frame.part(3)  # three numbers, as in the world table
FRAME_REACH: Final = _frame.part()  # the probe's radius; for a surface without thickness at least its skin [m]
FRAME_SLACK: Final = _frame.part()  # how deep a triangle may reach into the probe and still be ignored [m]
FRAME_ROOT: Final = _frame.part()
FRAME_BOUND: Final = _frame.part()
FRAME_SIDES: Final = _frame.part()  # of a mesh: ONE_SIDED, TWO_SIDED or SOLID
FRAME_STATIC: Final = _frame.part()
FRAME_DYNAMIC: Final = _frame.part()
FRAME_SHADING: Final = _frame.part()

# The searches' stack, in the last columns of the first rows.
STACK_KEY: Final = _frame.part()
STACK_NODE: Final = _frame.part()
STACK_ROWS: Final = 80  # deeper than any tree that bvh.build makes
SITE_WIDTH: Final = _frame.width
