"""The sounds of whole sessions, compared with measurements: taps, slides and textures are judged by their samples.

Modes are found in the samples alone, by ESPRIT (Roy and Kailath 1989: the frequencies and damping of the exponentials
whose sum is the signal, from the shift invariance of its signal subspace), and compared with what was measured on
materials; every bound names its source.
"""

from __future__ import annotations

import itertools
import math
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from itouch.plugin.discovery import Catalog
from itouch.scene import loads
from itouch.session import build
from itouch_tools.sound import SoundTrack, write_wav
from itouch_tools.sound.modal import RATE

Samples = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Known:
    """What is known about the sound of a material.

    Loss factors eta: ``measured`` on supported samples (qualia.webs.com, table "damping"), and the law a / w + b w of
    Ren, Yeh and Lin 2013 (``a`` [1/s], ``b`` [s]); ``plate`` is the first mode [Hz] of a free square plate, 100 mm
    wide and 10 mm thick: 0.62 h c / L^2, with the speed c of longitudinal waves in the material.
    """

    measured: tuple[float, float]
    law: tuple[float, float] | None
    plate: float

    def loss(self, frequency: float) -> tuple[float, float]:
        """Return the least and the greatest loss factor known at a frequency [Hz]."""
        low, high = self.measured
        if self.law is not None:
            w = 2.0 * math.pi * frequency
            own = self.law[0] / w + self.law[1] * w
            low, high = min(low, own), max(high, own)
        return low, high


#: The four materials, the one that rings longest first.  A mode's loss factor may be off by FACTOR either way, and the
#: frequency of the first mode by this fraction.
MATERIALS = {
    "aluminium": Known((0.004, 0.004), (6.30, 2.12e-8), 3300.0),
    "pyrex": Known((0.033, 0.033), (18.3, 1.43e-7), 3500.0),
    "wood": Known((0.032, 0.10), (2.14, 3.08e-6), 1500.0),
    "polystyrene": Known((0.055, 0.17), None, 350.0),
}
FACTOR, FIRST_MODE = 3.0, 0.2
#: Speeds [m/s] of slides, and bounds of the exponents by which level and pitch grow with speed.  For the level of dry
#: rough surfaces, about 3/4 was measured ("Influence of sliding speed on roughness noise", 2019); the pitch is
#: proportional to the speed.
SPEEDS = (0.05, 0.1, 0.2)
LEVEL, PITCH = (0.6, 0.9), (0.85, 1.15)
#: Distance [m] of the ridges in the scene of slides.
RIDGES = 2e-3

_STROKES = """<itouch version="1.0">
  <include file="itouch:materials.xml"/>
  <defaults><box size="40 40 20 mm"/></defaults>
  <world>{boxes}</world>
  <devices><device name="arm" plugin="usb-arm"/></devices>
  <interaction><probe name="finger" radius="5 mm" pose-from="arm" force-to="arm"/>
    <operator probe="finger"><motion>{motion}</motion></operator></interaction>
</itouch>"""
_SLIDE = """<itouch version="1.0">
  <materials><material name="ridged">
    <contact stiffness="1 N/mm" static-friction="0.1" dynamic-friction="0.1"/>
    <texture file="ridges.npy" depth="50 um" width="{width:g} mm" projection="z"/>
    <sound friction="0.8" grain="{grain:g} mm"/></material></materials>
  <world><box name="plate" size="240 40 20 mm" pos="0 0 -10 mm" material="ridged"/></world>
  <devices><device name="arm" plugin="usb-arm"/></devices>
  <interaction><probe name="finger" radius="5 mm" pose-from="arm" force-to="arm"/>
    <operator probe="finger"><motion>{motion}</motion></operator></interaction>
</itouch>"""
#: Duration of a slide [s], the fraction of it on either side of its middle that is analysed, and how many samples after
#: a tap are searched for modes.
_SLIDING, _MIDDLE, _PIECE = 1.6, 0.11, 900


@dataclass(frozen=True, slots=True)
class Row:
    """One figure with its bounds."""

    what: str
    value: float
    low: float
    high: float
    unit: str = ""

    @property
    def good(self) -> bool:
        """Whether the value is within its bounds."""
        return self.low <= self.value <= self.high


