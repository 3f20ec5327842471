"""Pictures of every screen: ``python docs/screens.py [window | page | terminal | study | TREE]``.

The window is drawn off the screen, the page by Chromium, the terminal by a program on a pseudo-terminal of so many
columns.  TREE is a checkout of an earlier commit with its own ``.venv``, whose screens are those of before.  Pictures
go to ``docs/pictures/screens``; what is to be seen in each is said in ``docs/reference/screens.md``.
"""

from __future__ import annotations

import os
import pty
import shutil
import struct
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

HERE = Path(__file__).parent
SCENES, OUT = HERE.parent / "scenes", HERE / "pictures" / "screens"
#: Size -> word in a file's name.
SIZES = {(1280, 720): "hd", (3840, 2160): "4k"}
#: The command line of this program.
OURS = (sys.executable, "-m", "itouch")


def window() -> None:
    """Draw the window in a contact on both grounds, and its menu, temperatures, large words and a fault."""
    import itouch
    from itouch_tools.viewer.offscreen import Offscreen
    from itouch_tools.viewer.overlay import SessionStatus
    from itouch_tools.viewer.signals import Ring

    session = itouch.build(SCENES / "four_materials_hurried.xml")
    ring = Ring(session.model)
    session.run(11.0, each=lambda: ring.add(session.state), every=10)
    fault = [{"trip": "silence", "device": "table", "cause": "is silent", "safe": {"reached": True}}]
    for (width, height), size in SIZES.items():
        shots = Offscreen(session.model, width=width, height=height)
        shots.picture.ring, chosen = ring, shots.picture.choices
        chosen.menu, chosen.sound = True, True
        for light in (False, True):
            chosen.light = light
            ground = "light" if light else "dark"
            _keep(f"window-{size}-{ground}", shots.shoot(session.state))
            if light:
                continue
            for name, choices in {"temperatures": {"thermal": True}, "menu": {"help": True}, "large": {"larger": 2.5},
                                  "below": {"under": True}}.items():  # fmt: skip
                before = {word: getattr(chosen, word) for word in choices}
                for word, value in choices.items():
                    setattr(chosen, word, value)
                _keep(f"window-{size}-{name}", shots.shoot(session.state))
                for word, value in before.items():
                    setattr(chosen, word, value)
            _keep(f"window-{size}-fault", shots.shoot(session.state, SessionStatus(faults=fault)))
            shots.picture.pointed = (0.92 * width, 0.62 * height)
            _keep(f"window-{size}-cursor", shots.shoot(session.state))
            shots.picture.pointed = (-1.0, -1.0)
        shots.close()
    shots = Offscreen(session.model, width=720, height=1280)
    shots.picture.ring = ring
    _keep("window-upright", shots.shoot(session.state))
    shots.close()


def study() -> None:
    """Draw the screens of a study: what the participant sees at each cue, and what the operator sees of a rig."""
    from itouch_tools.study.session_display import Shown
    from itouch_tools.viewer.offscreen import open_context

    choices = ("aluminium", "pyrex", "wood", "polystyrene")
    asked = Shown("answer", question="What did you touch?", choices=choices, trial=12, trials=40)
    pressed = Shown("contact", left=1.8, force=1.1, window=(0.8, 1.3), trial=12, trials=40)
    resting = Shown("break", left=40.0, trial=20, trials=40)
    waits = Shown("hold", trial=12, trials=40, void=1)
    rig = [("arm: enabled", True), ("table: enabled", True), ("peltier: fault", False),
           ("the switch is not held: the devices wait", False), ("not ready yet", True),
           ("note: third finger, right hand_", True)]  # fmt: skip
    page = ["# What did you touch?", "", "You will touch one block with one finger, forty times.", "",
            "- Wait until you read *Touch now.*", "- Press as hard as the bar asks, and hold still.",
            "- Lift your finger when you are told, and answer.", "", "There is no right or wrong."]  # fmt: skip
    faces = {"question": asked, "contact": pressed, "break": resting, "hold": waits, "instructions": asked}
    for (width, height), size in SIZES.items():
        shown = open_context(width, height)
        from itouch_tools.viewer.buffers import Frame
        from itouch_tools.viewer.study_screens import DARK, LIGHT, StudyScreen  # the context comes first

        for ground, look in {"dark": DARK, "light": LIGHT}.items():
            board, frame = StudyScreen(look), Frame(width, height)
            for name, face in faces.items():
                board.participant(face, frame, page=page if name == "instructions" else ())
                _keep(f"study-{size}-{ground}-{name}", frame.read().copy())
            board.operator(waits, rig, frame)
            _keep(f"study-{size}-{ground}-operator", frame.read().copy())
            frame.delete()
        shown.close()


def _keep(name: str, pixels: NDArray[np.uint8]) -> None:
    """Write a picture, shape (height, width, 3), as WebP: a tenth of a PNG, and the colours stay."""
    OUT.mkdir(parents=True, exist_ok=True)
    Image.fromarray(pixels).save(OUT / f"{name}.webp", quality=86, method=6)


