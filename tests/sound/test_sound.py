"""Strokes, sliding and the warning tone, heard through their spectra."""

from __future__ import annotations

import wave

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import itouch
from itouch.schema import ItouchError
from itouch_evidence.bench_sound import peaks
from itouch_tools.sound import ModeBank, SoundTrack, Synth, write_wav
from itouch_tools.sound.modal import RATE
from itouch_tools.sound.sliding import Sliding
from itouch_tools.sound.synth import limited

SCENE = """<itouch version="1.0">
  <materials><material name="bell"><contact stiffness="1 N/mm" static-friction="0.3" dynamic-friction="0.2"/>
    <sound friction="0.5" grain="0.5 mm"><mode frequency="1234 Hz" decay="0.4 s"/>
      <mode frequency="3.3 kHz" decay="0.15 s" gain="0.5"/></sound></material></materials>
  <world><box name="block" size="100 100 20 mm" material="bell"/></world>
  <devices><device name="arm" plugin="usb-arm"/></devices>
  <interaction><probe name="finger" radius="8 mm" pose-from="arm" force-to="arm"/>
    <operator probe="finger"><motion><to pos="-20 0 30 mm" in="0.1 s"/><to pos="-20 0 16 mm" in="0.2 s" hold="0.6 s"/>
      <to pos="30 0 16 mm" in="0.3 s" hold="0.3 s"/></motion></operator></interaction>
</itouch>"""


frequencies = st.lists(st.floats(100, 12000), min_size=1, max_size=5).filter(
    lambda f: np.diff(sorted(f)).min(initial=1e9) > 300
)


