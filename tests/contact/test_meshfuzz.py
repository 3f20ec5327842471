"""Mesh files with random damage: a surface or a reason, never another exception, and never for long."""

from __future__ import annotations

import numpy as np
import pytest
from meshfiles import BOX, POLYGONS, WRITERS, glb_of, gltf_document, polygon_file
from probing import grid

from itouch.contact.meshfile import MeshError, MeshFile, load_source

ROUNDS = 120
WORDS = [b"nan", b"-1", b"1e999", b"0", b"99999999999999999999", b"\0", b"\xff\xff\xff\xff", b"\n", b" ", b"vertex", b"#",
         b"solid", b"endsolid", b"f ", b"v ", b"end_header\n", b"element face 7\n", b"\"count\":", b"[", b"{", b"null"]  # fmt: skip


@pytest.fixture(autouse=True)
def _no_cache(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ITOUCH_MESH_CACHE", "off")


def damaged(data: bytes, rng: np.random.Generator) -> bytes:
    """Alter one byte; or alter, cut, double, remove or put in bytes at random places, once or a few times."""
    out = bytearray(data)
    if rng.random() < 0.4:
        out[int(rng.integers(0, len(out)))] = int(rng.integers(0, 256))
        return bytes(out)
    for _ in range(int(rng.integers(1, 5))):
        at, length = int(rng.integers(0, len(out) + 1)), int(rng.integers(1, 40))
        kind = rng.integers(0, 6)
        if kind == 0 and at < len(out):
            out[at] = int(rng.integers(0, 256))
        elif kind == 1:
            out[at : at + length] = rng.bytes(length)
        elif kind == 2:
            del out[at : at + length]
        elif kind == 3:
            out[at:at] = out[at : at + length]
        elif kind == 4:
            out[at:at] = WORDS[int(rng.integers(0, len(WORDS)))]
        else:
            del out[at:]
    return bytes(out)


SOUND = {
    name: (kind, [writer(*BOX), writer(*grid(3))]) for name, (kind, writer) in WRITERS.items()
} | {
    f"{kind} of polygons": (polygon_file(kind, POLYGONS["mixed"][0])[0], [polygon_file(kind, f)[1] for f, _ in POLYGONS.values()])
    for kind in ("OFF", "OBJ", "text PLY", "PLY, little end first")
}  # fmt: skip


@pytest.mark.parametrize("name", SOUND)
def test_damaged_files_give_a_surface_or_a_reason(name: str) -> None:
    kind, sound = SOUND[name]
    rng = np.random.default_rng(sum(name.encode()))
    refused = 0
    for turn in range(ROUNDS):
        data = damaged(sound[turn % len(sound)], rng)
        try:
            mesh = load_source(MeshFile.of(f"a.{kind}", data))
        except MeshError as error:
            refused += 1
            assert error.code
            assert "\n" not in error.sentence
            assert len(error.sentence) < 300
        else:
            assert mesh.facts.triangles >= 2
            assert np.isfinite(mesh.surface.closest([0.1, 0.2, 0.3])[1])
    assert 0 < refused < ROUNDS


VALUES = [
    None,
    -1,
    0,
    1,
    2**31,
    2**63,
    1e300,
    float("nan"),
    "x",
    [],
    {},
    True,
    [0],
    5121,
    "SCALAR",
    [[1]],
    [1e308] * 16,
]


def test_random_gltf_documents_give_a_surface_or_a_reason() -> None:
    rng = np.random.default_rng(3)
    for _ in range(300):
        document, content = gltf_document(*BOX, [{"mesh": 0, "children": [1], "scale": [1, 1, 1]}, {"mesh": 0}])
        for _ in range(int(rng.integers(1, 4))):
            spot = document
            while True:
                keys = list(spot) if isinstance(spot, dict) else list(range(len(spot)))
                key = keys[int(rng.integers(0, len(keys)))]
                if not isinstance(spot[key], (dict, list)) or not spot[key] or rng.random() < 0.2:
                    spot[key] = VALUES[int(rng.integers(0, len(VALUES)))]
                    break
                spot = spot[key]
        try:
            load_source(MeshFile.of("a.glb", glb_of(document, content)))
        except MeshError as error:
            assert error.code
