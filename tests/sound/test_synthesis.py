"""What a synth makes of States: textures, two fingers, sessions that stand, the warning tone, extreme parameters."""

from __future__ import annotations

import wave
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shipped import SCENES

import itouch
from itouch_evidence.bench_sound import peaks
from itouch_tools.cli import main
from itouch_tools.sound import ModeBank, SoundTrack, Synth
from itouch_tools.sound.modal import RATE
from itouch_tools.sound.sliding import FULL_FORCE, FULL_SPEED, Sliding
from itouch_tools.sound.synth import (
    STANDS,
    TONE_AGAIN,
    TONE_EVERY,
    TONE_FIRST,
    TONE_LEVEL,
    TONE_TIME,
    TONES,
    limited,
)
from itouch_tools.sound.texture_profile import Relief, Way, _sampled, reliefs

SCENE = """<itouch version="1.0">
  <materials>{materials}</materials>
  <world><box name="a" size="60 60 20 mm" pos="-40 0 10 mm" material="a"/>
    <box name="b" size="60 60 20 mm" pos="40 0 10 mm" material="b"/></world>
  <devices><device name="left" plugin="usb-arm"/><device name="right" plugin="usb-arm"/></devices>
  <interaction>
    <probe name="one" radius="8 mm" pose-from="left" force-to="left"/>
    <probe name="two" radius="8 mm" pose-from="right" force-to="right"/>
    <operator probe="one"><motion><to pos="-40 0 40 mm" in="0.3 s"/><to pos="-40 0 22 mm" in="0.1 s" hold="0.6 s"/>
      </motion></operator>
    <operator probe="two"><motion><to pos="40 0 40 mm" in="0.3 s"/><to pos="40 0 22 mm" in="0.1 s" hold="0.6 s"/>
      </motion></operator>
  </interaction>
</itouch>"""
ONE = '<material name="{0}"><contact stiffness="1 N/mm"/><sound friction="{2}">{1}</sound></material>'


def material(name: str, modes: list[float], *, decay: float = 0.4, friction: float = 0.0) -> str:
    rows = "".join(f'<mode frequency="{f!r} Hz" decay="{decay} s"/>' for f in modes)
    return ONE.format(name, rows, friction)


def test_columns_of_a_map_run_with_the_first_axis_and_rows_against_the_second():
    """A picture's rows run down."""
    relief = Relief(np.zeros((4, 4)), 1e-4, 2)
    up = np.array([0.0, 0.0, 1.0])
    assert relief.rates(np.array([1e-3, 2e-3, 5e-3]), up) == pytest.approx((10.0, -20.0))
    nearest = Relief(np.zeros((4, 4)), 1e-4, -1)
    assert nearest.rates(np.array([5e-3, 1e-3, 2e-3]), -up[[2, 0, 1]]) == pytest.approx((10.0, -20.0))
    assert relief.rates(np.array([np.inf, 0.0, 0.0]), up) == (0.0, 0.0)


