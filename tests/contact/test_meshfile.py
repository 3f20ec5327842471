"""Mesh files of every format: what is read, and what is refused with a reason."""

from __future__ import annotations

import gzip
import io
import json
import os
import struct
import zipfile
from pathlib import Path

import numpy as np
import pytest
from meshfiles import BOX, POLYGONS, WRITERS, glb_of, gltf_document, obj, off, ply, polygon_file, stl, stl_text
from probing import grid

from itouch.contact.meshfile import MeshError, MeshFile, load_mesh, load_source, read_mesh_file
from itouch.contact.meshfile import mesh_bytes as source_module
from itouch.contact.meshfile.size_limits import MAX_FACES


@pytest.fixture(autouse=True)
def _no_cache(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ITOUCH_MESH_CACHE", "off")


def refused(file: str, data: bytes) -> MeshError:
    with pytest.raises(MeshError) as caught:
        load_source(MeshFile.of(file, data))
    return caught.value


@pytest.mark.parametrize("name", WRITERS)
def test_every_format_gives_the_same_box(name: str) -> None:
    kind, writer = WRITERS[name]
    mesh = load_source(MeshFile.of(f"box.{kind}", writer(*BOX)))
    assert mesh.facts.triangles == 12
    assert mesh.facts.parts == 1
    assert mesh.facts.open_edges == 0
    assert mesh.surface.is_solid
    assert (mesh.facts.low, mesh.facts.high) == ((-0.5, -0.25, -0.125), (0.5, 0.25, 0.125))
    point, distance, _ = mesh.surface.closest([0.1, 0.05, 1.0])
    np.testing.assert_allclose(point, [0.1, 0.05, 0.125], atol=1e-12)
    assert distance == pytest.approx(0.875, abs=1e-12)
    assert not mesh.findings


def test_a_scale_is_the_length_of_the_files_unit() -> None:
    mesh = load_source(MeshFile.of("box.stl", stl(*BOX)), scale=1e-2)
    assert mesh.facts.high == pytest.approx((0.005, 0.0025, 0.00125))


@pytest.mark.parametrize("end", ["STL", "Stl"])
def test_the_end_of_a_name_may_be_written_large(end: str) -> None:
    assert load_source(MeshFile.of(f"box.{end}", stl(*BOX))).facts.triangles == 12


def test_a_binary_stl_whose_header_says_solid() -> None:
    assert load_source(MeshFile.of("box.stl", stl(*BOX, header=b"solid facet normal endsolid"))).facts.triangles == 12


def test_a_text_stl_of_several_solids_and_in_capitals() -> None:
    vertices, faces = BOX
    text = stl_text(vertices, faces[:6]) + stl_text(vertices, faces[6:])
    assert load_source(MeshFile.of("box.stl", text)).facts.triangles == 12
    assert load_source(MeshFile.of("box.stl", text.upper())).facts.triangles == 12


@pytest.mark.parametrize(
    "name", [name for name, (kind, _) in WRITERS.items() if name not in ("binary STL", "binary PLY", "GLB")]
)
@pytest.mark.parametrize("end", [b"\r\n", b"\r"])
def test_texts_of_other_systems(name: str, end: bytes) -> None:
    kind, writer = WRITERS[name]
    text = b"\xef\xbb\xbf" + writer(*BOX).replace(b"\n", end)
    assert load_source(MeshFile.of(f"a.{kind}", text)).surface.is_solid


def test_the_name_of_a_solid_may_hold_any_word() -> None:
    text = stl_text(*BOX).replace(b"made by hand", b"vertex normal endsolid facet 7")
    assert load_source(MeshFile.of("box.stl", text)).surface.is_solid


def test_a_long_text_stl_is_read_in_pieces(monkeypatch: pytest.MonkeyPatch) -> None:
    from itouch.contact.meshfile import preflight

    text = stl_text(*grid(8))
    whole = load_source(MeshFile.of("grid.stl", text)).surface.tables
    monkeypatch.setattr(preflight, "_PIECE", 1000)
    pieces = load_source(MeshFile.of("grid.stl", text)).surface.tables
    for one, other in zip(whole, pieces, strict=True):
        np.testing.assert_array_equal(one, other)


def test_normals_that_cannot_be_read_do_not_matter_and_are_not_logged(caplog: pytest.LogCaptureFixture) -> None:
    text = stl_text(*BOX).replace(b"normal 0 0 0", b"normal up", 3)
    assert load_source(MeshFile.of("box.stl", text)).surface.is_solid
    assert not caplog.records


def test_an_obj_with_quads_textures_and_numbers_counted_back() -> None:
    quads = """v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvn 0 0 1\ng one\nusemtl red\nf 1/1/1 2/1/1 3/1/1 4/1/1
v 0 0 1\nv 1 0 1\nv 1 1 1\no two\nf -3 -2 -1\nl 1 2\n"""
    mesh = load_source(MeshFile.of("a.obj", quads.encode()))
    assert mesh.facts.triangles == 3
    assert mesh.surface.closest([0.9, 0.2, 1.0])[1] < 1e-15
    assert mesh.surface.closest([0.2, 0.9, 0.0])[1] < 1e-15


@pytest.mark.parametrize("faces", POLYGONS)
@pytest.mark.parametrize("kind", ["OFF", "OBJ", "text PLY", "PLY, little end first", "PLY, great end first"])
def test_polygons_become_triangles(kind: str, faces: str) -> None:
    polygons, triangles = POLYGONS[faces]
    end, data = polygon_file(kind, polygons)
    mesh = load_source(MeshFile.of(f"a.{end}", data))
    assert mesh.facts.triangles == triangles
    assert mesh.facts.turned_faces == 0
    square = mesh.surface.closest([[0.2, 0.7, 0.0], [0.7, 0.2, 0.0], [0.9, 0.9, 1.0]])[1]
    np.testing.assert_allclose(square, [0.0, 0.0, 1.0], atol=1e-12)


def test_nodes_place_the_meshes_of_a_gltf() -> None:
    half = np.sqrt(0.5)
    nodes = [
        {"children": [1, 2, 3], "translation": [0, 0, 5]},
        {"mesh": 0, "rotation": [0, 0, half, half]},
        {"mesh": 0, "translation": [3, 0, 0], "scale": [-2, 1, 1]},
        {"mesh": 0, "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 6, 0, 1]},
    ]
    mesh = load_source(MeshFile.of("three.glb", glb_of(*gltf_document(*BOX, nodes))))
    assert mesh.facts.parts == 3
    assert mesh.facts.closed_parts == 3
    assert mesh.facts.turned_parts == 0  # the mirrored one has its front outside
    assert mesh.surface.is_solid
    np.testing.assert_allclose(mesh.facts.low, [-0.5, -0.5, 4.875], atol=1e-6)
    np.testing.assert_allclose(mesh.facts.high, [4.0, 6.25, 5.125], atol=1e-6)
    np.testing.assert_allclose(mesh.surface.closest([0.0, 0.9, 5.0])[1], 0.4, atol=1e-6)


def test_a_glb_that_trimesh_writes() -> None:
    import trimesh

    scene = trimesh.Scene()
    scene.add_geometry(trimesh.Trimesh(*BOX), transform=trimesh.transformations.translation_matrix([0, 0, 2]))
    scene.add_geometry(trimesh.Trimesh(*BOX))
    mesh = load_source(MeshFile.of("two.glb", scene.export(file_type="glb")))
    assert mesh.facts.parts == 2
    np.testing.assert_allclose([mesh.facts.low[2], mesh.facts.high[2]], [-0.125, 2.125], atol=1e-6)


def test_strips_fans_and_sparse_values_of_a_gltf() -> None:
    square = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], float)
    document, content = gltf_document(square, np.array([[0, 1, 2]]))
    del document["meshes"][0]["primitives"][0]["indices"]
    document["meshes"][0]["primitives"][0]["mode"] = 5
    strip = load_source(MeshFile.of("strip.glb", glb_of(document, content)))
    assert strip.facts.triangles == 2
    assert strip.facts.turned_faces == 0
    corners = strip.surface.tables[0][strip.surface.tables[1][:, :3]]
    assert (np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2] > 0).all()

    where = struct.pack("<H", 3) + b"\0\0" + struct.pack("<3f", 2, 2, 0)
    document["bufferViews"] += [
        {"buffer": 0, "byteOffset": len(content), "byteLength": 4},
        {"buffer": 0, "byteOffset": len(content) + 4, "byteLength": 12},
    ]
    document["buffers"][0]["byteLength"] += len(where)
    document["accessors"][0]["sparse"] = {
        "count": 1, "indices": {"bufferView": 2, "componentType": 5123}, "values": {"bufferView": 3}
    }  # fmt: skip
    moved = load_source(MeshFile.of("sparse.glb", glb_of(document, content + where)))
    assert moved.facts.high == (2.0, 2.0, 0.0)


