"""What the docs show of the program, made by the program: pictures of scenes, and the help of every command."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).parent
SCENES = HERE.parent / "scenes"
#: File name -> words of the command that makes the picture.
PICTURES = {
    "contact": ("four_materials.xml", "--at", "11s", "--for", "11.1s"),
    "approach": ("four_materials.xml", "--at", "6.5s", "--for", "6.6s"),
    "fault": ("faults.xml",),
    "gallery-first_touch": ("first_touch.xml", "--at", "1.2s", "--for", "1.3s"),
    "gallery-metamer": ("metamer.xml", "--at", "8s", "--for", "8.1s"),
    "gallery-mesh": ("mesh.xml", "--at", "2s", "--for", "2.1s"),
    "gallery-moving": ("moving.xml", "--at", "2s", "--for", "2.1s"),
    "gallery-two_fingers": ("two_fingers.xml", "--at", "1.5s", "--for", "1.6s"),
    "gallery-texture": ("texture.xml", "--at", "1.5s", "--for", "1.6s"),
}


def draw_pictures() -> None:
    """Draw the pictures that are missing, or older than their scene."""
    out = HERE / "_generated"
    out.mkdir(exist_ok=True)
    for name, (scene, *words) in PICTURES.items():
        picture = out / f"{name}.png"
        if picture.exists() and picture.stat().st_mtime > (SCENES / scene).stat().st_mtime:
            continue
        command = [sys.executable, "-m", "itouch.cli", "run", str(SCENES / scene), "--screenshot", str(picture), *words]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode not in (0, 1):  # 1: the scene of faults
            raise RuntimeError(f"{' '.join(command)}:\n{done.stderr}")


def write_commands() -> None:
    """Write the reference of the command line, out of each command's own help."""
    from itouch.cli import COMMANDS, _plugin_commands

    lines = ["# Command line", "", "Generated from the commands' own help.", ""]
    for name in sorted({*COMMANDS, *_plugin_commands()}):
        done = subprocess.run([sys.executable, "-m", "itouch.cli", name, "--help"], capture_output=True, text=True,
                              check=False, env={"COLUMNS": "100", "PATH": "/usr/bin:/bin"})  # fmt: skip
        lines += [f"## itouch-py {name}", "", "```text", done.stdout.rstrip(), "```", ""]
    text = "\n".join(lines)
    page = HERE / "reference" / "command-line.md"
    if not page.exists() or page.read_text(encoding="utf-8") != text:
        page.write_text(text, encoding="utf-8")