def before(tree: Path) -> None:
    """Draw what an earlier commit showed: window, page, terminal."""
    program = (str(tree / ".venv" / "bin" / "itouch-py"),)
    with tempfile.TemporaryDirectory() as folder:
        for (width, height), size in SIZES.items():
            shot, scene = f"{folder}/shot.png", str(tree / "scenes" / "four_materials_hurried.xml")
            words = ("--screenshot", shot, "--at", "11s", "--for", "11.1s", "--size", f"{width}x{height}")
            subprocess.run([*program, "run", scene, "--headless", *words], check=True, capture_output=True, cwd=folder)
            with Image.open(shot) as picture:
                _keep(f"before-window-{size}", np.asarray(picture.convert("RGB")))
    page(program, "before-page", tree)
    terminal(program, "before-terminal", tree)


def page(program: Sequence[str] = OURS, begin: str = "page", tree: Path = HERE.parent) -> None:
    """Let Chromium draw a session's page: on a screen, on a dark one, on a phone, on paper."""
    browser = shutil.which("chromium") or shutil.which("google-chrome") or "chrome"
    with tempfile.TemporaryDirectory() as folder:
        recording, report = f"{folder}/run.mcap", f"{folder}/run.html"
        scene = str(tree / "scenes" / "four_materials_hurried.xml")
        for done in (
            ("run", scene, "--headless", "--for", "24s", "--record", recording),
            ("report", recording, "-o", report),
        ):
            subprocess.run([*program, *done], check=True, capture_output=True, cwd=folder)
        for name, size, words in (
            ("hd-light", (1280, 720), ()),
            ("hd-dark", (1280, 720), ("--blink-settings=preferredColorScheme=0",)),
            ("4k-light", (3840, 2160), ("--force-device-scale-factor=1",)),
            ("phone", (390, 844), ()),
        ):
            shot = f"{folder}/shot.png"
            _chromium(browser, folder, f"--window-size={size[0]},{size[1]}", f"--screenshot={shot}", *words, report)
            with Image.open(shot) as picture:
                _keep(f"{begin}-{name}", np.asarray(picture.convert("RGB")))
        printed = f"{folder}/page.pdf"
        _chromium(browser, folder, f"--print-to-pdf={printed}", "--no-pdf-header-footer", report)
        if shutil.which("pdftoppm"):
            subprocess.run(["pdftoppm", "-png", "-r", "60", "-f", "1", "-l", "1", "-singlefile", printed,
                            str(OUT / f"{begin}-print")], check=True)  # fmt: skip


def _chromium(browser: str, home: str, *words: str) -> None:
    base = [browser, "--headless=new", "--no-sandbox", "--disable-gpu", "--hide-scrollbars",
            f"--user-data-dir={home}/chromium", "--virtual-time-budget=8000"]  # fmt: skip
    subprocess.run([*base, *words], check=True, capture_output=True, timeout=300)


def terminal(program: Sequence[str] = OURS, begin: str = "terminal", tree: Path = HERE.parent) -> None:
    """Write what stands on terminals of 80 and 120 columns after a run and a check, as pictures of text."""
    from rich.console import Console
    from rich.text import Text

    with tempfile.TemporaryDirectory() as folder:
        wrong = Path(folder) / "scene.xml"
        wrong.write_text('<itouch version="1.0">\n  <wrold temperature="22"/>\n</itouch>\n', encoding="utf-8")
        said = {
            "run": ["run", "scenes/first_touch.xml", "--headless"],
            "check": ["check", "scene.xml"],
            "help": ["--help"],
        }
        for columns in (80, 120):
            for name, words in said.items():
                command = [*program, *words]
                shown = "".join(_typed(command, columns, folder if name == "check" else str(tree)))
                console = Console(record=True, width=columns, file=open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115
                for line in shown.replace("\r\n", "\n").split("\n"):
                    console.print(Text.from_ansi(line.rpartition("\x1b[2K")[2].rpartition("\r")[2]))
                OUT.mkdir(parents=True, exist_ok=True)
                console.save_svg(str(OUT / f"{begin}-{columns}-{name}.svg"), title=f"itouch-py {words[0]}")


def _typed(command: list[str], columns: int, folder: str) -> Iterator[str]:
    """Yield what a command writes on a terminal of so many columns."""
    import fcntl
    import termios

    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 40, columns, 0, 0))
    environment = {**os.environ, "TERM": "xterm-256color", "COLUMNS": ""}
    process = subprocess.Popen(command, stdin=theirs, stdout=theirs, stderr=theirs, cwd=folder, env=environment)
    os.close(theirs)
    data = b""
    while True:
        try:
            block = os.read(ours, 65536)
        except OSError:
            break
        if not block:
            break
        data += block
    process.wait()
    os.close(ours)
    yield data.decode()


if __name__ == "__main__":
    parts: dict[str, Callable[[], None]] = {"window": window, "page": page, "terminal": terminal, "study": study}
    for word in sys.argv[1:] or parts:
        parts[word]() if word in parts else before(Path(word).resolve())