@pytest.mark.parametrize("seed", range(5))
def test_two_fingers_strike_two_materials_at_once_with_modes_at_random(tmp_path, seed):
    rng = np.random.default_rng(seed)
    every = np.sort(rng.choice(np.arange(150, 9000, 150), 6, replace=False) + rng.uniform(-20, 20, 6))
    order = rng.permutation(6)
    a, b = (sorted(every[part].round(1).tolist()) for part in (order[:3], order[3:]))
    (tmp_path / "scene.xml").write_text(SCENE.format(materials=material("a", a) + material("b", b)))
    words = ["run", str(tmp_path / "scene.xml"), "--wav", str(tmp_path / "x.wav"), "--record", str(tmp_path / "x.mcap")]
    assert main(words) == 0
    assert main(["replay", str(tmp_path / "x.mcap"), "--wav", str(tmp_path / "y.wav")]) == 0
    assert (tmp_path / "x.wav").read_bytes() == (tmp_path / "y.wav").read_bytes()
    with wave.open(str(tmp_path / "x.wav")) as stream:
        samples = np.frombuffer(stream.readframes(stream.getnframes()), "<i2") / 32767
    first = int(np.flatnonzero(samples)[0])
    assert peaks(samples[first + RATE // 50 : first + RATE // 3], 6) == pytest.approx(every.tolist(), abs=8)
    assert np.abs(samples).max() < 1.0


@pytest.mark.parametrize("sound", ["", "<sound/>"])
def test_a_file_in_which_nothing_can_be_heard_is_told(tmp_path, capsys, sound):
    touched = '<contact stiffness="1 N/mm"/>'
    plain = f'<material name="a">{touched}{sound}</material><material name="b">{touched}</material>'
    (tmp_path / "scene.xml").write_text(SCENE.format(materials=plain))
    assert main(["run", str(tmp_path / "scene.xml"), "--for", "20ms", "--wav", str(tmp_path / "x.wav")]) == 0
    assert ("x.wav is silent unless a fault is told" in capsys.readouterr().err) == (not sound)
    assert (tmp_path / "x.wav").is_file()


@pytest.fixture(scope="module")
def plates():
    """The shipped scene, its synth's sound, and the session."""
    session = itouch.build(SCENES / "texture_and_sound.xml")
    track = SoundTrack(session.model, session.state)
    session.taps.append(track.tap)
    states = {}
    session.taps.append(lambda tick: states.update({tick: session.state.copy()}) if tick == 6000 else None)
    session.run()
    return session, track.samples, states[6000]


def test_each_plate_of_the_shipped_scene_sounds_as_it_is_made(plates):
    session, samples, _ = plates
    contacts = session.report()["contacts"]
    assert [c["material"] for c in contacts[:4]] == ["washboard", "slate", "glass", "drum"]
    for contact in contacts[:4]:
        sound = next(m.sound for m in session.model.scene.materials if m.name == contact["material"])
        at = round(contact["begin_s"] * RATE)
        heard = peaks(samples[at : at + RATE // 8], len(sound.modes))
        assert heard == pytest.approx([mode.frequency for mode in sound.modes], rel=0.03, abs=15)
    assert np.abs(samples).max() < 1.0


def test_ridges_are_heard_at_speed_over_their_distance():
    """A height map of bars every 1 mm: heard across them, not along them."""
    bars = np.tile(np.sign(np.sin(2 * np.pi * (np.arange(40) + 0.5) / 10)), (8, 1))
    relief = Relief(bars, 1e-4, 2)
    up = np.array([0.0, 0.0, 1.0])

    def strength(velocity: tuple[float, float]) -> float:
        way = Way(relief, *relief.rates(np.array([*velocity, 0.0]), up))
        sliding = Sliding()
        made = [sliding.render(480, 0.12, 1.0, grain=2e-4, level=0.1, way=way) for _ in range(200)]
        envelope = np.abs(np.concatenate(made)[4800:])
        size = np.abs(np.fft.rfft(envelope - envelope.mean()))
        at = round(120.0 * len(envelope) / RATE)  # 0.12 m/s over 1 mm
        return float(size[at - 2 : at + 3].max() / np.median(size))

    assert strength((0.12, 0.0)) > 10 * strength((0.0, 0.12))


def test_only_materials_with_a_map_that_is_not_flat_have_a_relief(plates):
    session, _, _ = plates
    found = reliefs(session.model)
    assert set(found) == {"washboard", "slate"}
    assert found["washboard"].pitch * found["washboard"].heights.shape[1] == pytest.approx(12e-3)


@settings(max_examples=40, deadline=None)
@given(
    st.lists(st.tuples(st.integers(1, 700), st.sampled_from([0, 1, 2]), st.floats(-1e9, 1e9)), min_size=2, max_size=12)
)
def test_reliefs_that_change_while_sliding_never_jump_or_leave_the_range(pieces):
    rng = np.random.default_rng(1)
    maps = [None, Relief(rng.uniform(-2, 2, (5, 7)), 1e-3, 2), Relief(rng.uniform(-2, 2, (64, 64)), 1e-5, -1)]
    sliding, made = Sliding(), []
    for count, number, speed in pieces:
        relief = maps[number]
        way = Way(relief, speed, -speed) if relief is not None else None
        made.append(sliding.render(count, 0.1, 1.0, grain=1e-2, level=0.1, way=way))
    samples = np.concatenate(made)
    assert np.isfinite(samples).all() and np.abs(samples).max() < 2.5


def test_blocks_of_any_size_slide_alike():
    whole, parts = Sliding(), Sliding()
    pieces = [parts.render(n, 0.1, 1.0, grain=3e-4, level=0.1) for n in (1, 47, 48, 480, 1000, 824)]
    np.testing.assert_allclose(np.concatenate(pieces), whole.render(2400, 0.1, 1.0, grain=3e-4, level=0.1), atol=1e-9)


def test_noise_begins_and_ends_without_a_click():
    """Where it begins and ends, steps are no greater than in its midst."""
    sliding = Sliding()
    made = [sliding.render(480, v, 2.0, grain=1e-3, level=0.2) for v in [0.0] * 2 + [0.2] * 40 + [0.0] * 10]
    samples = np.concatenate(made)
    steps = np.abs(np.diff(samples))
    inner = steps[5000:19000].max()
    assert steps[:2000].max() < inner and steps[20000:].max() < inner
    assert not samples[:960].any() and not samples[-480:].any() and sliding.silent


def test_a_session_that_stands_still_does_not_go_on_sliding(plates):
    session, _, state = plates
    synth = Synth(session.model)
    synth.hear(state)
    moving = synth.render(round(0.5 * STANDS * RATE))
    assert moving.std() > 1e-3
    made = []
    for _ in range(60):  # a paused window shows the same State in every frame
        synth.hear(state)
        made.append(synth.render(RATE // 60))
    samples = np.concatenate(made)
    assert not samples[RATE // 4 :].any()
    assert np.abs(np.diff(samples)).max() < 0.5


def test_the_warning_tone_is_long_at_first_then_now_and_then(plates):
    session, _, state = plates
    synth, state = Synth(session.model), state.copy()
    state["arm.status"] = 3
    synth.hear(state)
    synth.render(RATE)  # what slid is over
    on = []
    for _ in range(1100):
        synth.hear(state)
        on.append(np.abs(synth.render(RATE // 100)).max() > 0.05)
    assert all(on[:95]) and not any(on[120:380])
    assert any(on[round(100 * (TONE_EVERY - 1.0 + TONE_AGAIN / 2)) - 5 :][:10])
    assert 0.0 < TONE_AGAIN < TONE_FIRST < TONE_EVERY


def test_the_warning_tone_has_two_pitches_in_turns() -> None:
    synth: Any = SimpleNamespace(_tone_time=0.0, _tone_level=TONE_LEVEL, _fault=True)
    samples = Synth._tone(synth, round(4 * TONE_TIME * RATE))
    span = round(0.5 * TONE_TIME * RATE)
    for turn in range(4):
        middle = samples[round((turn + 0.25) * TONE_TIME * RATE) :][:span] * np.hanning(span)
        waves = np.exp(-2j * np.pi * np.outer(TONES, np.arange(span) / RATE))
        one, other = np.abs(waves @ middle)[[turn % 2, 1 - turn % 2]] * 4.0 / span
        assert one == pytest.approx(TONE_LEVEL, rel=0.01)
        assert other < 0.01 * TONE_LEVEL


modes = st.lists(
    st.tuples(st.floats(20, 16000), st.floats(min_value=0, exclude_min=True, max_value=20), st.floats(0, 1)), max_size=6
)


@settings(max_examples=80, deadline=None)
@given(modes, st.lists(st.floats(allow_nan=True), max_size=6), st.integers(1, 999))
def test_whatever_a_scene_may_say_is_finite_and_bounded(asked, speeds, block):
    frequencies, decays, gains = zip(*asked, strict=True) if asked else ((), (), ())
    bank = ModeBank(frequencies, decays, gains)
    for speed in [*speeds, 1.0]:
        bank.strike(speed)
        samples = limited(bank.render(block))
        assert np.isfinite(samples).all() and np.abs(samples).max(initial=0) < 1.0


def test_a_mode_that_dies_at_once_is_a_click_and_no_division_by_zero() -> None:
    bank = ModeBank([440.0, 4000.0], [0.0, 1e-12], [1.0, 1.0])
    bank.strike(1.0)
    samples = bank.render(480)
    assert np.isfinite(samples).all() and np.abs(samples).max() > 0.0
    assert np.abs(samples[48:]).max() < 1e-3 * np.abs(samples).max()


def test_loud_samples_are_bent_without_a_kink_and_keep_their_order() -> None:
    """Below the knee nothing is changed; above it the slope falls from one, and full scale is never reached."""
    loud = np.linspace(0.0, 5.0, 5001)
    bent = limited(loud)
    slopes = np.diff(bent) / np.diff(loud)
    assert (np.diff(slopes) < 1e-9).all() and slopes[0] == pytest.approx(1.0) and (np.abs(np.diff(slopes)) < 0.02).all()
    assert (slopes >= 0.0).all() and bent.max() < 1.0 and bent[-1] > 0.99
    assert limited(-loud) == pytest.approx(-bent)


def test_beyond_its_full_speed_sliding_grows_no_louder_but_for_its_pitch() -> None:
    """Its pitch fades what is beyond hearing; where grains are coarse, nothing is left of the speed but the pitch."""
    levels = []
    for speed in (0.5, 1.01, 2.0, 20.0):
        sliding = Sliding()
        sliding.render(RATE, speed * FULL_SPEED, FULL_FORCE, grain=10.0, level=0.1)
        levels.append(sliding._level)
    assert levels[0] < 0.08 and levels[1:] == pytest.approx([0.1] * 3, rel=1e-3)


def test_sliding_that_dies_away_slows_down(plates) -> None:
    """As a finger that comes to rest does; it whistled if it went on at a speed."""
    synth = Synth(plates[0].model)
    synth.hear(plates[2])
    synth.render(round(0.01 * RATE))
    (sliding,) = synth._sliding.values()
    synth._slides.clear()
    steps = [sliding._step]
    while not sliding.silent:
        synth.render(48)
        steps.append(sliding._step)
    assert len(steps) > 10 and all(later < sooner for sooner, later in zip(steps, steps[1:-1], strict=False))


def test_between_samples_a_map_is_linear_and_it_repeats_both_ways() -> None:
    heights = np.array([[0.0, 1.0, 5.0], [10.0, 20.0, -7.0]])
    places = np.array(
        [(0.0, 0.0), (2.0, 1.0), (0.25, 0.0), (0.0, 0.25), (0.5, 0.5), (2.5, 0.0), (1.0, 1.5), (-1.0, -1.0)]
    )
    expected = [0.0, -7.0, 0.25, 2.5, 7.75, 2.5, 10.5, -7.0]
    assert _sampled(heights, places) == pytest.approx(expected)
