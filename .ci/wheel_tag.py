"""Names a wheel with compiled kernels after the Python and the platform that they were compiled for."""

from __future__ import annotations

import sys
import sysconfig
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

#: What the pinned Numba, llvmlite and NumPy ask for of Linux; the kernels ask for nothing else.  An index refuses
#: wheels that name Linux alone.
LINUX = "manylinux_2_28"


class Tag(BuildHookInterface[Any]):
    """Looks whether kernels were compiled (``.ci/compile_kernels.py``) before the wheel is built."""

    PLUGIN_NAME = "custom"

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Set the tag of the wheel."""
        if version == "standard" and (Path(self.root) / "framework/itouch/compiled/manifest.json").exists():
            python = f"cp{sys.version_info[0]}{sys.version_info[1]}"
            platform = sysconfig.get_platform().replace("-", "_").replace(".", "_")
            platform = platform.replace("linux", LINUX, 1) if platform.startswith("linux_") else platform
            build_data["pure_python"], build_data["tag"] = False, f"{python}-{python}-{platform}"
