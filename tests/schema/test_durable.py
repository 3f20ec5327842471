"""Whole files: what is no file of the user's, such as a device, a pipe or a link, is not replaced by one."""

from __future__ import annotations

import os
import stat
from pathlib import Path

import pytest

from itouch.schema.durable import write_whole

pytestmark = pytest.mark.skipif(os.name == "nt", reason="Windows has neither such devices nor pipes in folders")


def test_a_pipe_is_written_into_and_stays_one(tmp_path: Path) -> None:
    pipe = tmp_path / "p"
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    try:
        write_whole(str(pipe), b"all of it")
        assert os.read(reader, 100) == b"all of it"
    finally:
        os.close(reader)
    assert stat.S_ISFIFO(pipe.stat().st_mode)
    with pytest.raises(OSError, match="No such device"):  # nobody reads: it is not waited for
        write_whole(str(pipe), b"again")
    assert [one.name for one in tmp_path.iterdir()] == ["p"]


def test_a_device_is_written_into_and_stays_one(tmp_path: Path) -> None:
    inner, outer = os.openpty()
    try:
        device = os.ttyname(outer)
        os.set_blocking(inner, False)
        link = tmp_path / "terminal"
        link.symlink_to(device)
        write_whole(str(link), b"all of it")
        assert os.read(inner, 100) == b"all of it"
        assert link.is_symlink() and stat.S_ISCHR(os.stat(device).st_mode)
    finally:
        os.close(inner)
        os.close(outer)


@pytest.mark.parametrize("there", [True, False], ids=["there", "to come"])
def test_a_link_stays_one_and_its_file_is_replaced_whole(there: bool, tmp_path: Path) -> None:
    (tmp_path / "disk").mkdir()
    file, link = tmp_path / "disk" / "s.itouch", tmp_path / "latest.itouch"
    link.symlink_to("disk/s.itouch")
    if there:
        file.write_bytes(b"old")
    write_whole(str(link), b"new")
    assert link.is_symlink() and file.read_bytes() == b"new"
    assert sorted(one.name for one in tmp_path.rglob("*")) == ["disk", "latest.itouch", "s.itouch"]


@pytest.mark.parametrize(("mask", "rights"), [(0o077, 0o600), (0o002, 0o664)])
def test_a_new_file_has_the_rights_that_the_user_gives_to_new_files(tmp_path: Path, mask: int, rights: int) -> None:
    """A session has what a participant has felt: a laboratory's umask says who may read it."""
    before = os.umask(mask)
    try:
        write_whole(str(tmp_path / "s.itouch"), b"new")
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "s.itouch").stat().st_mode) == rights


@pytest.mark.parametrize("rights", [0o600, 0o664])
def test_a_file_keeps_its_rights(tmp_path: Path, rights: int) -> None:
    seen: list[int] = []

    def look(where: str) -> None:
        seen.extend(stat.S_IMODE(one.stat().st_mode) for one in tmp_path.glob(".itouch-*.part"))

    path = tmp_path / "s.itouch"
    path.write_bytes(b"old")
    path.chmod(rights)
    write_whole(str(path), b"new", step=look)
    assert path.read_bytes() == b"new" and stat.S_IMODE(path.stat().st_mode) == rights
    assert seen and not any(each & ~rights for each in seen)  # nor may anybody else read it while it is written
