"""The nodes of a glTF: which mesh is placed where."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from itouch.contact.meshfile.accessors import item
from itouch.contact.meshfile.limits import MAX_NODES

Floats = NDArray[np.float64]


def placed_meshes(document: dict[str, Any]) -> Iterator[tuple[int, Floats]]:
    """Yield each placed mesh's index with the matrix (4, 4) from its frame to the scene's, parents before children.

    Without a scene every root node is placed; without nodes every mesh is placed once, in its own frame.

    Raises
    ------
    ValueError, KeyError, TypeError
        If the nodes do not form trees, or a node's transform is not valid.
    """
    nodes = document.get("nodes", [])
    if len(nodes) > MAX_NODES:
        raise ValueError(f"it has {len(nodes)} nodes; the most is {MAX_NODES}")
    if not nodes:
        yield from ((index, np.eye(4)) for index in range(len(document.get("meshes", []))))
        return
    stack = [(root, np.eye(4)) for root in reversed(_roots(document, nodes))]
    met: set[int] = set()
    while stack:
        index, above = stack.pop()
        node = item(nodes, index)
        if index in met:
            raise ValueError(f"node {index} has two parents, or is its own")
        met.add(index)
        matrix = above @ _matrix(node)
        if "mesh" in node:
            yield int(node["mesh"]), matrix
        stack += [(child, matrix) for child in reversed(node.get("children", []))]


def _roots(document: dict[str, Any], nodes: list[dict[str, Any]]) -> list[int]:
    if document.get("scenes"):
        return list(item(document["scenes"], document.get("scene", 0)).get("nodes", []))
    children = {child for node in nodes for child in node.get("children", ())}
    return [index for index in range(len(nodes)) if index not in children]


def _matrix(node: dict[str, Any]) -> Floats:
    """Return a node's own transform: T R S, or the matrix that the file gives column by column."""
    if "matrix" in node:
        matrix = np.array(node["matrix"], np.float64).reshape(4, 4).T
    else:
        matrix = np.eye(4)
        matrix[:3, :3] = _rotation(node.get("rotation", (0.0, 0.0, 0.0, 1.0)))
        matrix[:3, :3] *= np.array(node.get("scale", (1.0, 1.0, 1.0)), np.float64).reshape(1, 3)
        matrix[:3, 3] = np.array(node.get("translation", (0.0, 0.0, 0.0)), np.float64).reshape(3)
    if not np.isfinite(matrix).all():
        raise ValueError("a node's transform is not finite")
    return matrix


def _rotation(quaternion: Any) -> Floats:
    """Return the matrix of a quaternion x y z w."""
    x, y, z, w = np.array(quaternion, np.float64).reshape(4)
    size = x * x + y * y + z * z + w * w
    if not 0.0 < size < np.inf:
        raise ValueError("a node's rotation is no quaternion")
    s = 2.0 / size
    return np.array(
        [
            [1 - s * (y * y + z * z), s * (x * y - w * z), s * (x * z + w * y)],
            [s * (x * y + w * z), 1 - s * (x * x + z * z), s * (y * z - w * x)],
            [s * (x * z - w * y), s * (y * z + w * x), 1 - s * (x * x + y * y)],
        ]
    )
