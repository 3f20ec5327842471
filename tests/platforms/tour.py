"""What a person does in a first hour, in one interpreter: run with ``python tour.py SCENES FOLDER [--long]``.

Prints one line of JSON a step: the command, its exit code, the last line of what it said; at the end a digest of the
State that a restored session has reached, for comparison between systems.
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import json
import sys
import traceback
from pathlib import Path


def steps(scenes: Path, folder: Path) -> list[list[str]]:
    """Return the commands of the tour."""
    scene, mcap, session = str(scenes / "four_materials.xml"), str(folder / "a.mcap"), str(folder / "a.itouch")
    return [
        ["check", scene],
        ["run", scene, "--headless", "--for", "1.5s", "--record", mcap, "--save", session, "--report",
         str(folder / "a.json")],
        ["inspect", session],
        ["run", session, "--headless", "--for", "0.5s", "--save", str(folder / "b.itouch")],
        ["run", scene, "--pace", "real", "--headless", "--for", "0.3s", "--record", str(folder / "r.mcap")],
        ["replay", mcap],
        ["export", mcap, "--csv", str(folder / "csv")],
        ["report", mcap, "-o", str(folder / "a.html")],
        ["run", scene, "--for", "0.2s", "--pace", "fast", "--screenshot", str(folder / "a.png")],
        ["doctor"],
        ["devices"],
        ["new-plugin", "lever", "--kind", "device", "--transport", "none", "--folder", str(folder)],
        ["check", str(folder / "missing.xml")],
        ["run", str(scenes / "four_materials_wire.xml"), "--headless", "--twin", "none"],
    ]  # fmt: skip


def study(scenes: Path, folder: Path) -> list[list[str]]:
    """Return the commands of a study with one simulated observer."""
    file, data = str(scenes / "studies" / "four_materials.xml"), str(folder / "panel")
    return [["study", "simulate", file, "-o", data, "--observers", "1"], ["study", "report", file, data]]


def main(scenes: Path, folder: Path, *, long: bool) -> None:
    """Take the tour."""
    from itouch_tools.cli import main as itouch_py

    for words in [*steps(scenes, folder), *(study(scenes, folder) if long else [])]:
        said, failed = io.StringIO(), ""
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
            try:
                code: object = itouch_py(words)
            except SystemExit as end:
                code = end.code
            except BaseException:
                code, failed = "traceback", traceback.format_exc()
        lines = said.getvalue().strip().splitlines() or [""]
        print(json.dumps({"step": " ".join(words[:2]), "code": code, "said": lines[-1], "failed": failed}), flush=True)
    import itouch

    for name in ("a", "b"):
        state = itouch.restore(folder / f"{name}.itouch").state
        print(json.dumps({"step": f"state {name}", "code": 0, "said": hashlib.sha256(state.tobytes()).hexdigest()}))


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]), long="--long" in sys.argv)