def test_a_gltf_takes_its_buffer_from_beside_it_and_holds_it_from_then_on(tmp_path: Path) -> None:
    document, content = gltf_document(*BOX)
    document["buffers"][0]["uri"] = "my%20box.bin"
    document["images"] = [{"uri": "http://example.org/absent.png"}]
    (tmp_path / "my box.bin").write_bytes(content)
    (tmp_path / "box.gltf").write_text(json.dumps(document))
    source = read_mesh_file(tmp_path / "box.gltf")
    (tmp_path / "my box.bin").unlink()
    assert load_source(source).facts.triangles == 12
    assert b"example.org" not in source.data


@pytest.mark.parametrize("uri", ["../box.bin", "/etc/hostname", "http://localhost/box.bin", "sub/../../box.bin"])
def test_a_gltf_may_not_refer_to_what_is_outside(tmp_path: Path, uri: str) -> None:
    (tmp_path / "box.bin").write_bytes(b"x" * 1000)
    (tmp_path / "scene" / "sub").mkdir(parents=True)
    document, _ = gltf_document(*BOX)
    document["buffers"][0]["uri"] = uri
    (tmp_path / "scene" / "box.gltf").write_text(json.dumps(document))
    with pytest.raises(MeshError) as caught:
        read_mesh_file(tmp_path / "scene" / "box.gltf")
    assert caught.value.code == "outside-folder"


