"""From States to samples: taps at every BEGIN, noise while a probe slides, a tone while a device is in fault."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from itouch.loop import Status
from itouch.plugin import Contact, Record
from itouch.scene.elements.sound import Sound
from itouch.world import Model
from itouch_tools.sound.modal import RATE, ModeBank
from itouch_tools.sound.sliding import Sliding
from itouch_tools.sound.texture_profile import Relief, Way, reliefs, turned

#: The warning tone: two pitches [Hz], how long [s] each lasts, its level, and the time [s] of its rise and fall.
TONES, TONE_TIME, TONE_LEVEL, TONE_RISE = (880.0, 660.0), 0.25, 0.2, 0.01
#: The tone is on for this long [s], then for ``TONE_AGAIN`` once in ``TONE_EVERY``, as long as the fault lasts.
TONE_FIRST, TONE_AGAIN, TONE_EVERY = 2.0, 0.5, 5.0
#: If a State stays the same for longer [s], the session is paused: nothing slides in it.
STANDS = 0.1
#: Above this level the sound is limited smoothly, so that it never reaches 1.
_KNEE = 0.7
#: Rms of sliding noise at full loudness.
_FRICTION = 0.12


@dataclass(frozen=True, slots=True)
class _Voice:
    """What one object sounds like."""

    sound: Sound
    bank: ModeBank
    relief: Relief | None


@dataclass(frozen=True, slots=True)
class _Slide:
    """How a probe slides: speed [m/s], force [N], on what."""

    speed: float
    force: float
    sound: Sound
    way: Way | None


class Synth:
    """Makes the sound of a model's States; tell it each State with ``hear``, then take samples with ``render``."""

    def __init__(self, model: Model) -> None:
        self._model = model
        found = reliefs(model)
        self._voices = [_voice(model, element.material, found) for element in model.scene.objects]
        self._sliding = {probe.name: Sliding() for probe in model.probes}
        self._slides: dict[str, _Slide | None] = {}
        self._count = -1
        self._fault = False
        self._tone_time, self._tone_level = 0.0, 0.0
        self._last, self._stood = -1, 0
        self._stands = round(max(STANDS, 4.0 * model.period) * RATE)

    @property
    def has_sounds(self) -> bool:
        """Whether any object of the scene has a material with a sound."""
        return any(voice is not None for voice in self._voices)

    def hear(self, state: Record) -> None:
        """Receive a State, with its new contacts, sliding and faults; states may be left out."""
        count, table, tick = int(state["events.count"]), state["events.table"], int(state["tick"])
        if tick != self._last:
            self._last, self._stood = tick, 0
        first = count if self._count < 0 or count < self._count else max(self._count, count - len(table))
        for number in range(first, count):
            event = table[number % len(table)]
            voice = self._voices[int(event["object"])] if int(event["kind"]) == Contact.BEGIN else None
            if voice is not None:
                voice.bank.strike(float(event["speed"]))
        self._count = count
        for probe in self._model.probes:
            self._slides[probe.name] = self._slide(state, probe.name)
        self._fault = any(int(state[f"{name}.status"]) == Status.FAULT for name in self._model.devices)

    def _slide(self, state: Record, probe: str) -> _Slide | None:
        index = int(state[f"{probe}.object"])
        voice = self._voices[index] if index >= 0 else None
        if voice is None:
            return None
        velocity = state[f"{probe}.velocity"] - state["objects.twist"][index][:3]
        normal = state[f"{probe}.normal"]
        across = velocity - normal * float(velocity @ normal)
        way = None
        if voice.relief is not None:
            pose = state["objects.pose"][index]
            way = Way(voice.relief, *voice.relief.rates(turned(pose, across), turned(pose, normal)))
        return _Slide(math.sqrt(float(across @ across)), float(state[f"{probe}.normal_force"]), voice.sound, way)

    def render(self, count: int) -> NDArray[np.float64]:
        """Return the next samples at 48 kHz, shape (count,), between -1 and 1."""
        made = np.zeros(count)
        if count == 0:
            return made
        for voice in self._voices:
            if voice is not None and not voice.bank.silent:
                made += voice.bank.render(count)
        for name, sliding in self._sliding.items():
            slide = self._slides.get(name)
            if slide is not None and self._stood < self._stands:
                sound, way = slide.sound, slide.way
                level = _FRICTION * sound.friction * sound.loudness
                made += sliding.render(count, slide.speed, slide.force, grain=sound.grain, level=level, way=way)
            elif not sliding.silent:
                made += sliding.render(count, 0.0, 0.0, grain=1e-3, level=0.0)
        if self._fault or self._tone_level > 0.0:
            made += self._tone(count)
        self._stood += count
        return limited(made)

    def _tone(self, count: int) -> NDArray[np.float64]:
        times = self._tone_time + np.arange(1, count + 1) / RATE
        on = self._fault and (self._tone_time < TONE_FIRST or self._tone_time % TONE_EVERY < TONE_AGAIN)
        step = (1.0 if on else -1.0) * TONE_LEVEL / (TONE_RISE * RATE)
        level = np.clip(self._tone_level + step * np.arange(1, count + 1), 0.0, TONE_LEVEL)
        self._tone_level, self._tone_time = float(level[-1]), float(times[-1]) if self._fault or level[-1] > 0 else 0.0
        # the pitches take turns, and one fades into the other where they change
        turn = 0.5 + 0.5 * np.clip(np.sin(math.pi * times / TONE_TIME) * 12.0, -1.0, 1.0)
        first, second = (np.sin(2 * math.pi * pitch * times) for pitch in TONES)
        made: NDArray[np.float64] = level * (turn * first + (1.0 - turn) * second)
        return made


def limited(samples: NDArray[np.float64]) -> NDArray[np.float64]:
    """Compress what is above the knee smoothly to below 1; leave the rest as it is.

    ``samples`` may have any shape (n, ...), which is also that of the result; 1 is full scale, without a unit.
    """
    size = np.abs(samples)
    over = size > _KNEE
    if over.any():
        bent = _KNEE + (1.0 - _KNEE) * np.tanh((size[over] - _KNEE) / (1.0 - _KNEE))
        samples = samples.copy()
        samples[over] = np.sign(samples[over]) * np.minimum(bent, 0.999)
    return samples


def _voice(model: Model, material: str, found_reliefs: Mapping[str, Relief]) -> _Voice | None:
    found = next((m for m in model.scene.materials if m.name == material), None)
    if found is None or found.sound is None or found.sound.loudness == 0.0:
        return None
    sound, modes = found.sound, found.sound.modes
    bank = ModeBank([m.frequency for m in modes], [m.decay for m in modes], [m.gain for m in modes],
                level=0.5 * sound.loudness)  # fmt: skip
    return _Voice(sound, bank, found_reliefs.get(material))
