"""Examples of mesh files that cannot be touched, or that may not mean what their author intended."""

from __future__ import annotations

import math

from itouch_tools.cli.explain.example import Example, scene

_WOOD = '<materials><material name="wood"><contact stiffness="1 N/mm"/></material></materials>\n'
_CORNERS = [(x, y, z) for z in (0.0, 0.02) for y in (0.0, 0.02) for x in (0.0, 0.02)]
_FACES = ("1 3 4 2", "5 6 8 7", "1 2 6 5", "2 4 8 6", "4 3 7 8", "3 1 5 7")


def _mesh(content: str | bytes, name: str = "shape.obj", note: str = "") -> Example:
    body = f'{_WOOD}<world>\n  <mesh name="shape" file="{name}" material="wood"/>\n</world>'
    text = content if isinstance(content, str) else "(no text)"
    return scene(body, {name: content}, note=note or f"{name} holds\n\n{text}")


def _cube(scale: float = 1.0, faces: tuple[str, ...] = _FACES, more: str = "") -> str:
    corners = "".join(f"v {x * scale:g} {y * scale:g} {z * scale:g}\n" for x, y, z in _CORNERS)
    return corners + "".join(f"f {face}\n" for face in faces) + more


def _second() -> str:
    """Return a second cube, shifted by a quarter of the first's size."""
    corners = "".join(f"v {x + 0.005:g} {y + 0.005:g} {z + 0.005:g}\n" for x, y, z in _CORNERS)
    faces = "".join("f " + " ".join(str(int(n) + 8) for n in face.split()) + "\n" for face in _FACES)
    return corners + faces


def _pierced() -> str:
    """Return a cube with a hole of two millimetres in one face."""
    hole = "".join(f"v 0 {y:g} {z:g}\n" for z in (0.009, 0.011) for y in (0.009, 0.011))
    ring = ("3 1 9 10", "1 5 11 9", "5 7 12 11", "7 3 10 12")
    corners = "".join(f"v {x:g} {y:g} {z:g}\n" for x, y, z in _CORNERS)
    return corners + hole + "".join(f"f {face}\n" for face in (*_FACES[:-1], *ring))


def _band(count: int = 12) -> str:
    """Return a Moebius band: a strip that is joined to itself after half a turn."""
    lines = []
    for k in range(count):
        turn, half = 2.0 * math.pi * k / count, math.pi * k / count
        for side in (-0.01, 0.01):
            r = 0.04 + side * math.cos(half)
            lines.append(f"v {r * math.cos(turn):.5f} {r * math.sin(turn):.5f} {side * math.sin(half):.5f}\n")
    for k in range(count):
        a, b = 2 * k + 1, 2 * k + 2
        c, d = (2 * k + 4, 2 * k + 3) if k < count - 1 else (1, 2)
        lines.append(f"f {a} {d} {c} {b}\n")
    return "".join(lines)


_HEADER = b" " * 80
MESHES = {
    "mesh-format": _mesh("Tuesday: nothing.\n", "shape.docx", note='<mesh name="shape" file="shape.docx" .../>'),
    "mesh-empty": _mesh("v 0 0 0\nv 1 0 0\nv 0 1 0\n"),
    "mesh-too-large": _mesh(
        b"ply\nformat ascii 1.0\nelement vertex 90000000\nproperty float x\nproperty float y\nproperty float z\n"
        b"element face 1\nproperty list uchar int vertex_indices\nend_header\n" + b"0 0 0\n" * 8, "shape.ply",
        note="a .ply file that announces 90 million vertices"),
    "mesh-damaged": _mesh(_HEADER + (12).to_bytes(4, "little") + b"\0" * 100, "shape.stl",
                          note="a binary .stl file that announces 12 triangles and ends within the second"),
    "mesh-not-finite": _mesh(_cube().replace("v 0.02 0.02 0.02", "v nan 0.02 0.02")),
    "mesh-units": _mesh(_cube(1000.0)),
    "mesh-open": _mesh(_pierced()),
    "mesh-crowded-edges": _mesh(_cube(more="v 0.05 0 0\nv 0.05 0 0.02\nf 2 6 10 9\nf 2 9 10 6\n")),
    "mesh-overlap": _mesh(_cube() + _second()),
    "mesh-winding": _mesh(_band(), note="shape.obj is a Moebius band"),
}  # fmt: skip
