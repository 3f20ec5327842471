"""A scaffold's tests say what is next; done as its README says, it passes everything."""

from __future__ import annotations

import os
import subprocess
import sys
import time
import tomllib
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
from finishing import finish
from lxml import etree
from third_party_plugins import pip_install

from itouch.plugin import DeviceError, Terminal
from itouch.schema import ItouchError
from itouch_tools.cli import main
from itouch_tools.scaffold import make_plugin, make_scene
from itouch_tools.scaffold.plugin_distribution import KINDS, TRANSPORTS

#: Each kind and each transport is finished once in the short form; all of them together in the long one.
#: In the long form: CI goes the same way with the built wheel (.ci/kit_from_wheel.sh).
COMBINATIONS = [pytest.param(*each, marks=pytest.mark.long) for each in (("device", "serial"), ("both", "tcp"))]
_SHORT = {("device", "serial"), ("modality", "none"), ("both", "usb"), ("device", "tcp")}
ALL = [
    pytest.param(kind, how, marks=() if (kind, how) in _SHORT else pytest.mark.long)
    for kind in KINDS
    for how in TRANSPORTS
]


def run_tests_of(home: Path, site: Path | None, *words: str) -> subprocess.CompletedProcess[str]:
    path = os.pathsep.join(str(p) for p in (site, home) if p is not None)
    return subprocess.run([sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *words], cwd=home,
                          capture_output=True, text=True, env=os.environ | {"PYTHONPATH": path}, timeout=600)  # fmt: skip


@pytest.mark.parametrize(("kind", "transport"), COMBINATIONS)
def test_a_scaffold_says_what_is_next_and_passes_when_finished(kind, transport, tmp_path):
    make_plugin("test-lever", kind=kind, transport=transport, folder=str(tmp_path))
    home, site = tmp_path / "itouch-test-lever", tmp_path / "site"
    first = run_tests_of(home, None)
    assert first.returncode == 1
    assert "next is step 1:" in first.stdout
    steps = finish(home, "itouch_test_lever")
    assert steps >= 3
    pip_install(site, home)
    done = run_tests_of(home, site)
    assert done.returncode == 0, done.stdout[-3000:]
    assert done.stdout.splitlines()[-1].count("failed") == 0


@pytest.mark.parametrize(("kind", "transport"), ALL)
def test_every_scaffold_can_be_finished(kind, transport, tmp_path):
    make_plugin("test-lever", kind=kind, transport=transport, folder=str(tmp_path))
    home = tmp_path / "itouch-test-lever"
    assert finish(home, "itouch_test_lever") >= 3
    for path in home.rglob("*.py"):
        compile(path.read_text(), str(path), "exec")
    assert run_tests_of(home, None, "tests/test_steps.py").returncode == 0


def test_the_line_of_a_serial_scaffold_carries_lines_with_the_package_that_it_asks_for(tmp_path):
    """With ``serialx`` alone, as our own drivers do: no other package for serial ports can be imported here."""
    make_plugin("test-lever", transport="serial", folder=str(tmp_path))
    home = tmp_path / "itouch-test-lever"
    needed = tomllib.loads((home / "pyproject.toml").read_text())["project"]["dependencies"]
    extras = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())["project"][
        "optional-dependencies"
    ]
    assert needed[1:] == extras["tmcl"]
    source = (home / "itouch_test_lever" / "line.py").read_text()
    names: dict[str, Any] = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(sys.modules, "serial", None)
        exec(compile(source, "line.py", "exec"), names)
    with pytest.raises(DeviceError, match=r"no 'test-lever' at .*nowhere"):
        names["Line"](str(tmp_path / "nowhere"))
    other = Terminal(str(tmp_path / "port"))
    ours, second = names["Line"](str(tmp_path / "port")), names["Line"](str(tmp_path / "port"))
    second.close()

    def waits() -> float:
        begin = time.monotonic()
        assert ours.lines() == []
        return time.monotonic() - begin

    assert min(waits() for _ in range(20)) < 0.05  # not each: the machine may hold it up
    ours.send("F 0.5")
    other.send(b"P 0.1\nP 0.2\nP 0.")
    end = time.monotonic() + 300.0
    heard, said = b"", []
    while (heard, said) != (b"F 0.5\n", ["P 0.1", "P 0.2"]) and time.monotonic() < end:
        heard, said = heard + other.receive(), said + ours.lines()
    assert (heard, said) == (b"F 0.5\n", ["P 0.1", "P 0.2"])
    other.send(b"3\n")
    while len(said) < 3 and time.monotonic() < end:
        said += ours.lines()
    assert said[2:] == ["P 0.3"]
    other.close()
    with pytest.raises(DeviceError, match="'test-lever' is gone"):
        for _ in range(100):
            ours.lines()
            ours.send("F 0")
    ours.close()