def modes(samples: Samples, count: int) -> list[tuple[float, float, float]]:
    """Return frequency [Hz], loss factor and amplitude of the damped modes of a sound, lowest first.

    ``samples`` (n,), of full scale 1, begin at the tap or later; ``count`` is how many modes there are.
    """
    rows = len(samples) // 2
    hankel = np.lib.stride_tricks.sliding_window_view(samples, len(samples) - rows)
    left, _, _ = np.linalg.svd(hankel, full_matrices=False)
    space = left[:, : 2 * count + 4]  # room for what is not a mode: friction, rounding
    turns = np.linalg.eigvals(np.linalg.lstsq(space[:-1], space[1:], rcond=None)[0])
    turns = turns[np.imag(turns) > 0.0]
    ladder = np.exp(np.outer(np.arange(len(samples)), np.log(turns)))
    amplitudes = np.abs(np.linalg.lstsq(np.hstack([ladder.real, ladder.imag]), samples, rcond=None)[0])
    sizes = np.hypot(*amplitudes.reshape(2, -1))
    found = []
    for turn, size in zip(turns, sizes, strict=True):
        w, damping = abs(math.atan2(turn.imag, turn.real)), -math.log(abs(turn))
        if damping > 0.0:
            found.append((w * RATE / (2.0 * math.pi), 2.0 * damping / w, float(size)))
    energy = sorted(found, key=lambda mode: mode[2] ** 2 / (mode[0] * mode[1]))
    return sorted(energy[-count:])


