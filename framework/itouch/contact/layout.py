"""The place of each number in the contact engine's flat arrays: memory of a probe, result, scratch rows.

The engine reads and writes flat ``float64`` arrays, because the framework owns the memory: the probe's memory is a
field of its State record, the result a field that is rewritten on every tick. Every index has its name here.
"""

from typing import Final

import numpy as np

ZERO = np.int64(0)  # plain literals would make the compiler specialise on each of them
ONE = np.int64(1)

# --- Geometry.world: one row per object -----------------------------------------------------------------------
WORLD_KIND: Final = 0
WORLD_SIZE: Final = 1  # three numbers whose meaning depends on the kind
WORLD_BOUND: Final = 4  # radius of a sphere about the object's origin that holds it [m]
WORLD_STATIC_FRICTION: Final = 5
WORLD_DYNAMIC_FRICTION: Final = 6
WORLD_SIDES: Final = 7  # ONE_SIDED, TWO_SIDED or SOLID
WORLD_MESH: Final = 8  # the row of the mesh's root in the table of nodes
WORLD_SHADING: Final = 9  # 1: force shading by vertex normals
WORLD_SKIN: Final = 10  # least radius with which a probe is treated on a surface without thickness [m]
WORLD_WIDTH: Final = 11

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
CONTACT_OBJECT: Final = 0
CONTACT_FEATURE: Final = 1  # primitive: code of face, edge or vertex; mesh: index of the face
CONTACT_NORMAL: Final = 2  # three numbers, out of the object, world frame
CONTACT_POINT: Final = 5  # three numbers, on the virtual surface, world frame [m]
CONTACT_PENETRATION: Final = 8  # depth of the HIP below the surface that the probe's centre may not cross [m]
CONTACT_SHARE: Final = 9  # share of the normal force, 0..1; the shares of all contacts add up to 1
CONTACT_WIDTH: Final = 10
#: Most contacts of one probe at the same time.
MAX_CONTACTS: Final = 4

# --- the result of one step -----------------------------------------------------------------------------------
RESULT_FORCE: Final = 0  # three numbers: stiffness x (proxy - HIP), on the operator, world frame [N]
RESULT_PROXY: Final = 3  # three numbers: centre of the proxy [m]
RESULT_NORMAL: Final = 6  # three numbers: direction of the normal force; 0 without contact
RESULT_STIFFNESS: Final = 9  # the stiffness used: the contacts' values weighted by their shares [N/m]
RESULT_COUNT: Final = 10  # contacts that are filled in below
RESULT_PRIMARY: Final = 11  # object with the largest share; -1 without contact
RESULT_SLIP: Final = 12  # SLIP_NONE, SLIP_STICK or SLIP_SLIDE
RESULT_PENETRATION: Final = 13  # penetration of the primary contact [m]
RESULT_SURFACE_VELOCITY: Final = 14  # three numbers: the primary object's surface at the contact point [m/s]
RESULT_NEAREST: Final = 17  # nearest object within ``near`` of the probe's surface; -1 if there is none
RESULT_DISTANCE: Final = 18  # its distance from the probe's surface, 0 in contact [m]; inf if there is none
RESULT_NEAREST_POINT: Final = 19  # three numbers: its nearest point, world frame [m]
RESULT_NEAREST_NORMAL: Final = 22  # three numbers: its normal there, world frame
RESULT_CONTACTS: Final = 25  # MAX_CONTACTS rows of CONTACT_WIDTH, largest share first
RESULT_SIZE: Final = RESULT_CONTACTS + MAX_CONTACTS * CONTACT_WIDTH

SLIP_NONE: Final = 0
SLIP_STICK: Final = 1
SLIP_SLIDE: Final = 2

# --- what a probe remembers between steps ---------------------------------------------------------------------
MEMORY_READY: Final = 0  # 0: the next step is a reset
MEMORY_PROXY: Final = 1  # three numbers
MEMORY_SLIP: Final = 4
MEMORY_COUNT: Final = 5  # contacts remembered
MEMORY_CONTACTS: Final = 6  # MAX_CONTACTS pairs (object, feature or triangle), largest share first
MEMORY_POSES: Final = MEMORY_CONTACTS + 2 * MAX_CONTACTS  # seven numbers per object: the poses of the last step

# --- the site of one step: a scratch table, one kind of row after the other -----------------------------------
# A half-space of positions that the probe's centre may take: rows 0 to MAX_PLANES - 1.
PLANE_OBJECT: Final = 0
PLANE_FEATURE: Final = 1
PLANE_NORMAL: Final = 2  # three numbers, world frame
PLANE_GAP: Final = 5  # distance of the solver's anchor from the plane; < 0: the anchor violates it [m]
PLANE_LOAD: Final = 6  # multiplier: this plane's share of (solution - goal) [m]
PLANE_FRAME: Final = 7  # row of the object
MAX_PLANES: Final = 16

# A triangle that the solver keeps in view.
SEED_FIRST: Final = MAX_PLANES
SEED_FRAME: Final = 0  # row of the object
SEED_TRIANGLE: Final = 1
SEED_BEGAN: Final = 2  # 1: the step began with a contact here
SEED_LAST: Final = SEED_FIRST + 8

# How many rows are in use.
ENDS: Final = SEED_LAST
END_SEEDS: Final = 0
END_FRAMES: Final = 1
END_TOUCH: Final = 2  # and the greatest gap that counts as contact [m]
END_OLD: Final = 3  # and the place of the proxy at the end of the last step: three numbers

# An object that is near enough to matter.
FRAME_FIRST: Final = ENDS + 1
FRAME_OBJECT: Final = 0
FRAME_MOVED: Final = 1  # 1: the pose differs from that of the last step
FRAME_NOW: Final = 2  # position, then rotation row by row (object frame -> world): twelve numbers
FRAME_POSE: Final = 12  # width of one pose; that of the last step follows, filled in only where it differs
FRAME_KIND: Final = 26
FRAME_SIZE: Final = 27  # three numbers, as in the world table
FRAME_REACH: Final = 30  # the probe's radius; for a surface without thickness at least its skin [m]
FRAME_SLACK: Final = 31  # how deep a triangle may reach into the probe and still be ignored [m]
FRAME_ROOT: Final = 32
FRAME_BOUND: Final = 33
FRAME_SIDES: Final = 34  # of a mesh: ONE_SIDED, TWO_SIDED or SOLID
FRAME_STATIC: Final = 35
FRAME_DYNAMIC: Final = 36
FRAME_SHADING: Final = 37

# The searches' stack, in the last columns of the first rows.
STACK_KEY: Final = 38
STACK_NODE: Final = 39
STACK_ROWS: Final = 80  # deeper than any tree that bvh.build makes
SITE_WIDTH: Final = 40
