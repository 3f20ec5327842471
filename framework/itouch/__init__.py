"""A framework for touch rendering with kinesthetic and thermal feedback.

>>> import itouch
>>> engine = itouch.build("scenes/four_materials.xml")      # doctest: +SKIP
>>> engine.run(5.0)                                         # doctest: +SKIP
>>> engine.report()["contacts"]                             # doctest: +SKIP
"""

from __future__ import annotations

import os
import sys
from importlib import import_module
from typing import TYPE_CHECKING, Any

from itouch.gc_policy import rare_collections
from itouch.moved import MOVED

# Kernels shipped with the program are compiled for one kind of processor, which Numba reads from the environment when
# it is imported: it is chosen here, before any module of the program or of a plugin can import Numba.
if os.path.exists(os.path.join(os.path.dirname(__file__), "compiled", "manifest.json")):
    from itouch.shipped import choose_processor

    choose_processor()

sys.meta_path.append(MOVED)

if TYPE_CHECKING:
    from itouch.loop import DeviceFaultError, Engine, EngineError, VirtualClock, WallClock
    from itouch.plugin import DeviceError
    from itouch.recording import Recording, RecordingError, read
    from itouch.scene import Scene, write
    from itouch.schema import ItouchError, Place, Problem, SceneError
    from itouch.servo import Handle, ServoError, launch
    from itouch.session import Session, SessionError, build, restore
    from itouch.session import load_scene as load
    from itouch.session.batch import batch
    from itouch.session.replaying import replay

#: Public name -> the module that has it, imported on first access, so that the command line starts fast.  ``sweep`` is
#: one of the tools, and is listed only because users write ``itouch.sweep``: the core imports nothing from the tools.
_HOMES = {
    "DeviceError": "itouch.plugin",
    "DeviceFaultError": "itouch.loop",
    "Engine": "itouch.loop",
    "EngineError": "itouch.loop",
    "Handle": "itouch.servo",
    "ItouchError": "itouch.schema",
    "Place": "itouch.schema",
    "Problem": "itouch.schema",
    "Scene": "itouch.scene",
    "SceneError": "itouch.schema",
    "ServoError": "itouch.servo",
    "Session": "itouch.session",
    "SessionError": "itouch.session",
    "VirtualClock": "itouch.loop",
    "WallClock": "itouch.loop",
    "batch": "itouch.session.batch",
    "build": "itouch.session",
    "Recording": "itouch.recording",
    "RecordingError": "itouch.recording",
    "launch": "itouch.servo",
    "load": "itouch.session:load_scene",
    "read": "itouch.recording",
    "replay": "itouch.session.replaying",
    "restore": "itouch.session",
    "sweep": "itouch_tools.sweeps.sweep_client",
    "write": "itouch.scene",
}

__all__ = [
    "DeviceError",
    "DeviceFaultError",
    "Engine",
    "EngineError",
    "Handle",
    "ItouchError",
    "Place",
    "Problem",
    "Recording",
    "RecordingError",
    "Scene",
    "SceneError",
    "ServoError",
    "Session",
    "SessionError",
    "VirtualClock",
    "WallClock",
    "batch",
    "build",
    "launch",
    "load",
    "read",
    "replay",
    "restore",
    "sweep",
    "write",
]


def __getattr__(name: str) -> Any:
    home = _HOMES.get(name)
    if home is None:
        raise AttributeError(f"module 'itouch' has no attribute '{name}'")
    module, _, attribute = home.partition(":")
    with rare_collections():
        return getattr(import_module(module), attribute or name)


def __dir__() -> list[str]:
    return sorted(__all__)
