"""The bench runs, says what it has, and writes what it says."""

import json
from pathlib import Path

import numpy as np
import pytest

from itouch.bench.contact import main
from itouch.bench.contact.work import HEIGHT_FIELD_CELLS, SPHERE_SUBDIVISIONS, around, height_field, icosphere


def test_a_small_bench(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
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