REFUSED = {
    "empty STL": ("a.stl", b"", "mesh-damaged", "not a valid STL"),
    "text": ("a.stl", b"Dear colleague,\nplease find the mesh attached.\n" * 9, "mesh-damaged", "begins with 'Dear"),
    "short text": ("a.stl", b"hello", "mesh-damaged", "begins with 'hello'"),
    "lying count": (
        "a.stl",
        stl(*BOX, count=10**6),
        "mesh-damaged",
        "says 1000000 triangles, its length is that of 12",
    ),
    "too small a count": ("a.stl", stl(*BOX, count=3), "mesh-damaged", "says 3 triangles"),
    "no triangles": ("a.stl", stl(*BOX, count=0)[:84], "mesh-empty", "no triangles"),
    "no triangles in text": ("a.stl", b"solid x\nendsolid x\n", "mesh-empty", "no triangles"),
    "cut": ("a.stl", stl(*BOX)[:-70], "mesh-damaged", "its length"),
    "cut text": ("a.stl", stl_text(*BOX)[:-120], "mesh-damaged", "middle"),
    "a facet of two corners": (
        "a.stl",
        stl_text(*BOX).replace(b"   vertex 0.5", b"   ", 1),
        "mesh-damaged",
        "35 corners",
    ),
    "a word for a number": (
        "a.stl",
        stl_text(*BOX).replace(b"0.5", b"half", 1),
        "mesh-damaged",
        "a word stands where a number must be",
    ),
    "one triangle": ("a.stl", stl(BOX[0], BOX[1][:1]), "mesh-empty", "single triangle"),
    "no area": (
        "a.off",
        b"OFF\n3 2 0\n0 0 0\n1 1 1\n2 2 2\n3 0 1 2\n3 0 1 1\n",
        "mesh-empty",
        "no triangle with an area",
    ),
    "NaN": ("a.obj", obj(*BOX).replace(b"v 0.5", b"v nan", 1), "mesh-not-finite", "not a finite number"),
    "infinite": ("a.ply", ply(BOX[0] * [1, np.inf, 1], BOX[1]), "mesh-not-finite", "of 12 triangles"),
    "greater than floats": ("a.obj", obj(*BOX).replace(b"v 0.5", b"v 1e999", 1), "mesh-not-finite", "finite"),
    "vast": ("a.ply", ply(BOX[0] * 1e200, BOX[1]), "mesh-units", "long"),
    "tiny": ("a.ply", ply(BOX[0] * 1e-200, BOX[1]), "mesh-units", "long"),
    "a kilometre away": ("a.ply", ply(BOX[0] + 1000.0, BOX[1]), "mesh-units", "from its origin"),
    "absent vertex": (
        "a.obj",
        obj(*BOX) + b"\nf 1 2 99\n",
        "mesh-damaged",
        "a face names corner 99, and the file has 8",
    ),
    "word as a corner": (
        "a.obj",
        b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 x\n",
        "mesh-damaged",
        "line 4: a face names its corner 'x', which is not a number",
    ),
    "corner 0": (
        "a.obj",
        b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 0 1 2\n",
        "mesh-damaged",
        "line 4: a face names its corner '0', and an OBJ counts corners from 1",
    ),
    "corner before the first": (
        "a.obj",
        b"v 0 0 0\nf -1 -2 -3\n",
        "mesh-damaged",
        "line 2: a face names a corner before",
    ),
    "negative vertex": ("a.off", off(BOX[0], BOX[1] - 1), "mesh-damaged", "OFF"),
    "points only": ("a.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\n", "mesh-empty", "no triangles"),
    "points only, PLY": ("a.ply", ply(BOX[0], BOX[1][:0]), "mesh-empty", "no triangles"),
    "binary as OBJ": ("a.obj", stl(*BOX), "mesh-damaged", "not text"),
    "lying PLY": ("a.ply", ply(*BOX, count=10**12), "mesh-too-large", "1000000000000"),
    "lying PLY within the cap": ("a.ply", ply(*BOX, count=10**6), "mesh-damaged", "announces at least"),
    "PLY without an end": ("a.ply", ply(*BOX)[:120], "mesh-damaged", "header does not end"),
    "PLY, unknown type": ("a.ply", ply(*BOX).replace(b"double x", b"tripel x"), "mesh-damaged", "tripel"),
    "lying OFF": ("a.off", b"OFF\n999999999999 999999999999 0\n0 0 0\n", "mesh-too-large", "999999999999"),
    "OFF that ends": ("a.off", b"OFF\n1000000 1000000 0\n0 0 0\n", "mesh-damaged", "more than it has bytes"),
    "OFF without counts": ("a.off", b"OFF\nhello\n", "mesh-damaged", "OFF"),
    "text PLY of too many lines": (
        "a.ply",
        ply(*BOX, binary=False) + b"\n" * 2000,
        "mesh-damaged",
        "announces 20 rows",
    ),
    "OFF of too many lines": ("a.off", off(*BOX) + b"\r" * 2000, "mesh-damaged", "announces 20 rows"),
    "text PLY of too many": ("a.ply", ply(*BOX, binary=False, count=5 * 10**6), "mesh-too-large", "5000000 vertices"),
    "GLB, other magic": ("a.glb", b"glTG" + b"\0" * 40, "mesh-damaged", "GLB"),
    "GLB, cut": ("a.glb", b"glTF", "mesh-damaged", "glTF"),
    "glTF, a list": ("a.gltf", b"[]", "mesh-damaged", "not an object"),
    "glTF, deep": ("a.gltf", b"[" * 100_000, "mesh-damaged", "glTF"),
    "glTF 1": ("a.gltf", b'{"asset": {"version": "1.0"}}', "mesh-damaged", "version 1.0"),
    "glTF without meshes": ("a.gltf", b'{"asset": {"version": "2.0"}}', "mesh-empty", "no triangles"),
    "another format": ("a.step", b"ISO-10303-21;", "mesh-format", "mesh files are .stl"),
    "an archive": ("a.zip", b"PK\x03\x04", "mesh-format", "zip"),
    "no end": ("mesh", b"", "mesh-format", "no ending"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_bad_files_are_refused_with_a_code_and_a_reason(name: str) -> None:
    file, data, code, words = REFUSED[name]
    error = refused(file, data)
    assert error.code == code
    assert words in error.sentence
    assert f"'{file}'" in error.sentence
    assert isinstance(error, ValueError)


def _changed(change: str) -> bytes:
    document, content = gltf_document(*BOX)
    exec(change, {"d": document})
    return glb_of(document, content)


CHANGES = {
    "a count beyond the buffer": "d['accessors'][0]['count'] = 10**6",
    "a vast count without a buffer": "d['accessors'][0].update(count=10**12); del d['accessors'][0]['bufferView']",
    "a negative count": "d['accessors'][0]['count'] = -5",
    "a negative index": "d['nodes'][0]['mesh'] = -1",
    "an absent accessor": "d['meshes'][0]['primitives'][0]['indices'] = 7",
    "a view beyond the buffer": "d['bufferViews'][0]['byteOffset'] = 2**40",
    "a stride of nothing": "d['bufferViews'][0]['byteStride'] = 0",
    "a buffer that says too much": "d['buffers'][0]['byteLength'] = 2**40",
    "a node that is its own child": "d['nodes'][0]['children'] = [0]",
    "nodes in a ring": "d['nodes'] = [{'children': [1], 'mesh': 0}, {'children': [0]}]",
    "a node twice": "d['scenes'][0]['nodes'] = [0, 0]",
    "a rotation of zeros": "d['nodes'][0]['rotation'] = [0, 0, 0, 0]",
    "a matrix of three": "d['nodes'][0]['matrix'] = [1, 2, 3]",
    "a word for a number": "d['nodes'][0]['translation'] = ['x', 0, 0]",
    "an infinite place": "d['nodes'][0]['translation'] = [1e999, 0, 0]",
    "another file": "d['buffers'][0]['uri'] = '/etc/hostname'",
    "compressed": "d['extensionsRequired'] = ['KHR_draco_mesh_compression']",
    "positions of two columns": "d['accessors'][0]['type'] = 'VEC2'",
    "an unknown type": "d['accessors'][0]['componentType'] = 5124",
    "a number for a list": "d['nodes'] = 3",
}


@pytest.mark.parametrize("name", CHANGES)
def test_a_glb_is_checked_before_it_is_followed(name: str) -> None:
    error = refused("a.glb", _changed(CHANGES[name]))
    assert error.code in ("mesh-damaged", "mesh-format")


def test_instances_count_as_often_as_they_stand(monkeypatch: pytest.MonkeyPatch) -> None:
    from itouch.contact.meshfile import gltf

    monkeypatch.setattr(gltf, "MAX_FACES", 100)
    nodes = [{"children": list(range(1, 20))}, *({"mesh": 0} for _ in range(19))]
    error = refused("many.glb", glb_of(*gltf_document(*BOX, nodes)))
    assert error.code == "mesh-too-large"


def test_a_header_over_the_cap_is_refused_before_anything_is_read() -> None:
    rows = b"\0" * 50 * 3
    error = refused("a.stl", b"x".ljust(80) + struct.pack("<I", MAX_FACES + 1) + rows)
    assert error.code in ("mesh-too-large", "mesh-damaged")
    assert refused("a.ply", ply(*BOX).replace(b"face 12", b"face 9999999999")).code == "mesh-too-large"


# --- from disk ------------------------------------------------------------------------------------------------------


def _refused_path(path: Path, folder: Path | None = None) -> MeshError:
    with pytest.raises(MeshError) as caught:
        read_mesh_file(path, folder=None if folder is None else str(folder))
    return caught.value


def test_what_is_no_file_is_refused(tmp_path: Path) -> None:
    assert _refused_path(tmp_path / "absent.stl").code == "no-such-file"
    (tmp_path / "folder.stl").mkdir()
    assert "is a folder" in _refused_path(tmp_path / "folder.stl").sentence
    os.mkfifo(tmp_path / "pipe.stl")
    assert "not a regular file" in _refused_path(tmp_path / "pipe.stl").sentence
    (tmp_path / "empty.stl").touch()
    assert _refused_path(tmp_path / "empty.stl").code == "mesh-empty"
    assert _refused_path(tmp_path / ("x" * 5000 + ".stl")).code == "no-such-file"


def test_a_file_over_the_cap_is_not_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with (tmp_path / "vast.stl").open("wb") as stream:
        stream.truncate(source_module.MAX_BYTES + 1)  # sparse: takes no disk
    error = _refused_path(tmp_path / "vast.stl")
    assert error.code == "mesh-too-large"
    assert "320 MiB" in error.sentence


def test_archives_are_refused_and_not_opened(tmp_path: Path) -> None:
    bomb = io.BytesIO()
    with zipfile.ZipFile(bomb, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("a.stl", b"\0" * 50_000_000)
    (tmp_path / "bomb.stl").write_bytes(bomb.getvalue())
    (tmp_path / "bomb.obj").write_bytes(gzip.compress(b"\0" * 50_000_000))
    assert "zip archive" in _refused_path(tmp_path / "bomb.stl").sentence
    assert "gzip" in _refused_path(tmp_path / "bomb.obj").sentence


def test_nothing_outside_the_folder_is_read_not_even_through_a_link(tmp_path: Path) -> None:
    inside, outside = tmp_path / "scene", tmp_path / "elsewhere"
    inside.mkdir()
    outside.mkdir()
    (outside / "box.stl").write_bytes(stl(*BOX))
    (inside / "link.stl").symlink_to(outside / "box.stl")
    (inside / "folder").symlink_to(outside)
    (inside / "sound.stl").symlink_to(inside / "box.stl")
    (inside / "box.stl").write_bytes(stl(*BOX))
    assert _refused_path(inside / "link.stl", inside).code == "outside-folder"
    assert _refused_path(inside / "folder" / "box.stl", inside).code == "outside-folder"
    assert _refused_path(inside / ".." / "elsewhere" / "box.stl", inside).code == "outside-folder"
    assert read_mesh_file(inside / "sound.stl", folder=str(inside)).data == stl(*BOX)


def test_load_mesh_takes_a_path_a_scale_and_sides(tmp_path: Path) -> None:
    path = tmp_path / "tile.obj"
    path.write_bytes(obj(*grid(3)))
    mesh = load_mesh(path, scale=0.1, two_sided=True)
    assert mesh.surface.two_sided
    assert mesh.facts.high[0] == pytest.approx(0.05)
    for scale in (0.0, -1.0, float("nan"), float("inf"), "1 mm"):
        with pytest.raises(MeshError, match="scale is"):
            load_mesh(path, scale=scale)
