"""Surfaces are kept by the content of their files; a damaged entry is as good as none."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from meshfiles import BOX, stl
from probing import grid

from itouch.contact import Proxy
from itouch.contact.meshfile import LoadedMesh, MeshFile, cache, load_source
from itouch_evidence.contact.workload import icosphere

BALL = MeshFile.of("ball.stl", stl(*icosphere(2, 0.05)))


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("ITOUCH_MESH_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


def entries(folder: Path) -> list[Path]:
    return sorted(folder.iterdir())


def assert_same(one: LoadedMesh, other: LoadedMesh) -> None:
    assert (one.facts, one.findings) == (other.facts, other.findings)
    assert one.surface.is_solid == other.surface.is_solid
    assert (one.surface.skin, one.surface.bound) == (other.surface.skin, other.surface.bound)
    for a, b in zip(one.surface.tables, other.surface.tables, strict=True):
        assert a.dtype == b.dtype
        assert not b.flags.writeable
        np.testing.assert_array_equal(a, b)


def test_the_second_time_comes_from_the_cache_and_is_the_same(folder: Path) -> None:
    first, second = load_source(BALL), load_source(BALL)
    assert (first.cached, second.cached) == (False, True)
    assert_same(first, second)
    path = np.linspace([0.0, 0.0, 0.08], [0.01, 0.0, 0.04], 50)
    forces = [Proxy(mesh.surface, radius=0.01).follow(path) for mesh in (first, second)]
    np.testing.assert_array_equal(*forces)
    assert len(entries(folder)) == 1
    assert entries(folder)[0].stat().st_mode & 0o077 == 0


def test_content_and_scale_count_and_names_do_not(folder: Path) -> None:
    load_source(BALL)
    assert load_source(MeshFile.of("other.stl", BALL.data)).cached
    assert not load_source(BALL, scale=2.0).cached
    assert not load_source(MeshFile.of("ball.stl", stl(*BOX))).cached
    assert load_source(BALL, sides="two").cached
    assert load_source(BALL, sides="two").surface.two_sided
    assert not load_source(BALL, sides="one").surface.two_sided
    assert len(entries(folder)) == 3


def test_nothing_is_kept_when_it_is_switched_off(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    load_source(BALL, use_cache=False)
    assert not folder.exists()
    monkeypatch.setenv("ITOUCH_MESH_CACHE", "off")
    assert not load_source(BALL).cached
    assert not load_source(BALL).cached


def test_where_it_is_by_itself(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv("ITOUCH_MESH_CACHE")
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache.folder() == tmp_path / "itouch-py" / "meshes"
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    assert cache.folder() == tmp_path / "home" / ".cache" / "itouch-py" / "meshes"


def test_a_damaged_entry_is_built_anew(folder: Path) -> None:
    """Bytes altered, cut or added anywhere: never a fault, never another surface, and mended on disk."""
    first = load_source(BALL)
    (entry,) = entries(folder)
    sound = entry.read_bytes()
    rng = np.random.default_rng(7)
    places = [0, 3, 15, 17, 20, 25, *rng.integers(0, len(sound), 60).tolist()]
    damaged = [sound[:at] + bytes([sound[at] ^ (1 + at % 255)]) + sound[at + 1 :] for at in places]
    damaged += [sound[:at] for at in (0, 1, 14, 20, 200, len(sound) // 2, len(sound) - 1)]
    damaged += [sound + b"x", b"", b"itouch-py mesh\n" + b"\xff" * 40, sound.replace(b'"version": ', b'"version": 9')]
    for data in damaged:
        entry.write_bytes(data)
        again = load_source(BALL)
        assert not again.cached
        assert_same(first, again)
        assert entry.read_bytes() == sound


def test_indices_that_lead_nowhere_are_refused(folder: Path) -> None:
    """Even with right checksums: the kernels do not check."""
    mesh = load_source(BALL)
    vertices, triangles, nodes = mesh.surface.tables
    for table, row, column, value in (
        (1, 0, 0, 10**6),
        (1, 0, 5, -2),
        (1, 3, 3, 10**6),
        (2, 0, 22, 0.0),
        (2, 0, 22, 1e6),
    ):
        tables = [vertices.copy(), triangles.copy(), nodes.copy()]
        tables[table][row, column] = value
        bad = type(mesh.surface).of_tables((tables[0], tables[1], tables[2]), is_solid=True)
        name = cache.key(BALL.digest, "stl", 1.0)
        cache.write(name, bad, mesh.facts)
        assert cache.read(name) is None


def test_a_folder_that_cannot_be_written_is_no_fault(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_text("x")
    monkeypatch.setenv("ITOUCH_MESH_CACHE", str(tmp_path / "file" / "below"))
    assert not load_source(BALL).cached
    assert not load_source(BALL).cached


def test_what_was_not_used_for_longest_goes_first(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    files = [MeshFile.of("grid.stl", stl(*grid(n))) for n in (10, 11, 12)]
    for age, file in enumerate(files):
        load_source(file)
        os.utime(folder / f"{cache.key(file.digest, 'stl', 1.0)}.mesh", (age, age))
    assert load_source(files[0]).cached  # used now
    size = sum(entry.stat().st_size for entry in entries(folder))
    (folder / ".left.part").write_bytes(b"x")
    os.utime(folder / ".left.part", (0, 0))
    new = load_source(BALL, use_cache=False).surface.memory_bytes
    monkeypatch.setattr(cache, "CAPACITY", size + new + (1 << 16) - 1000)
    load_source(BALL)
    assert [load_source(file).cached for file in (files[0], files[2])] == [True, True]
    assert not (folder / ".left.part").exists()
    assert not cache.read(cache.key(files[1].digest, "stl", 1.0))
