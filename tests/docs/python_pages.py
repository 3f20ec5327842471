"""What a reader has at hand where the Python listings of a page begin: files, names, a device."""

from __future__ import annotations

import csv
import functools
import importlib
import json
import shutil
import subprocess
import sys
import tempfile
import types
from collections.abc import Callable
from pathlib import Path
from typing import Any
from unittest.mock import create_autospec

import fake_psychopy
import pytest
from shipped import SCENES

from itouch_tools.study import client

Names = dict[str, Any]
Setup = Callable[[Path, pytest.MonkeyPatch], Names]


class EnoughError(Exception):
    """An endless listing has shown that it works."""


@functools.cache
def recording() -> bytes:
    """Return some seconds of the four-material scene, recorded."""
    from itouch_tools.cli import main

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.mcap"
        scene = str(SCENES / "four_materials_hurried.xml")
        assert main(["run", scene, "--headless", "--for", "8s", "--record", str(path)]) == 0
        return path.read_bytes()


def scenes(folder: Path, patch: pytest.MonkeyPatch) -> Names:
    shutil.copytree(SCENES, folder / "scenes")
    return {}


def engine(folder: Path, patch: pytest.MonkeyPatch) -> Names:
    import itouch

    scenes(folder, patch)
    scene = folder / "scenes" / "faults.xml"
    scene.write_text(scene.read_text().replace('at="8 s"', 'at="8 s" for="0.5 s"'))
    return {"itouch": itouch, "engine": itouch.build(scene)}


def recorded(folder: Path, patch: pytest.MonkeyPatch) -> Names:
    import itouch

    scenes(folder, patch)
    (folder / "run.mcap").write_bytes(recording())
    (folder / "touch.mcap").write_bytes(recording())
    patch.setenv("MPLBACKEND", "Agg")
    return {"session": itouch.build(folder / "scenes" / "first_touch.xml")}


def plugin(folder: Path, patch: pytest.MonkeyPatch) -> Names:
    import struct
    from dataclasses import dataclass

    import serialx

    import itouch.plugin

    names = {name: getattr(itouch.plugin, name) for name in itouch.plugin.__all__}
    return {**names, "dataclass": dataclass, "struct": struct, "serialx": serialx}


def mesh(folder: Path, patch: pytest.MonkeyPatch) -> Names:
    shutil.copy(SCENES / "meshes" / "pebble.stl", folder / "bunny.stl")
    return {}


def solver(folder: Path, patch: pytest.MonkeyPatch) -> Names:
    import itouch_thermal as heat

    side = {"layers": [{"name": "body", "L": 0.02, "k": 0.4, "rho": 1000, "c": 3500}], "back": {"type": "insulated"}}
    case = {
        "finger": {**side, "initial": {"type": "uniform", "T": 33.0}},
        "object": {**side, "initial": {"type": "uniform", "T": 23.0}}, "Rth": 2e-3,
    }  # fmt: skip
    (folder / "case.json").write_text(json.dumps(case))
    contact = heat.Contact.from_json(folder / "case.json")
    return {"resistances": [2e-3, 1e-3, float("inf")], "contacts": [contact] * 3, "times": [1e-3, 1e-2]}


def arm(folder: Path, patch: pytest.MonkeyPatch) -> Names:
    """A Falcon is attached, and somebody homes it; after fifty exchanges the reader has seen enough."""
    import itouch_usb_arm
    from itouch_usb_arm import Falcon, boot
    from itouch_usb_arm.virtual import VirtualBackend, VirtualFalcon, VirtualTime

    image = boot.build([boot.Block(0x3F8000, tuple(range(150)))], entry=0x3F8002)
    (folder / "falcon.bin").write_bytes(image)
    time = VirtualTime()
    backend = VirtualBackend(VirtualFalcon(time=time))

    class Attached(Falcon):
        reads = 0

        def __init__(self, firmware: str, **options: Any) -> None:
            super().__init__(firmware, backend, clock=time.now, **options)

        def read(self) -> Any:
            self.reads += 1
            if self.reads > 20_000:
                raise EnoughError
            return super().read()

    patch.setattr(itouch_usb_arm, "Falcon", Attached)
    patch.setattr("builtins.input", lambda: "")
    return {}