@settings(max_examples=40, deadline=None)
@given(frequencies, st.floats(0.01, 5.0))
def test_a_stroke_has_the_modes_that_were_asked_for(asked, speed):
    bank = ModeBank(asked, [0.3] * len(asked), [1.0] * len(asked))
    bank.strike(speed)
    heard = sorted(peaks(bank.render(RATE // 2), len(asked)))
    np.testing.assert_allclose(heard, sorted(asked), atol=8.0)


@pytest.mark.parametrize("decay", [0.05, 0.3, 1.5])
def test_a_mode_dies_away_by_sixty_decibels_in_its_time(decay):
    bank = ModeBank([997.0], [decay], [1.0])
    bank.strike(1.0)
    samples = bank.render(round(1.2 * decay * RATE))
    window = RATE // 100
    begin = np.abs(samples[:window]).max()
    at = round(decay * RATE)
    end = np.abs(samples[at : at + window]).max()
    assert 20 * np.log10(end / begin) == pytest.approx(-60, abs=3)


@settings(max_examples=60, deadline=None)
@given(st.lists(st.floats(allow_nan=True, allow_infinity=True), max_size=20), st.integers(1, 700))
def test_any_strokes_in_any_blocks_are_finite_and_bounded(speeds, block):
    bank = ModeBank([300.0, 5000.0], [0.5, 0.1], [1.0, 0.3])
    for speed in speeds:
        bank.strike(speed)
        samples = limited(bank.render(block))
        assert np.isfinite(samples).all() and np.abs(samples).max(initial=0) < 1.0


def test_blocks_of_any_size_give_the_same_sound():
    whole, parts = (ModeBank([440.0, 2000.0], [0.3, 0.2], [1.0, 0.4]) for _ in range(2))
    whole.strike(0.5)
    parts.strike(0.5)
    pieces = [parts.render(size) for size in (1, 47, 48, 480, 1000, 424)]
    np.testing.assert_allclose(np.concatenate(pieces), whole.render(2000), atol=1e-12)


def test_a_stroke_never_jumps():
    bank = ModeBank([6000.0, 900.0], [0.3, 0.5], [1.0, 1.0])
    made = []
    for speed in (0.0, 3.0, 0.2, 10.0):
        bank.strike(speed)
        made.append(bank.render(333))
    samples = np.concatenate(made)
    steepest = 2 * np.pi * 6000.0 / RATE  # of a sine of the highest mode, full scale
    assert np.abs(np.diff(samples)).max() < steepest


def test_faster_strokes_are_louder_and_brighter():
    def heard(speed: float) -> tuple[float, float]:
        bank = ModeBank([500.0, 8000.0], [0.3, 0.3], [1.0, 1.0])
        bank.strike(speed)
        size = np.abs(np.fft.rfft(bank.render(RATE // 4)))
        low, high = size[:500].max(), size[1500:].max()
        return low, high / low

    (soft, dull), (loud, bright) = heard(0.02), heard(1.0)
    assert loud > 3 * soft and bright > 1.2 * dull


def test_sliding_is_pitched_by_speed_over_grain_and_silent_at_rest():
    def centre(speed: float) -> float:
        sliding = Sliding()
        sliding.render(480, speed, 1.0, grain=5e-4, level=0.2)
        samples = sliding.render(RATE, speed, 1.0, grain=5e-4, level=0.2)
        size = np.abs(np.fft.rfft(samples)) ** 2
        return float((np.fft.rfftfreq(len(samples), 1 / RATE) * size).sum() / size.sum())

    assert centre(0.2) / centre(0.1) == pytest.approx(2.0, rel=0.1)
    still = Sliding()
    assert not still.render(480, 0.0, 1.0, grain=5e-4, level=0.2).any()
    assert not still.render(480, float("nan"), float("nan"), grain=5e-4, level=0.2).any()
    for force in (0.0, -1.0, float("nan")):  # nothing presses
        assert not still.render(480, 0.1, force, grain=5e-4, level=0.2).any()


@settings(max_examples=40, deadline=None)
@given(st.lists(st.tuples(st.floats(0, 1e6), st.floats(-1, 1e6)), min_size=1, max_size=20))
def test_sliding_never_jumps_and_never_leaves_its_level(states):
    sliding = Sliding()
    samples = np.concatenate([sliding.render(48, v, f, grain=3e-4, level=0.12) for v, f in states])
    assert np.isfinite(samples).all() and np.abs(samples).max() < 0.12 * 6


def test_loud_sums_are_bent_not_clipped():
    x = np.linspace(-20, 20, 4001)
    y = limited(x)
    assert np.abs(y).max() < 1.0 and (np.diff(y) >= 0).all()
    quiet = np.abs(x) < 0.7
    np.testing.assert_array_equal(y[quiet], x[quiet])


@pytest.fixture(scope="module")
def track(tmp_path_factory):
    scene = tmp_path_factory.mktemp("scene") / "bell.xml"
    scene.write_text(SCENE)
    session = itouch.build(scene)
    sound = SoundTrack(session.model, session.state)
    session.taps.append(sound.tap)
    session.run()
    return session, sound


def test_a_session_sounds_from_its_contact_on(track):
    session, sound = track
    samples = sound.samples
    assert len(samples) == round(session.seconds * RATE)
    begin = next(e for e in session.state["events.table"] if e["kind"] == 1)["tick"] * session.model.period
    at = round(begin * RATE)
    assert not samples[:at].any()
    heard = samples[at : at + RATE // 4]
    assert sorted(peaks(heard, 2)) == pytest.approx([1234, 3300], abs=8)
    assert np.abs(samples).max() < 1.0


def test_sliding_is_heard_after_the_stroke_has_died_away(track):
    session, sound = track
    quiet, slide = (sound.samples[round(a * RATE) : round(b * RATE)] for a, b in ((0.85, 0.9), (0.95, 1.15)))
    assert slide.std() > 10 * quiet.std() and slide.std() > 1e-3


def test_a_device_in_fault_gives_the_warning_tone(track):
    session, _ = track
    synth, state = Synth(session.model), session.state
    synth.hear(state)
    synth.render(RATE)
    assert np.abs(synth.render(480)).max() < 1e-3
    before = int(state["arm.status"])
    state["arm.status"] = 3
    try:
        synth.hear(state)
        samples = synth.render(RATE)
        assert sorted(peaks(samples, 2)) == pytest.approx([660, 880], abs=5)
        assert np.abs(np.diff(samples)).max() < 0.2 * 2 * np.pi * 880 / RATE * 1.5
    finally:
        state["arm.status"] = before
    synth.hear(state)
    synth.render(RATE // 10)
    assert np.abs(synth.render(480)).max() < 1e-3
    state["arm.status"] = 3
    try:
        synth.hear(state)
        np.testing.assert_allclose(synth.render(RATE), samples, atol=1e-3)  # from its beginning
    finally:
        state["arm.status"] = before


def test_the_file_holds_the_samples(tmp_path):
    samples = 0.5 * np.sin(2 * np.pi * 440 * np.arange(RATE) / RATE)
    write_wav(tmp_path / "a.wav", samples)
    with wave.open(str(tmp_path / "a.wav")) as stream:
        assert (stream.getnchannels(), stream.getsampwidth(), stream.getframerate()) == (1, 2, RATE)
        back = np.frombuffer(stream.readframes(RATE), "<i2") / 32767
    np.testing.assert_allclose(back, samples, atol=1 / 32767)
    with pytest.raises(ItouchError, match="cannot write"):
        write_wav(tmp_path / "none" / "a.wav", samples)


def test_what_is_too_loud_is_bent_without_a_corner_and_stays_below_full_scale() -> None:
    x = np.linspace(0.0, 3.0, 3001)
    slope = np.diff(limited(x)) / 1e-3
    assert slope[:690] == pytest.approx(1.0) and np.abs(np.diff(slope)).max() < 0.01
    assert limited(x)[950:1050].mean() == pytest.approx(0.7 + 0.3 * np.tanh(1.0), abs=2e-3)
