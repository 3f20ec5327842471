"""The bench runs, says what it has, and writes what it says."""

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh

from itouch.schema import ItouchError
from itouch_evidence.contact import main
from itouch_evidence.contact.contact_workload import (
    HEIGHT_FIELD_CELLS,
    SPHERE_SUBDIVISIONS,
    around,
    height_field,
    icosphere,
)
from itouch_evidence.contact.measure import Row
from itouch_evidence.contact.step_bounds import judged


def test_a_small_bench_prints_and_writes_its_figures(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "figures.json"
    assert main(["--sizes", "1k", "--steps", "1400", "--no-peers", "--json", str(out)]) == 0
    said = capsys.readouterr().out
    assert "hf 1k: 968 triangles" in said
    assert "ico 1k: 1280 triangles" in said
    for work in json.loads(out.read_text())["contact"]:
        rows = {row["name"]: row for row in work["rows"]}
        assert rows["itouch step, friction 0.5/0.3"]["locked"] == 0
        assert rows["itouch step, no friction"]["force_in_free_space"] == 0
        assert rows["itouch step, no friction"]["error_p99_n"] < 0.1
        assert all(0 < row["p50_us"] <= row["p99_us"] <= row["max_us"] for row in rows.values())


def test_a_mesh_file_is_measured(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ITOUCH_MESH_CACHE", str(tmp_path / "cache"))
    trimesh.Trimesh(*icosphere(3, 50.0), process=False).export(tmp_path / "ball.stl")
    out = tmp_path / "figures.json"
    words = [
        "--mesh",
        str(tmp_path / "ball.stl"),
        "--scale",
        "0.001",
        "--steps",
        "600",
        "--no-peers",
        "--json",
        str(out),
    ]
    assert main(words) == 0
    said = capsys.readouterr().out
    assert "ball.stl: 1280 triangles" in said
    assert "again from the cache" in said
    figures = json.loads(out.read_text())["figures"]
    assert {figure["work"] for figure in figures} == {"ball.stl"}
    assert len(figures) == 8
    assert all(figure["pass"] for figure in figures)


@pytest.mark.parametrize(
    ("words", "says"),
    [(["--mesh", "absent.stl"], "cannot read 'absent.stl'"), (["--steps", "3"], "too few"), (["--mesh", __file__], "mesh files are .stl")],
)  # fmt: skip
def test_what_cannot_be_measured_is_said(words: list[str], says: str) -> None:
    with pytest.raises(ItouchError, match=says):
        main([*words, "--no-peers"])


def test_where_nothing_can_be_written_is_said_before_the_work(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["--json", "absent/x.json", "--no-peers"])
    assert "there is no folder 'absent'" in capsys.readouterr().err


def test_figures_are_judged() -> None:
    def row(name: str, p99: float, **more: float) -> Row:
        return Row(name, p99 / 2, p99, p99 * 2, **more)  # type: ignore[arg-type]

    step = {"locked": 0, "force_in_free_space": 0, "popped_through": 2, "outside_cone": 0}
    rows = [
        row("itouch step, friction 0.5/0.3", 10.0, **step),
        row("itouch step, no friction", 10.0, error_p99_n=0.2, **step),
        row("itouch step in the compiled loop, in contact, friction 0.5/0.3", 7.0),
        row("itouch closest", 3.0, build_ms=100.0, memory_mb=149.0),
        row("open3d compute_closest_points", 20.0, build_ms=50.0),
    ]
    verdicts = {figure.name: figure.passed for figure in judged("hf 1M", "1M", rows, smooth=True)}
    failed = {name for name, passed in verdicts.items() if not passed}
    assert failed == {
        "steps through the surface, friction 0.5/0.3", "steps through the surface, no friction",
        "spring force against k x exact penetration, p99, no friction", "step in the compiled loop, p50 in contact",
    }  # fmt: skip
    assert len(verdicts) == 14
    assert not any("CHAI3D" in figure.name for figure in judged("ico 1M", "", rows, smooth=True))


def test_the_surfaces_are_those_of_the_definition() -> None:
    counts = [2 * cells**2 for cells in HEIGHT_FIELD_CELLS.values()]
    assert counts == [968, 10_082, 100_352, 999_698]
    assert [20 * 4**n for n in SPHERE_SUBDIVISIONS.values()] == [1_280, 20_480, 81_920, 1_310_720]
    assert len(height_field(22)[1]) == 968
    vertices, faces = icosphere(3)
    assert len(faces) == 1280
    np.testing.assert_allclose(np.linalg.norm(vertices, axis=1), 0.5)
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (np.einsum("ni,ni->n", normals, corners.mean(axis=1)) > 0).all()


def test_a_path_around_any_surface_dives_in_half_of_the_time() -> None:
    work = around("box", *icosphere(2), 2000, 1.0)
    away = np.linalg.norm(work.hips, axis=1) - 0.5 - work.radius
    assert 0.4 < (away < 0).mean() < 0.6