def _autospecced(module: str, name: str) -> Setup:
    """Return a setup with a driver of the same calls and no arm behind it; after some reads it is enough."""

    def setup(folder: Path, patch: pytest.MonkeyPatch) -> Names:
        home = importlib.import_module(module)
        driver = create_autospec(getattr(home, name))
        arm = driver.return_value.__enter__.return_value = create_autospec(getattr(home, name), instance=True)
        arm.read.side_effect = [types.SimpleNamespace(position=(0.0, 0.0, 0.1))] * 5 + [EnoughError]
        patch.setattr(home, name, driver)
        return {}

    return setup


def servo(folder: Path, patch: pytest.MonkeyPatch) -> Names:
    """The scene is short, and the session that a reader attaches to is a session of this test."""
    import itouch
    import itouch.servo

    scenes(folder, patch)
    launch, attach = itouch.launch, itouch.servo.attach
    running: list[str] = []

    def short(scene: str, **options: Any) -> Any:
        handle = launch(
            folder / "scenes" / "first_touch.xml", **{**options, "seconds": 1.0, "name": f"docs-{folder.name}"}
        )
        running[:] = [f"docs-{folder.name}"]
        return handle

    patch.setitem(vars(itouch), "launch", short)

    def attached(name: str = "") -> Any:
        handle = launch(folder / "scenes" / "first_touch.xml", seconds=3.0, name=f"docs-two-{folder.name}")
        link = attach(f"docs-two-{folder.name}")
        link.keeper = handle
        return link

    patch.setattr(itouch.servo, "attach", lambda name="": attach(name) if name else attached())
    return {}


def led(folder: Path, patch: pytest.MonkeyPatch) -> Names:
    """A small study is served by a process of its own, which ends with the page."""
    scene = (SCENES / "first_touch.xml").read_text(encoding="utf-8")
    end = '        <to pos="0 0 50 mm" in="0.2 s"/>\n      </motion>'
    (folder / "scene.xml").write_text(scene.replace("      </motion>", end), encoding="utf-8")
    (folder / "four_materials.xml").write_text(
        '<study version="1.0" scene="scene.xml" seed="1">\n  <task kind="identify" factor="material"/>\n'
        '  <factor name="material" levels="soft hard" set="wood/contact.stiffness" values="0.8 N/mm; 1.2 N/mm"/>\n'
        '  <contact object="block" duration="0.1 s"/>\n</study>'
    )
    words = [sys.executable, "-m", "itouch_tools.cli", "study", "serve", "four_materials.xml", "--pace", "fast"]
    process = subprocess.Popen(words, cwd=folder, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert "is served" in process.stdout.readline()

    for name, module in fake_psychopy.modules().items():
        patch.setitem(sys.modules, name, module)
    patch.setitem(sys.modules, "itouch_client", client)  # the copy of the file that the page speaks of

    def close() -> None:
        process.kill()
        process.communicate()
        with (folder / "answers.csv").open(encoding="utf-8") as stream:
            rows = list(csv.DictReader(stream))
        assert len(rows) == 10 and all(row["said"] == "w" and not row["void"] for row in rows), rows

    return {"close": close}


#: Page -> what stands ready; pages that are not here have nothing but Python.
def nothing(folder: Path, patch: pytest.MonkeyPatch) -> Names:
    """A page whose listings need nothing."""
    return {}


SETUPS: dict[str, Setup] = {
    "docs/explanation/observers.md": nothing,
    "docs/reference/studies.md": nothing,
    "README.md": plugin,
    "docs/how-to/slow-device.md": plugin,
    "docs/how-to/lead-from-another-program.md": led,
    "docs/tutorials/first-touch.md": scenes,
    "docs/explanation/scene-model-state.md": scenes,
    "docs/how-to/inject-faults.md": engine,
    "docs/how-to/make-a-figure.md": recorded,
    "docs/how-to/read-data-in-pandas.md": recorded,
    "docs/reference/contact-api.md": mesh,
    "docs/reference/thermal-solver.md": solver,
    "docs/reference/device-usb-arm.md": arm,
    "docs/how-to/drive-real-devices.md": arm,
    "docs/reference/servo.md": servo,
    "docs/reference/device-haply.md": _autospecced("itouch_arms.haply", "Inverse3"),
    "docs/reference/device-openhaptics.md": _autospecced("itouch_arms.openhaptics", "Phantom"),
}
