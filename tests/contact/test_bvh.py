"""The hierarchy: every triangle in one leaf, every box and slab around what it holds."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from probing import Floats, box_mesh, grid, needle

from itouch.contact import Surface, bvh, layout
from itouch.contact.neighbours import NEIGHBOUR
from itouch.contact.stored import can_be_searched
from itouch_evidence.contact.contact_workload import height_field, icosphere

SOUP = np.random.default_rng(5).normal(size=(600, 3))
MESHES = {
    "one triangle": (np.eye(3), [[0, 1, 2]]),
    "five triangles": (SOUP[:15], np.arange(15).reshape(5, 3)),
    "soup": (SOUP, np.arange(600).reshape(200, 3)),
    "points": (np.zeros((30, 3)), np.arange(30).reshape(10, 3)),
    "the same triangle": (np.tile(np.eye(3), (50, 1)), np.arange(150).reshape(50, 3)),
    "on one line": (np.arange(90)[:, None] * np.ones(3), np.arange(90).reshape(30, 3)),
    "far away": (SOUP * 1e-3 + 1e4, np.arange(600).reshape(200, 3)),
    "growing": (np.exp(np.arange(300))[:, None] ** 0.1 * SOUP[:300], np.arange(300).reshape(100, 3)),
    "box": box_mesh(1, 2, 3),
    "needle": needle(),
    "grid": grid(17),
    "sphere": icosphere(3),
    "field": height_field(22),
}


@pytest.mark.parametrize("name", MESHES)
def test_boxes_and_slabs_hold_what_is_below_them(name: str) -> None:
    surface = Surface(*MESHES[name])
    vertices, triangles, nodes = surface.tables
    held = np.zeros(len(triangles), dtype=int)

    def visit(node: int, above: list[Floats]) -> None:
        for side in range(2):
            part = nodes[node, bvh.CHILD_WIDTH * side : bvh.CHILD_WIDTH * (side + 1)].astype(float)
            if part[0] == np.inf:
                continue
            ref, count = int(nodes[node, bvh.CHILD_REF + side]), int(nodes[node, bvh.CHILD_COUNT + side])
            if count == 0:
                assert ref > node
                visit(ref, [*above, part])
                continue
            assert count <= bvh.LEAF
            held[ref : ref + count] += 1
            corners = vertices[triangles[ref : ref + count, :3]].reshape(-1, 3)
            for box in [*above, part]:
                levels = corners @ box[bvh.CHILD_NORMAL : bvh.CHILD_NORMAL + 3]
                assert (corners >= box[:3]).all()
                assert (corners <= box[3:6]).all()
                slack = 1e-9 * np.abs(corners).max()
                assert levels.min() >= box[bvh.CHILD_LOW] - slack
                assert levels.max() <= box[bvh.CHILD_HIGH] + slack

    visit(0, [])
    assert (held == 1).all()
    assert sorted(triangles[:, 3]) == list(range(len(triangles)))
    given = np.asarray(MESHES[name][0])[np.asarray(MESHES[name][1])]
    np.testing.assert_array_equal(vertices[triangles[:, :3]], given[triangles[:, 3]])


@pytest.mark.parametrize("name", ["box", "needle", "grid", "sphere", "field", "soup"])
def test_neighbours_share_an_edge_and_know_each_other(name: str) -> None:
    _, triangles, _ = Surface(*MESHES[name]).tables
    shared = 0
    for t, row in enumerate(triangles):
        for e in range(3):
            other = row[NEIGHBOUR + e]
            if other < 0:
                continue
            shared += 1
            assert {row[e], row[(e + 1) % 3]} < set(triangles[other, :3])
            assert t in triangles[other, NEIGHBOUR:]
    assert shared == {"box": 36, "needle": 72, "soup": 0, "sphere": 3 * 1280}.get(name, shared)


def test_a_deep_tree_stays_within_the_stack() -> None:
    powers = 2.0 ** np.arange(-200, 200)
    vertices = np.repeat(powers, 3)[:, None] * np.tile(np.eye(3), (400, 1))
    surface = Surface(vertices, np.arange(1200).reshape(400, 3))
    point, distance, face = surface.closest([1.0, 0.0, 0.0])
    assert (distance, face) == (0.0, 200)
    np.testing.assert_array_equal(point, [1, 0, 0])


def test_neighbours_of_many_triangles_about_one_vertex(rng: np.random.Generator) -> None:
    """A cone over a ring of random places: triangles that lie side by side in memory are not neighbours."""
    count = 20_000
    ring = np.concatenate([[[0.0, 0.0, 1.0]], rng.normal(size=(count, 3)) * 1e-3])
    i = np.arange(1, count)
    triangles = Surface(ring, np.stack([0 * i, i, i + 1], 1)).tables[1]
    place = np.empty(len(i), int)
    place[triangles[:, 3]] = np.arange(len(i))
    across = {face: {triangles[t, 3] for t in triangles[place[face], NEIGHBOUR:] if t >= 0} for face in range(len(i))}
    assert across[0] == {1}
    assert all(across[face] == {face - 1, face + 1} for face in range(1, len(i) - 1))


def copied(surface: Surface) -> tuple[Any, Any, Any]:
    vertices, triangles, nodes = surface.tables
    return vertices.copy(), triangles.copy(), nodes.copy()


@pytest.mark.parametrize("name", MESHES)
def test_what_is_built_can_be_searched(name: str) -> None:
    assert can_be_searched(*copied(Surface(*MESHES[name])))


def chain(depth: int) -> tuple[Floats, Any, Any]:
    """A sound tree of that depth: in each node a triangle, and the next node; in the last one two triangles."""
    vertices, triangles, _ = copied(Surface(SOUP[: 3 * (depth + 2)], np.arange(3 * (depth + 2)).reshape(-1, 3)))
    nodes = np.zeros((depth + 1, bvh.NODE_WIDTH), np.float32)
    for row in range(depth + 1):
        for side, (ref, count) in enumerate(((row, 1), (row + 1, 0) if row < depth else (row + 1, 1))):
            nodes[row, bvh.CHILD_WIDTH * side :][:3], nodes[row, bvh.CHILD_WIDTH * side :][3:6] = -100.0, 100.0
            nodes[row, bvh.CHILD_REF + side], nodes[row, bvh.CHILD_COUNT + side] = ref, count
    bvh.add_slabs(vertices, triangles, nodes)
    return vertices, triangles, nodes


def test_a_tree_that_is_deeper_than_the_stack_cannot_be_searched() -> None:
    """The searches do not look whether their stack is full."""
    assert bvh.MAX_DEPTH + 2 <= layout.STACK_ROWS
    deepest = chain(bvh.MAX_DEPTH)
    assert can_be_searched(*deepest)
    surface = Surface.of_tables(deepest, is_solid=False)
    assert surface.closest(SOUP[5])[1] == 0.0
    assert not can_be_searched(*chain(bvh.MAX_DEPTH + 1))


REF, COUNT, SIDE = bvh.CHILD_REF, bvh.CHILD_COUNT, bvh.CHILD_WIDTH


def put(table: int, row: int, column: int, value: float) -> Callable[[Any], None]:
    def change(tables: Any) -> None:
        tables[table][row, column] = value

    return change


def shrink(table: Any, row: int, side: int) -> None:
    table[row, SIDE * side + 3] -= 1e-3


def inner(nodes: Any) -> tuple[int, int]:
    """A node, and which of its children is a node."""
    row, side = np.argwhere(nodes[:, COUNT:] == 0)[1]
    return int(row), int(side)


def leaf(nodes: Any) -> tuple[int, int]:
    """A node, and which of its children is a leaf of more than one triangle."""
    row, side = np.argwhere(nodes[:, COUNT:] > 1)[0]
    return int(row), int(side)


def twice(tables: Any) -> None:
    """Both children of the root are the same node: without a bound on it, each level would double the search."""
    tables[2][0, :SIDE] = tables[2][0, SIDE:REF]
    tables[2][0, REF] = tables[2][0, REF + 1]


def shared(tables: Any) -> None:
    """A leaf refers to the triangles of another one."""
    nodes = tables[2]
    (row, side), (other, beside) = np.argwhere(nodes[:, COUNT:] > 0)[:2]
    for column in (REF, COUNT):
        nodes[row, column + side] = nodes[other, column + beside]
    nodes[row, SIDE * side : SIDE * side + 6] = nodes[other, SIDE * beside : SIDE * beside + 6]


def round_about(tables: Any) -> None:
    row, side = inner(tables[2])
    tables[2][row, REF + side] = row


@pytest.mark.parametrize(
    "change",
    [
        put(0, 5, 1, 9.0),
        put(1, 3, 0, 162),
        put(1, 3, 1, -1),
        put(1, 3, 3, 0),
        put(1, 3, 3, 320),
        put(1, 3, 4, -2),
        put(1, 3, 6, 320),
        put(2, 0, REF, np.nan),
        put(2, 0, REF, -1.0),
        put(2, 0, REF, 1e6),
        put(2, 0, REF, 3.5),
        put(2, 0, COUNT, 0.5),
        put(2, 0, COUNT, np.nan),
        put(2, 0, COUNT, bvh.LEAF + 1.0),
        put(2, 0, SIDE, np.nan),
        put(2, 0, SIDE, np.inf),
        lambda tables: shrink(tables[2], *inner(tables[2])),
        lambda tables: shrink(tables[2], *leaf(tables[2])),
        lambda tables: put(2, leaf(tables[2])[0], COUNT + leaf(tables[2])[1], 1.0)(tables),
        lambda tables: put(2, leaf(tables[2])[0], REF + leaf(tables[2])[1], 319.0)(tables),
        twice,
        shared,
        round_about,
    ],
)
def test_tables_that_lead_nowhere_cannot_be_searched(change: Callable[[Any], None]) -> None:
    tables = copied(Surface(*icosphere(2)))
    assert (len(tables[0]), len(tables[1])) == (162, 320)
    assert can_be_searched(*tables)
    change(tables)
    assert not can_be_searched(*tables)


def test_an_unreached_node_and_an_empty_side_are_told_apart() -> None:
    vertices, triangles, nodes = copied(Surface(*icosphere(2)))
    assert not can_be_searched(vertices, triangles, np.concatenate([nodes, nodes[-1:]]))
    vertices, triangles, nodes = copied(Surface(*MESHES["one triangle"]))
    assert nodes[0, SIDE] == np.inf
    nodes[0, REF + 1] = 1.0
    assert not can_be_searched(vertices, triangles, nodes)
    nodes[0, REF + 1], nodes[0, :3] = 0.0, np.inf
    assert not can_be_searched(vertices, triangles, nodes)
