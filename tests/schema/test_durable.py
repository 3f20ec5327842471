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
