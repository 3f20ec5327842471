"""Every command of the reference once, and every scene once, in an empty folder: ``python .ci/tour.py [WORD]``.

A command that the reference has and this tour has not is an error.  WORD: only the steps that have it.  What needs a
running session, a person or hardware is started beside the rest, or asked for what it says without.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
#: Words of each step, and the exit codes that are right: 0 if none are named.
STEPS: list[tuple[str, tuple[int, ...]]] = [
    ("demo --scenes scenes", (0,)),
    ("demo first_touch --headless", (0,)),
    ("run scenes/first_touch.xml --headless --record a.mcap --save a.itouch --report a.json", (0,)),
    ("run a.itouch --headless --for 0.1s --no-record", (0,)),
    ("run scenes/first_touch.xml --headless --for 1s --no-record --screenshot a.png", (0,)),
    ("check scenes/four_materials.xml", (0,)),
    ("check scenes/four_materials.xml --json", (0,)),
    ("inspect a.itouch", (0,)),
    ("inspect a.mcap", (0,)),
    ("replay a.mcap", (0,)),
    ("recover a.mcap -o b.mcap", (0,)),
    ("export a.mcap --csv a.csv", (0,)),
    ("export a.mcap --bids bids --author Somebody", (0,)),
    ("export a.mcap --layout layout.json", (0,)),
    ("export a.mcap --rosbag bag", (0,)),
    ("export a.itouch --xml a.xml", (0,)),
    ("report a.mcap -o a.html", (0,)),
    ("safety-report scenes/four_materials.xml", (0,)),
    ("devices", (0,)),
    ("doctor", (0, 1)),
    ("explain speed", (0, 2)),
    ("schema schemas", (0,)),
    ("completion bash", (0,)),
    ("calibrate scenes/four_materials.xml", (0,)),
    ("new-scene mine", (0,)),
    ("new-plugin my-lever", (0,)),
    ("new-study three-materials", (0,)),
    ("test-plugin mouse", (0, 1)),
    ("study check scenes/studies/four_materials.xml", (0,)),
    ("sweep check scenes/sweeps/one_tuning.xml", (0,)),
    ("sync --marks 10", (0, 1)),
    ("thermal --help", (0,)),
    ("measure touch scenes/real_touch.xml -o wood.csv --raw raw", (0,)),
    ("identify raw --sample wood", (0,)),
    ("reproduce -o paper --figure 1", (0,)),
    ("virtual-arm --help", (0,)),
    ("virtual-rig scenes/four_materials_wire.xml --for 1s", (0,)),
    ("view --list", (0,)),
    ("bench tick --help", (0,)),
    ("watch --help", (0,)),
]
#: Files of scenes that are no sessions: libraries, and touches that are measured.
PARTS = ("materials", "handbook", "real_touch")


def main() -> int:
    """Go through all; return 1 if something ended as it should not."""
    only, bad = " ".join(sys.argv[1:]), 0
    text = (ROOT / "docs" / "reference" / "command-line.md").read_text(encoding="utf-8")
    named = set(re.findall(r"^## itouch-py ([\w-]+)$", text, re.M))
    left = named - {words.split()[0] for words, _ in STEPS}
    if left:
        print(f"the tour lacks: {', '.join(sorted(left))}")
        return 1
    scenes = [f"run scenes/{path.name} --headless --for 0.5s --no-record{_twins(path)}" for path in _scenes()]
    with tempfile.TemporaryDirectory() as folder:
        for words, codes in [*STEPS, *((words, (0,)) for words in scenes)]:
            if only in words or words.startswith("demo --scenes"):
                bad += not _step(words, codes, Path(folder))
    print("all ended as they should" if not bad else f"{bad} did not end as they should")
    return 1 if bad else 0


def _scenes() -> list[Path]:
    return [path for path in sorted((ROOT / "scenes").glob("*.xml")) if path.stem not in PARTS]


def _twins(path: Path) -> str:
    """Return what lets a scene whose devices are behind their protocols run without them."""
    return " --twin all" if path.stem.endswith(("_wire", "_diy")) else ""


def _step(words: str, codes: tuple[int, ...], folder: Path) -> bool:
    begun = time.monotonic()
    done = subprocess.run([sys.executable, "-m", "itouch_tools.cli", *words.split()], cwd=folder, capture_output=True,
                          text=True, stdin=subprocess.DEVNULL)  # fmt: skip
    good = done.returncode in codes and "Traceback" not in done.stderr
    print(f"{'ok ' if good else 'BAD'} {done.returncode} {time.monotonic() - begun:6.1f} s  {words}", flush=True)
    if not good:
        print("    " + "\n    ".join((done.stderr or done.stdout).strip().splitlines()[-6:]), flush=True)
    return good


if __name__ == "__main__":
    sys.exit(main())
