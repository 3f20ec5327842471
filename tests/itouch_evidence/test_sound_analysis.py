"""Sounds against what was measured of such materials: the figures, and that the judge can say no."""

from __future__ import annotations

import json
import wave
from pathlib import Path

import numpy as np
import pytest

from itouch_evidence import bench_sound, sound_analysis
from itouch_tools.sound import ModeBank
from itouch_tools.sound.modal import RATE


@pytest.fixture(scope="module")
def judged(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sounds")
    code = bench_sound.main(["--judge", "--keep", str(folder), "--json", str(folder / "rows.json")])
    return code, json.loads((folder / "rows.json").read_text()), folder


def test_every_figure_is_within_what_was_measured(judged):
    code, rows, _ = judged
    outside = [row for row in rows if not row["low"] <= row["value"] <= row["high"]]
    assert code == 0 and not outside
    said = [row["what"] for row in rows]
    for name in sound_analysis.MATERIALS:
        assert f"{name}: first mode" in said and sum(one.startswith(f"{name}: loss factor") for one in said) >= 2
    assert sum("rings longer" in one for one in said) == 3 and sum("ridges" in one for one in said) == 3


def test_the_sounds_are_kept_as_files_and_nothing_clips(judged):
    files = sorted(Path(judged[2]).glob("*.wav"))
    assert len(files) == len(sound_analysis.MATERIALS) + len(sound_analysis.SPEEDS)
    for file in files:
        with wave.open(str(file)) as stream:
            samples = np.frombuffer(stream.readframes(stream.getnframes()), "<i2")
        assert stream.getframerate() == RATE
        assert 300 < np.abs(samples.astype(int)).max() < 0.99 * 32767, file.name


@pytest.mark.parametrize("seed", range(4))
def test_modes_and_their_damping_are_found_in_samples_alone(seed):
    """Frequencies 250 Hz apart, any loss factors, rounded to 16 bits as in a file."""
    rng = np.random.default_rng(seed)
    count = 1 + seed
    losses = np.exp(rng.uniform(np.log(5e-4), np.log(0.1), count))
    asked = sorted(zip(rng.choice(np.arange(2, 40), count, replace=False).tolist(), losses.tolist(), strict=True))
    frequencies = [250.0 * place for place, _ in asked]
    decays = [2.2 / (loss * frequency) for (_, loss), frequency in zip(asked, frequencies, strict=True)]
    bank = ModeBank(frequencies, decays, [1.0] * len(asked))
    bank.strike(0.3)
    found = sound_analysis.modes(np.round(bank.render(900) * 32767) / 32767, len(asked))
    for (place, loss), (frequency, seen, _) in zip(asked, found, strict=True):
        assert frequency == pytest.approx(250.0 * place, rel=0.02)
        if loss * 250.0 * place * np.pi * 900 / RATE > 0.05:  # else hardly anything of it has died away
            assert seen == pytest.approx(loss, rel=0.15)


def test_a_material_that_rings_too_long_or_too_short_is_told():
    known = sound_analysis.MATERIALS["wood"]
    low, high = known.loss(1000.0)
    assert 0.015 < low < 0.035 and high == pytest.approx(0.10)
    for wrong in (low / 4, high * 4):
        assert not sound_analysis.Row("wood", wrong, low / sound_analysis.FACTOR, high * sound_analysis.FACTOR).good


def test_ridges_and_exponents_are_read_off():
    time = np.arange(RATE // 3) / RATE
    noise = np.random.default_rng(1).normal(size=len(time))
    assert sound_analysis.ridges(np.sin(2 * np.pi * 75.0 * time) + 0.5 * noise, 60.0) == pytest.approx(75.0, rel=0.02)
    assert sound_analysis.slope([0.05, 0.1, 0.2], [3.0 * v**0.75 for v in (0.05, 0.1, 0.2)]) == pytest.approx(0.75)