def strokes() -> Iterator[tuple[str, Samples, int]]:
    """Strike each of the four materials in one session; yield its name, 0.5 s of sound, and its number of modes."""
    names = list(MATERIALS)
    boxes, motion = [], []
    for index, name in enumerate(names):
        x = 50 * index - 75
        boxes.append(f'<box name="{name}" pos="{x} 0 -10 mm" material="{name}"/>')
        motion += [f'<to pos="{x} 0 20 mm" in="0.3 s"/>', f'<to pos="{x} 0 3 mm" in="0.1 s"/>',
                   f'<to pos="{x} 0 20 mm" in="0.12 s" hold="0.7 s"/>']  # fmt: skip
    session, heard, _ = _played(_STROKES.format(boxes="".join(boxes), motion="".join(motion)))
    for contact in session.report()["contacts"]:
        begin = round(contact["begin_s"] * RATE) + RATE // 1000
        sound = next(m.sound for m in session.model.scene.materials if m.name == contact["material"])
        yield contact["material"], heard[begin : begin + RATE // 2], len(sound.modes)


def slides(grain: float = 5e-4) -> Iterator[tuple[float, Samples]]:
    """Slide over a ridged plate at each of the speeds; yield the mean speed [m/s] and the samples of the middle."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "slide.xml"
        np.save(Path(folder) / "ridges.npy", np.tile(0.5 + 0.5 * np.sin(np.pi * (np.arange(80) + 0.5) / 10), (8, 1)))
        for speed in SPEEDS:
            end = -90.0 + 1e3 * speed * _SLIDING / 1.875  # a minimum-jerk motion is fastest in its middle
            motion = f'<to pos="-90 0 3 mm" in="0.3 s"/><to pos="{end:g} 0 3 mm" in="{_SLIDING:g} s"/>'
            path.write_text(_SLIDE.format(width=4e3 * RIDGES, grain=1e3 * grain, motion=motion), encoding="utf-8")
            _, heard, speeds = _played(path)
            first, last = (0.3 + (0.5 + side * _MIDDLE) * _SLIDING for side in (-1.0, 1.0))
            per_tick = len(speeds) * RATE / len(heard)
            middle = speeds[round(first * per_tick) : round(last * per_tick)]
            yield float(np.mean(middle)), heard[round(first * RATE) : round(last * RATE)]


def _played(scene: str | Path) -> tuple[Any, Samples, list[float]]:
    """Run a scene; return its session, the samples of its sound, and the finger's speed [m/s] in each tick."""
    session = build(scene) if isinstance(scene, Path) else build(loads(scene.encode(), Catalog()))
    track, speeds = SoundTrack(session.model, session.state), []
    session.taps.append(track.tap)
    session.taps.append(lambda _: speeds.append(float(np.linalg.norm(session.state["finger.velocity"]))))
    session.run()
    return session, track.samples, speeds


def judged(keep: Path | None = None) -> list[Row]:
    """Return every figure with its bounds; ``keep`` is a folder to which the sounds are written as files."""
    rows: list[Row] = []
    losses, loudest = {}, 0.0
    for name, heard, count in strokes():
        _keep(keep, f"stroke-{name}", heard)
        loudest = max(loudest, float(np.abs(heard).max()))
        found, known = modes(heard[:_PIECE], count), MATERIALS[name]
        losses[name] = found
        near = (known.plate * (1.0 - FIRST_MODE), known.plate * (1.0 + FIRST_MODE))
        rows.append(Row(f"{name}: first mode", found[0][0], *near, "Hz"))
        for frequency, loss, _ in found:
            low, high = known.loss(frequency)
            rows.append(Row(f"{name}: loss factor at {frequency:.0f} Hz", loss, low / FACTOR, FACTOR * high))
    rows += _order(losses)
    speeds, levels, pitches = [], [], []
    for speed, heard in slides():
        _keep(keep, f"slide-{1e3 * speed:.0f}-mm-s", heard)
        loudest = max(loudest, float(np.abs(heard).max()))
        speeds.append(speed)
        levels.append(float(np.sqrt(np.mean(heard**2))))
        pitches.append(centroid(heard))
        beat = ridges(heard, speed / RIDGES)
        rows.append(Row(f"ridges at {speed:.2f} m/s", beat, 0.9 * speed / RIDGES, 1.1 * speed / RIDGES, "Hz"))
    rows.append(Row("slides: level ~ speed ^", slope(speeds, levels), *LEVEL))
    rows.append(Row("slides: pitch ~ speed ^", slope(speeds, pitches), *PITCH))
    rows.append(Row("greatest sample of all", loudest, 0.05, 0.99))
    return rows


def _order(losses: dict[str, list[tuple[float, float, float]]]) -> Iterator[Row]:
    """Yield how many times longer each material rings than the next one, and how wood's loss grows with frequency."""
    at = np.geomspace(500.0, 4000.0, 7)
    laws = {name: np.interp(np.log(at), np.log([f for f, _, _ in found]), [loss for _, loss, _ in found])
            for name, found in losses.items()}  # fmt: skip
    for longer, shorter in itertools.pairwise(MATERIALS):
        ratio = float((laws[shorter] / laws[longer]).min())
        rows = f"{longer} rings longer than {shorter}, at equal frequency"
        yield Row(rows, ratio, 1.0, math.inf, "times")
    wood = losses["wood"]
    yield Row(
        "wood: loss factor ~ frequency ^", slope([f for f, _, _ in wood], [loss for _, loss, _ in wood]), 0.0, 2.0
    )


def slope(x: list[float], y: list[float]) -> float:
    """Return the exponent of the power law fitted to points."""
    return float(np.polyfit(np.log(x), np.log(y), 1)[0])


def centroid(samples: Samples) -> float:
    """Return the centroid [Hz] of the power spectrum of samples (n,)."""
    power = np.abs(np.fft.rfft(samples * np.hanning(len(samples)))) ** 2
    return float((power * np.fft.rfftfreq(len(samples), 1.0 / RATE)).sum() / power.sum())


def ridges(samples: Samples, about: float) -> float:
    """Return the highest peak [Hz] in the spectrum of samples (n,), within a factor of two of ``about``."""
    size = np.abs(np.fft.rfft(samples * np.hanning(len(samples)), 1 << 18))
    frequency = np.fft.rfftfreq(1 << 18, 1.0 / RATE)
    size[(frequency < about / 2) | (frequency > about * 2)] = 0.0
    return float(frequency[int(size.argmax())])


def _keep(folder: Path | None, name: str, samples: Samples) -> None:
    if folder is not None:
        folder.mkdir(parents=True, exist_ok=True)
        write_wav(folder / f"{name}.wav", samples)