def test_an_emulator_that_can_not_listen_says_so_and_can_be_closed(tmp_path, monkeypatch):
    wrong = {"tcp": ["192.0.2.1:4001", "nonsense"], "serial": ["/nowhere/port"]}
    for transport, ports in wrong.items():
        make_plugin(f"shut-{transport}", transport=transport, folder=str(tmp_path))
        finish(tmp_path / f"itouch-shut-{transport}", f"itouch_shut_{transport}")
        monkeypatch.syspath_prepend(str(tmp_path / f"itouch-shut-{transport}"))
        cls = getattr(import_module(f"itouch_shut_{transport}"), f"Shut{transport.title()}")
        for port in ports:
            emulator = cls.Emulator(cls.Params(port=port))
            with pytest.raises(DeviceError, match="127.0.0.1:4001" if transport == "tcp" else port):
                emulator.open()
            emulator.close()


def test_a_finished_device_has_fewer_than_120_lines(tmp_path):
    make_plugin("test-lever", transport="serial", folder=str(tmp_path))
    home = tmp_path / "itouch-test-lever"
    finish(home, "itouch_test_lever")
    assert len((home / "itouch_test_lever" / "device.py").read_text().splitlines()) < 120


def test_steps_come_one_after_the_other(tmp_path):
    make_plugin("test-lever", folder=str(tmp_path))
    home = tmp_path / "itouch-test-lever"
    device = home / "itouch_test_lever" / "device.py"
    device.write_text("\n".join(line for line in device.read_text().splitlines() if "# STEP 1" not in line))
    said = run_tests_of(home, None, "tests/test_steps.py").stdout
    assert "next is step 2:" in said and "device.py:" in said


@pytest.mark.parametrize("name", ["Lever", "a b", "../x", "1x", "-x", "x--y", "", "x" * 60, "é", "x²", "a_b", "a.b"])
def test_names_that_cannot_be_one_are_refused(name, tmp_path):
    with pytest.raises(ItouchError, match="small letters"):
        make_plugin(name, folder=str(tmp_path))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["thermal", "usb-arm", "py", "xmlish"])
def test_names_that_are_taken_are_refused(name, tmp_path, capsys):
    assert main(["new-plugin", name, "--folder", str(tmp_path)]) == 2
    assert f"'{name}'" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["none", "true", "device", "line", "twin", "class", "lever-2"])
def test_names_that_mean_something_in_python_are_no_trouble(name, tmp_path):
    make_plugin(name, kind="both", transport="serial", folder=str(tmp_path))
    package = f"itouch_{name.replace('-', '_')}"
    done = subprocess.run([sys.executable, "-c", f"import {package} as p; print(p.__all__)"], capture_output=True,
                          text=True, env=os.environ | {"PYTHONPATH": str(tmp_path / f"itouch-{name}")})  # fmt: skip
    assert done.returncode == 0, done.stderr


def test_an_existing_plugin_is_not_overwritten(tmp_path):
    make_plugin("lever", folder=str(tmp_path))
    with pytest.raises(ItouchError, match="is there already"):
        make_plugin("lever", folder=str(tmp_path))


def test_a_new_scene_runs_and_is_valid_for_its_editor(tmp_path, capsys):
    assert main(["new-scene", "blocks", "--folder", str(tmp_path)]) == 0
    home = tmp_path / "blocks"
    assert main(["check", str(home / "blocks.xml")]) == 0
    assert main(["run", str(home / "blocks.xml"), "--headless"]) == 0
    tree = etree.parse(str(home / "blocks.xml"))
    pointer = tree.getroot().getprevious()
    while pointer is not None and not isinstance(pointer, etree._ProcessingInstruction):
        pointer = pointer.getprevious()
    assert pointer is not None and pointer.target == "xml-model"
    etree.XMLSchema(etree.parse(str(home / pointer.get("href")))).assertValid(tree)
    with pytest.raises(ItouchError):
        make_scene("blocks", {}, folder=str(tmp_path))
