"""Surfaces are kept by the content of their files; a damaged entry is as good as none."""

from __future__ import annotations

import json
import os
import socket
import struct
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from meshfiles import BOX, stl
from probing import grid
from requirements import meant

from itouch import caches
from itouch.contact import Proxy, bvh
from itouch.contact.meshfile import LoadedMesh, MeshFile, cache, load_source
from itouch_evidence.contact.contact_workload import icosphere

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


def test_the_default_folder_follows_xdg_and_home(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv("ITOUCH_MESH_CACHE")
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache.folder() == tmp_path / "itouch-py" / "meshes"
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    assert cache.folder() == tmp_path / "home" / ".cache" / "itouch-py" / "meshes"


def test_a_damaged_entry_is_built_anew(folder: Path) -> None:
    """Bytes altered, cut or added anywhere: never a fault, never another surface, and repaired on disk."""
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


def test_a_hierarchy_deeper_than_the_searches_can_go_is_built_anew() -> None:
    """Each index leads somewhere and each checksum is right: the first search ended the program."""
    first = load_source(BALL)
    vertices, triangles, nodes = first.surface.tables
    above = np.zeros((5000, bvh.NODE_WIDTH), np.float32)
    for side in range(2):
        above[:, bvh.CHILD_WIDTH * side :][:, :3], above[:, bvh.CHILD_WIDTH * side :][:, 3:6] = -1.0, 1.0
        above[:, bvh.CHILD_WIDTH * side + bvh.CHILD_LOW], above[:, bvh.CHILD_WIDTH * side + bvh.CHILD_HIGH] = -9.0, 9.0
    above[:, bvh.CHILD_REF], above[:, bvh.CHILD_REF + 1] = np.arange(1, 5001), 5000
    moved = nodes.copy()
    moved[:, bvh.CHILD_REF : bvh.CHILD_COUNT][moved[:, bvh.CHILD_COUNT :] == 0] += 5000
    deep = type(first.surface).of_tables((vertices, triangles, np.concatenate([above, moved])), is_solid=True)
    cache.write(cache.key(BALL.digest, "stl", 1.0), deep, first.facts)
    again = load_source(BALL)
    assert not again.cached
    assert again.surface.closest([0.0, 0.0, 0.5])[1] == pytest.approx(0.45, abs=1e-4)


def test_slabs_are_found_anew() -> None:
    """A slab that is too thin hides the triangles in it from a probe."""
    first = load_source(BALL)
    vertices, triangles, nodes = first.surface.tables
    thin = nodes.copy()
    thin[:, bvh.CHILD_LOW] = thin[:, bvh.CHILD_HIGH] = 3.0
    name = cache.key(BALL.digest, "stl", 1.0)
    cache.write(name, type(first.surface).of_tables((vertices, triangles, thin), is_solid=True), first.facts)
    again = load_source(BALL)
    assert again.cached
    assert_same(first, again)


def test_a_surface_of_another_size_or_number_of_triangles_is_built_anew() -> None:
    first, name = load_source(BALL), cache.key(BALL.digest, "stl", 1.0)
    larger = load_source(BALL, scale=1.5, use_cache=False)
    finer = load_source(MeshFile.of("finer.stl", stl(*icosphere(3, 0.05))), use_cache=False)
    for other in (larger, finer):
        cache.write(name, other.surface, first.facts)
        again = load_source(BALL)
        assert not again.cached
        assert_same(first, again)


def forged(sound: bytes, change: Callable[[dict[str, Any]], None]) -> bytes:
    """The same entry with another header, whose checksum is right."""
    start = len(b"itouch-py mesh\n")
    length, _ = struct.unpack_from("<II", sound, start)
    header = json.loads(sound[start + 8 : start + 8 + length])
    change(header)
    text = json.dumps(header).encode()
    return sound[:start] + struct.pack("<II", len(text), zlib.crc32(text)) + text + sound[start + 8 + length :]


@pytest.mark.parametrize(
    "change",
    [
        lambda header: header["rows"].__setitem__(0, float("inf")),
        lambda header: header["rows"].__setitem__(0, 12_000_000),
        lambda header: header["rows"].__setitem__(0, 0),
        lambda header: header["rows"].pop(),
        lambda header: header["sums"].pop(),
        lambda header: header.pop("solid"),
        lambda header: header.update(facts=[]),
        lambda header: header["facts"].pop("edges"),
        lambda header: header["facts"].update(more=1),
        lambda header: header["facts"].update(edges=float("inf")),
        lambda header: header["facts"].update(edges="many"),
        lambda header: header["facts"].update(open_length=float("nan")),
        lambda header: header["facts"].update(open_length=10**400),
        lambda header: header["facts"].update(edges=10**400),
        lambda header: header["facts"].update(edges=True),
        lambda header: header["facts"]["low"].pop(),
        lambda header: header["facts"]["high"].__setitem__(0, [1.0]),
    ],
)
def test_a_header_that_makes_no_sense_is_none(folder: Path, change: Callable[[dict[str, Any]], None]) -> None:
    first = load_source(BALL)
    (entry,) = entries(folder)
    sound = entry.read_bytes()
    assert forged(sound, lambda header: None) == sound
    entry.write_bytes(forged(sound, change))
    again = load_source(BALL)
    assert not again.cached
    assert_same(first, again)
    assert entry.read_bytes() == sound


def a_socket(path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as one:
        here = os.getcwd()
        os.chdir(path.parent)  # the name of a socket must be short
        try:
            one.bind(path.name)
        finally:
            os.chdir(here)


@pytest.mark.parametrize("make", [os.mkfifo, a_socket, Path.mkdir, None], ids=["pipe", "socket", "folder", "link"])
def test_what_is_no_file_is_neither_waited_for_nor_read(
    folder: Path, tmp_path: Path, make: Callable[[Path], None] | None
) -> None:
    first = load_source(BALL)
    (entry,) = entries(folder)
    elsewhere = tmp_path / "elsewhere"
    entry.rename(elsewhere)
    if make is None:
        entry.symlink_to(elsewhere)
    else:
        make(entry)
    sound = elsewhere.read_bytes()
    again = load_source(BALL)
    assert not again.cached
    assert_same(first, again)
    assert elsewhere.read_bytes() == sound
    assert load_source(BALL).cached is (make is not Path.mkdir)  # replaced, but for a folder


@pytest.mark.parametrize("mode", [0o777, 0o770, 0o702])
def test_a_folder_that_others_can_write_is_neither_read_nor_written(folder: Path, mode: int) -> None:
    load_source(BALL)
    (entry,) = entries(folder)
    folder.chmod(mode)
    assert not load_source(BALL).cached
    entry.unlink()
    load_source(BALL)
    caches.put(folder, "one.mesh", [b"one"], size=3, capacity=10)
    assert entries(folder) == []
    folder.chmod(0o755)
    load_source(BALL)
    assert load_source(BALL).cached


@pytest.mark.parametrize("mode", [0o666, 0o620, 0o602])
def test_an_entry_that_others_can_write_is_built_anew(folder: Path, mode: int) -> None:
    load_source(BALL)
    (entry,) = entries(folder)
    entry.chmod(mode)
    assert not load_source(BALL).cached
    assert entry.stat().st_mode & 0o777 == 0o600
    assert load_source(BALL).cached


@pytest.mark.skipif(os.geteuid() != 0, reason=meant("only root can give files away"))
def test_files_of_another_user_are_not_used(folder: Path) -> None:
    load_source(BALL)
    (entry,) = entries(folder)
    os.chown(entry, 12345, 12345)
    assert not load_source(BALL).cached
    assert load_source(BALL).cached
    os.chown(folder, 12345, 12345)
    assert not load_source(BALL).cached


def test_a_folder_that_cannot_be_written_is_no_fault(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_text("x")
    monkeypatch.setenv("ITOUCH_MESH_CACHE", str(tmp_path / "file" / "below"))
    assert not load_source(BALL).cached
    assert not load_source(BALL).cached


def test_the_least_recently_used_entry_is_removed_first(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
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
