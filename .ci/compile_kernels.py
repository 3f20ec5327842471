"""Compile kernels to come with the wheel: ``python .ci/compile_kernels.py [--kept] [SCENE ...]``.

They go to ``framework/itouch/compiled``, for a kind of processor that is older than most (x86-64-v3).  Each scene (all
shipped scenes of twins, unless some are named) runs in a process of its own for some simulated time, recorded, and once
more as a later start, which finds its meshes built; whatever it does not compile is compiled where it is used.  With
``--kept`` what the folder of ITOUCH_KERNELS has for that kind of processor is taken as it is.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

TREE = Path(__file__).resolve().parents[1]
FOLDER = TREE / "framework" / "itouch" / "compiled"
SCENES = ("four_materials", "mesh", "texture_and_sound", "moving", "metamer", "two_fingers", "thermal_display")
_RUN = """
import sys, itouch
session = itouch.build(sys.argv[1])
session.record(sys.argv[3])
session.enable()
try:
    session.run(float(sys.argv[2]))
except itouch.DeviceFaultError:
    pass
session.close()
"""


def main() -> int:
    """Compile, and write the manifest."""
    sys.path.insert(0, str(TREE / "framework"))
    from itouch import shipped

    words = sys.argv[1:]
    take_kept = "--kept" in words
    chosen = [Path(word) for word in words if word != "--kept"] or [
        path for name in SCENES if (path := TREE / "scenes" / f"{name}.xml").exists()
    ]
    shutil.rmtree(FOLDER, ignore_errors=True)
    with tempfile.TemporaryDirectory() as kept:
        more = {
            shipped.MAKING: str(FOLDER), "ITOUCH_KEPT": "off", **({} if take_kept else {"NUMBA_CACHE_DIR": kept}),
            "ITOUCH_MESH_CACHE": os.path.join(kept, "meshes"),  # a mesh that this user has built would not be built now
            "NUMBA_CPU_NAME": shipped.BASELINE, "NUMBA_CPU_FEATURES": "",
        }  # fmt: skip
        for seconds in ("12.0", "0.01"):
            for scene in chosen:
                recorded = os.path.join(kept, "recording.mcap")
                words = [sys.executable, "-c", _RUN, str(scene), seconds, recorded]
                subprocess.run(words, env={**os.environ, **more}, check=True)
    FOLDER.chmod(0o755)
    print(f"{shipped.write_manifest(FOLDER)} compiled kernels in {FOLDER}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
