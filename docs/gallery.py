"""Makes the gallery's films: ``python docs/gallery.py [--check] [SCENE ...]``, each shipped scene as a moving picture.

A film has some twenty pictures of the part of a run that shows what the scene is for.  They are kept in the repository
(``docs/pictures/gallery``), so that the page can be read there; a test keeps them whole and small.  ``--check`` makes
them elsewhere and compares: CI does so for one, and tells when the kept ones show what the window no longer draws.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image

import itouch
from itouch_tools.viewer.offscreen import Offscreen
from itouch_tools.viewer.overlay import SessionStatus

HERE = Path(__file__).parent
SCENES, FILMS = HERE.parent / "scenes", HERE / "pictures" / "gallery"
#: Pictures of a film, what it is drawn and kept at [pixels], how long one stands [ms], how good it is (0 to 100).
PICTURES, DRAWN, KEPT, EACH, QUALITY = 20, (1280, 720), (720, 405), 250, 55
#: Two films are compared at this size [pixels], where a spot may differ by so much of 255.
COARSE, ALIKE = (48, 27), 96.0
#: Scene -> from when to when it is shown [s of the session].
PARTS = {
    "first_touch": (0.1, 2.0), "four_materials": (6.0, 13.5), "four_materials_diy": (6.0, 20.0),
    "four_materials_hurried": (6.0, 30.0), "four_materials_wire": (6.0, 13.5), "metamer": (6.0, 27.0),
    "mesh": (0.2, 4.0), "moving": (0.2, 6.0), "two_fingers": (0.2, 5.0), "texture": (0.2, 8.0),
    "texture_and_sound": (0.2, 8.0), "faults": (5.5, 9.0), "thermal_display": (1.0, 16.0),
    "handbook_touch": (0.1, 4.0), "study_sample": (0.2, 8.0),
}  # fmt: skip


def film(name: str, folder: Path = FILMS) -> Path:
    """Make the film of a scene in a folder; return its file."""
    begin, end = PARTS[name]
    engine = itouch.build(SCENES / f"{name}.xml", twin="all")
    period, due = engine.model.period, [begin + (end - begin) * k / (PICTURES - 1) for k in range(PICTURES)]
    offscreen = Offscreen(engine.model, width=DRAWN[0], height=DRAWN[1])
    pictures: list[Image.Image] = []

    def tap(tick: int) -> None:
        offscreen.picture.ring.add(engine.state)
        if len(pictures) < PICTURES and (tick + 1) * period >= due[len(pictures)]:
            now = SessionStatus(faults=list(engine.statistics.faults))
            pictures.append(Image.fromarray(offscreen.shoot(engine.state, now)).resize(KEPT, Image.Resampling.LANCZOS))

    engine.taps.append(tap)
    try:
        engine.enable()
        engine.run(end + 2 * period)
    except itouch.DeviceFaultError:  # a scene that shows one: the picture of it is the last
        now = SessionStatus(faults=list(engine.statistics.faults))
        pictures.append(Image.fromarray(offscreen.shoot(engine.state, now)).resize(KEPT, Image.Resampling.LANCZOS))
    finally:
        engine.taps.remove(tap)
        engine.close()
        offscreen.close()
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{name}.webp"
    first, *rest = pictures
    lasts = [EACH] * len(rest) + [4 * EACH]
    first.save(path, save_all=True, append_images=rest, duration=lasts, loop=0, quality=QUALITY, method=4)
    return path


def differs(one: Path, other: Path) -> str:
    """Say how two films differ more than another program for graphics makes them; empty: they do not."""
    with Image.open(one) as first, Image.open(other) as second:
        counts = [getattr(each, "n_frames", 1) for each in (first, second)]
        if counts[0] != counts[1]:
            return f"{counts[0]} pictures, {counts[1]} are kept"
        worst = 0.0
        for index in range(counts[0]):
            first.seek(index), second.seek(index)
            small = [np.asarray(each.convert("RGB").resize(COARSE), float) for each in (first, second)]
            worst = max(worst, float(np.abs(small[0] - small[1]).max()))
    return f"a spot differs by {worst:.0f} of 255" if worst > ALIKE else ""


def main(names: Sequence[str]) -> int:
    """Make the films of scenes, or of all; with ``--check`` compare them with those that are kept."""
    check = "--check" in names
    found = 0
    with tempfile.TemporaryDirectory() as spare:
        for name in [each for each in names if each != "--check"] or PARTS:
            path = film(name, Path(spare) if check else FILMS)
            wrong = differs(path, FILMS / path.name) if check else ""
            found += bool(wrong)
            told = f": {wrong}; python docs/gallery.py {name}" if wrong else ""
            print(f"{path.name}  {path.stat().st_size / 1000:.0f} kB{told}", flush=True)
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
