"""``<mesh>``: its file, its faults at their place, its place in includes and in what is written back."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from shipped import SCENES

import itouch
from itouch.contact import Mesh
from itouch.plugin.discovery import Catalog
from itouch.scene import loads, read_scene, write
from itouch.schema import Problem, SceneError
from itouch.world import Model, compile_scene
from itouch.world.scene_files import contents
from itouch_tools.cli import main


def cube(size: float = 0.02, flip: bool = False) -> bytes:
    """A binary STL of a cube about its origin."""
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * size / 2
    sides = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    faces = [(s[0], s[i], s[i + 1]) for s in sides for i in (1, 2)]
    faces = [f[::-1] for f in faces] if flip else faces
    rows = b"".join(b"\0" * 12 + corners[list(f)].astype("<f4").tobytes() + b"\0\0" for f in faces)
    return b"cube".ljust(80) + struct.pack("<I", len(faces)) + rows


def scene(body: str, *, head: str = "") -> str:
    return f"""<itouch version="1.0">{head}
  <materials><material name="stone"><contact stiffness="1 N/mm"/></material></materials>
  <world>
    {body}
  </world>
</itouch>
"""


MESH = '<mesh name="a" file="cube.stl" material="stone"/>'


@pytest.fixture(autouse=True)
def _cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ITOUCH_MESH_CACHE", str(tmp_path / "cache"))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    place = tmp_path / "scene"
    place.mkdir()
    (place / "cube.stl").write_bytes(cube())
    return place


def compiled(folder: Path, text: str) -> tuple[Model | None, list[Problem]]:
    path = folder / "scene.xml"
    path.write_text(text)
    found, problems = read_scene(path, Catalog())
    model, more = (None, []) if any(p.severity == "error" for p in problems) else compile_scene(found, Catalog())
    return model, problems + more


def the_problem(folder: Path, text: str) -> Problem:
    model, problems = compiled(folder, text)
    assert len(problems) == 1
    if problems[0].severity == "error":
        assert model is None
    return problems[0]


def test_a_mesh_stands_where_it_is_put(folder: Path) -> None:
    model, problems = compiled(
        folder, scene('<mesh name="a" file="cube.stl" scale="50 mm" pos="0 0 1" rpy="0 0 45 deg" material="stone"/>')
    )
    assert not problems
    assert model is not None
    shape = model.shapes[0]
    assert isinstance(shape, Mesh)
    assert shape.surface.is_solid
    assert shape.surface.bound == pytest.approx(0.0005 * 3**0.5)
    np.testing.assert_allclose(model.poses[0], [0, 0, 1, np.cos(np.pi / 8), 0, 0, np.sin(np.pi / 8)])


def test_two_objects_share_one_surface_unless_they_differ(folder: Path) -> None:
    body = [
        MESH,
        MESH.replace('"a"', '"b"'),
        MESH.replace('"a"', '"c" scale="2"'),
        MESH.replace('"a"', '"d" sides="two"'),
    ]
    model, problems = compiled(folder, scene("".join(body)))
    assert model is not None and not problems
    a, b, c, d = (shape.surface for shape in model.shapes if isinstance(shape, Mesh))
    assert a is b
    assert c.bound == pytest.approx(2 * a.bound)
    assert d.two_sided and not a.two_sided
    assert (
        d.tables is a.tables or np.shares_memory(d.tables[0], a.tables[0]) or np.array_equal(d.tables[0], a.tables[0])
    )


@pytest.mark.parametrize("attribute", ['scale="0.5"', 'sides="two"', 'scale="1 mm" sides="two"', ""])
def test_what_is_written_reads_back(folder: Path, attribute: str) -> None:
    model, _ = compiled(folder, scene(MESH.replace("/>", f" {attribute}/>")))
    if "mm" in attribute:  # 20 micrometres: told, and it reads back all the same
        model, _ = compiled(folder, scene(MESH.replace("/>", f" {attribute}/>")))
    assert model is not None
    again = loads(write(model.scene).encode(), Catalog())
    assert again == model.scene
    assert write(again) == write(model.scene)
    assert 'file="cube.stl"' in write(again)


def test_paths_are_relative_to_the_file_that_names_them(folder: Path) -> None:
    (folder / "parts" / "meshes").mkdir(parents=True)
    (folder / "parts" / "meshes" / "small.stl").write_bytes(cube(0.01))
    (folder / "parts" / "part.xml").write_text(
        scene(
            '<mesh name="p" file="meshes/small.stl" material="stone"/><mesh name="q" file="../cube.stl" material="stone"/>'
        )
    )
    (folder / "scene.xml").write_text('<itouch version="1.0"><include file="parts/part.xml"/></itouch>')
    loaded = itouch.load(folder / "scene.xml")
    assert [element.file for element in loaded.objects] == ["parts/meshes/small.stl", "cube.stl"]
    model = Model.of(loaded, Catalog())
    assert [file.file for file in model.files] == ["cube.stl", "parts/meshes/small.stl"]
    assert loads(write(loaded).encode(), Catalog()) == loaded


def test_a_scene_with_the_content_of_its_files_needs_no_disk(folder: Path) -> None:
    model, _ = compiled(folder, scene(MESH))
    assert model is not None
    (file,) = model.files
    assert (file.file, file.data) == ("cube.stl", cube())
    text, files = write(model.scene).encode(), contents(model.files)
    (folder / "cube.stl").unlink()
    again = Model.of(loads(text, Catalog(), files=files), Catalog())
    assert [f.digest for f in again.files] == [file.digest]
    np.testing.assert_array_equal(again.geometry.world, model.geometry.world)
    assert again.geometry.mesh is not None and model.geometry.mesh is not None
    for one, other in zip(again.geometry.mesh, model.geometry.mesh, strict=True):
        np.testing.assert_array_equal(one, other)
    with pytest.raises(SceneError, match="does not hold 'cube.stl'"):
        Model.of(loads(text, Catalog(), files={}), Catalog())


FAULTS = {
    "absent.stl": (None, "no-such-file"),
    "../cube.stl": (None, "outside-folder"),
    "http://example.org/cube.stl": (None, "outside-folder"),
    "link.stl": (None, "outside-folder"),
    "empty.stl": (b"", "mesh-empty"),
    "text.stl": (b"Dear colleague, here is the mesh. " * 9, "mesh-damaged"),
    "one.stl": (cube()[:80] + struct.pack("<I", 1) + cube()[84:134], "mesh-empty"),
    "nan.stl": (cube()[:96] + struct.pack("<f", float("nan")) + cube()[100:], "mesh-not-finite"),
    "archive.stl": (b"PK\x03\x04" + b"\0" * 99, "mesh-format"),
    "cube.step": (b"ISO-10303-21;", "mesh-format"),
    "vast.stl": (cube(1e6), "mesh-units"),
}


@pytest.mark.parametrize("file", FAULTS)
def test_faults_are_told_at_the_file_attribute(folder: Path, file: str, capsys: pytest.CaptureFixture[str]) -> None:
    data, code = FAULTS[file]
    if data is not None:
        (folder / file).write_bytes(data)
    (folder.parent / "outside.stl").write_bytes(cube())
    (folder / "link.stl").symlink_to(folder.parent / "outside.stl")
    problem = the_problem(folder, scene(MESH.replace("cube.stl", file)))
    assert (problem.code, problem.severity) == (code, "error")
    assert problem.place is not None
    assert (problem.place.line, problem.place.column) == (4, 20)
    assert problem.place.text[19:].startswith(f'file="{file}"')
    assert problem.advice
    for words in (["check"], ["run", "--for", "1s"]):
        assert main([*words, str(folder / "scene.xml")]) == 2
        said = capsys.readouterr().err
        assert f"error[{code}]" in said
        assert "scene.xml:4:20" in said
        assert "1 problem; nothing was started." in said


def test_all_faults_are_told_at_once(folder: Path) -> None:
    (folder / "bad.stl").write_bytes(b"x")
    _, problems = compiled(
        folder, scene(MESH.replace("cube", "bad") + MESH.replace('"a" file="cube', '"b" file="absent'))
    )
    assert [problem.code for problem in problems] == ["mesh-damaged", "no-such-file"]


@pytest.mark.parametrize(
    ("attribute", "code"),
    [('scale="0"', "out-of-range"), ('scale="-1"', "out-of-range"), ('scale="3 kg"', "bad-value"),
     ('sides="both"', "bad-value"), ('size="1 1 1"', "unknown-attribute")],
)  # fmt: skip
def test_its_attributes_are_checked(folder: Path, attribute: str, code: str) -> None:
    assert the_problem(folder, scene(MESH.replace("/>", f" {attribute}/>"))).code == code


def test_all_meshes_together_have_a_bound(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from itouch.world import object_shapes

    monkeypatch.setattr(object_shapes, "MAX_TRIANGLES", 30)
    bodies = [MESH.replace('"a"', f'"m{n}" scale="{n + 1}"') for n in range(4)]
    assert not compiled(folder, scene("\n".join(bodies[:2] + bodies[:1]).replace("m0", "x", 1)))[1]
    _, problems = compiled(folder, scene("\n".join(bodies)))
    assert [problem.code for problem in problems] == ["mesh-too-large"] * 2
    assert "36 triangles together" in problems[0].sentence


def test_all_files_together_have_a_bound(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from itouch.world import scene_files

    (folder / "other.stl").write_bytes(cube(0.03))
    monkeypatch.setattr(scene_files, "MOST_BYTES", 1000)
    problem = the_problem(folder, scene(MESH + MESH.replace('"a" file="cube', '"b" file="other')))
    assert problem.code == "mesh-too-large"
    assert problem.place is not None
    assert 'file="other.stl"' in problem.place.text


def test_a_file_must_be_named(folder: Path) -> None:
    assert the_problem(folder, scene('<mesh name="a" material="stone"/>')).code == "missing-attribute"
    assert the_problem(folder, scene('<mesh name="a" file=" " material="stone"/>')).code == "bad-value"


def test_millimetres_are_asked_for_and_a_scale_is_an_answer(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "cube.stl").write_bytes(cube(20.0))
    problem = the_problem(folder, scene(MESH))
    assert (problem.code, problem.severity) == ("mesh-units", "warning")
    assert 'scale="0.001"' in problem.advice
    assert problem.place is not None
    assert main(["check", str(folder / "scene.xml")]) == 0
    assert "are these millimetres?" in capsys.readouterr().err
    model = Model.of(itouch.load(folder / "scene.xml"), Catalog())
    assert any("'cube.stl' is 20 m long" in notice for notice in model.notices)
    for scale in ("1", "1 mm", "0.001"):
        assert not compiled(folder, scene(MESH.replace("/>", f' scale="{scale}"/>')))[1]


def test_mends_are_said_by_check_and_kept_for_the_report(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "cube.stl").write_bytes(cube(flip=True))
    (folder / "scene.xml").write_text(scene(MESH))
    assert main(["check", str(folder / "scene.xml")]) == 0
    assert "note: object 'a': 'cube.stl': 1 closed part turned: inside out" in capsys.readouterr().out
    assert "inside out" in Model.of(itouch.load(folder / "scene.xml"), Catalog()).notices[0]


def test_an_absolute_path_inside_the_folder_is_made_relative(folder: Path) -> None:
    model, problems = compiled(folder, scene(MESH.replace("cube.stl", str(folder / "cube.stl"))))
    assert model is not None and not problems
    assert model.scene.objects[0].file == "cube.stl"


def test_defaults_hold_for_meshes(folder: Path) -> None:
    (folder / "cube.stl").write_bytes(cube(20.0))
    model, problems = compiled(folder, scene(MESH, head='<defaults><mesh scale="1 mm"/></defaults>'))
    assert model is not None and not problems


def test_a_mesh_that_the_table_cannot_reach_is_told(folder: Path) -> None:
    (folder / "rigs").mkdir()
    (folder / "rigs" / "twin.xml").write_bytes((SCENES / "rigs" / "twin.xml").read_bytes())
    probe = '<interaction><probe name="finger" pose-from="arm" force-to="arm" surface-to="table"/></interaction>'
    text = scene(MESH.replace("/>", ' pos="POS"/>'), head='<include file="rigs/twin.xml"/>').replace(
        "</itouch>", probe + "</itouch>"
    )
    assert not compiled(folder, text.replace("POS", "0 0 5 mm"))[1]
    for place in ("300 0 5 mm", "0 0 200 mm"):
        assert the_problem(folder, text.replace("POS", place)).code == "out-of-reach"


def test_the_shipped_meshes_are_what_their_script_makes() -> None:
    namespace: dict[str, object] = {"__file__": str(SCENES / "meshes" / "make.py"), "__name__": "make"}
    exec((SCENES / "meshes" / "make.py").read_text(), namespace)
    made = namespace["contents"]()  # type: ignore[operator]
    assert {name: (SCENES / "meshes" / name).read_bytes() for name in made} == made


def test_the_shipped_scene_of_meshes_is_felt() -> None:
    session = itouch.build(SCENES / "mesh.xml")
    session.enable()
    session.run(None)
    report = session.report()
    session.close()
    touched = {contact["object"]: contact for contact in report["contacts"]}
    assert set(touched) == {"pebble", "relief"}
    assert all(0.3 < contact["peak_force_N"] < 3.0 for contact in touched.values())
    assert not report["faults"]
    assert any("open surface" in notice for notice in report["notices"])
