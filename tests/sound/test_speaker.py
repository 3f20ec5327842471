"""What is played, through outputs that remember, through ALSA into a file, and through a sound server."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
import time
import types

import numpy as np
import pytest
from requirements import need_program

import itouch
from itouch_tools.sound import output
from itouch_tools.sound.modal import RATE
from itouch_tools.sound.player import BLOCK, Speaker

SCENE = """<itouch version="1.0">
  <materials><material name="bell"><contact stiffness="1 N/mm"/>
    <sound friction="1"><mode frequency="1234 Hz" decay="0.5 s"/></sound></material></materials>
  <world><box name="block" size="100 100 20 mm" material="bell"/></world>
  <devices><device name="arm" plugin="usb-arm"/></devices>
  <interaction><probe name="finger" radius="8 mm" pose-from="arm" force-to="arm"/></interaction>
</itouch>"""


class Tape:
    """An output that keeps what it gets, lets the maker wait for ``turn``, and may break."""

    name = "tape"

    def __init__(self) -> None:
        self.data, self.closed, self.breaks = b"", False, False
        self.turn = threading.Semaphore(0)

    def write(self, samples: bytes) -> None:
        self.turn.acquire()
        if self.breaks:
            raise OSError(32, "gone")
        self.data += samples

    def latency(self) -> float:
        return 0.02

    def close(self) -> None:
        self.closed = True

    def samples(self) -> np.ndarray:
        return np.frombuffer(self.data, "<i2") / 32767


def until(true) -> None:
    """Wait until something is so."""
    for _ in range(60_000):
        if true():
            return
        time.sleep(0.005)
    raise AssertionError("it never came to be so")


@pytest.fixture
def session(tmp_path):
    (tmp_path / "bell.xml").write_text(SCENE)
    return itouch.build(tmp_path / "bell.xml")


def strike(state) -> None:
    row = state["events.table"][int(state["events.count"])]
    row["kind"], row["object"], row["speed"] = 1, 0, 0.5
    state["events.count"] += 1
    state["tick"] += 1


def test_a_stroke_is_in_the_next_block_and_the_end_fades(session):
    tape = Tape()
    speaker = Speaker(session.model, output=lambda: tape)
    speaker.hear(session.state)
    tape.turn.release()
    until(lambda: speaker.blocks == 1)
    assert speaker.driver == "tape" and not speaker.muted and not tape.samples().any()
    strike(session.state)
    speaker.hear(session.state)
    tape.turn.release(3)
    until(lambda: speaker.blocks == 4)
    assert tape.samples()[2 * BLOCK :].any()  # the block that was being made may be the one before
    tape.turn.release(50)
    speaker.close()
    heard = tape.samples()
    assert tape.closed and abs(heard[-1]) < 1e-4 and abs(heard[-BLOCK]) < 0.5
    assert np.abs(np.diff(heard)).max() < 2 * np.pi * 1234 / RATE  # no step anywhere


def test_a_card_that_is_pulled_out_leaves_silence(session):
    tape = Tape()
    speaker = Speaker(session.model, output=lambda: tape)
    tape.breaks = True
    tape.turn.release()
    until(lambda: speaker.driver == "silent")
    assert speaker.muted
    before = speaker.blocks
    until(lambda: speaker.blocks > before + 2)  # it goes on
    speaker.close()


def test_it_is_turned_off_and_on_without_a_click(session):
    tape = Tape()
    speaker = Speaker(session.model, output=lambda: tape)
    speaker.hear(session.state)
    strike(session.state)
    speaker.hear(session.state)
    tape.turn.release(3)
    until(lambda: speaker.blocks == 3)
    assert speaker.turn().startswith("sound off") and speaker.hushed
    tape.turn.release(4)
    until(lambda: speaker.blocks == 7)
    assert speaker.turn() == "sound on"
    tape.turn.release(4)
    until(lambda: speaker.blocks == 11)
    tape.turn.release(50)
    speaker.close()
    heard = tape.samples()
    assert heard[: 2 * BLOCK].any() and not heard[5 * BLOCK : 6 * BLOCK].any() and heard[9 * BLOCK : 10 * BLOCK].any()
    assert np.abs(np.diff(heard)).max() < 2 * np.pi * 1234 / RATE


def test_mute_opens_nothing(session):
    def refuse() -> output.Output:
        raise AssertionError("it was opened")

    speaker = Speaker(session.model, mute=True, output=refuse)
    speaker.hear(session.state)
    speaker.close()
    assert speaker.muted and speaker.driver == "" and speaker.blocks == 0
    assert speaker.turn().startswith("nothing is heard")


def test_an_output_that_takes_everything_does_not_make_the_maker_run_away(session):
    tape = Tape()
    tape.turn.release(10_000)
    begin = time.monotonic()
    speaker = Speaker(session.model, output=lambda: tape)
    time.sleep(0.2)
    speaker.close()
    assert speaker.blocks <= 110 * (time.monotonic() - begin + 0.25)


def test_where_there_is_no_sound_it_is_silent():
    def missing() -> output.Output:
        raise OSError(2, "no such library")

    quiet = output.open_output((missing,))
    assert quiet.name == "silent" and quiet.latency() >= 0.0
    quiet.write(b"\0" * 960)
    quiet.close()


def portaudio_is_there() -> bool:
    try:
        import sounddevice  # noqa: F401
    except (ImportError, OSError):
        return False
    return True


BACKENDS = ["Alsa", pytest.param("PortAudio", marks=pytest.mark.skipif(
    not portaudio_is_there() and not os.environ.get("CI"), reason="no sounddevice, or no libportaudio2"))]  # fmt: skip


@pytest.mark.parametrize("kind", BACKENDS)
def test_a_card_gets_every_sample(tmp_path, kind):
    """ALSA is told of a card that is a file; PortAudio plays through ALSA."""
    (tmp_path / "asound.conf").write_text(
        f'pcm.!default {{ type file file "{tmp_path}/heard.raw" format "raw" slave.pcm "quiet" }}\n'
        "pcm.quiet { type null }\n"
    )
    code = (
        f"import numpy as np; from itouch_tools.sound.output import {kind}, open_output\n"
        f"out = open_output(({kind},)); print(out.name); assert 0.0 <= out.latency() < 0.1\n"
        "for n in range(50): out.write(np.arange(480 * n, 480 * n + 480).astype('<i2').tobytes())\n"
        "out.close()"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True,
        env={**os.environ, "ALSA_CONFIG_PATH": str(tmp_path / "asound.conf")},
    )  # fmt: skip
    assert done.stdout.upper() == f"{kind.upper()}\n" and done.stderr == ""
    heard = np.fromfile(tmp_path / "heard.raw", "<i2")
    np.testing.assert_array_equal(heard[:24000], np.arange(24000))


class GoneError(Exception):
    """As sounddevice's: no OSError."""


class Stream:
    """A stream of sounddevice that remembers how it was asked for, and may go."""

    latency, gone = 0.042, False

    def __init__(self, **wanted: object) -> None:
        self.wanted, self.said, self.data = wanted, [], b""

    def start(self) -> None:
        self.said.append("start")

    def write(self, samples: bytes) -> bool:
        if self.gone:
            raise GoneError("unplugged")
        self.data += samples
        return True  # it came too late; it is played all the same

    def stop(self) -> None:
        if self.gone:
            raise GoneError("unplugged")
        self.said.append("stop")

    def close(self) -> None:
        self.said.append("close")


@pytest.fixture
def made(monkeypatch):
    """A stand-in for sounddevice; the streams that were made."""
    streams: list[Stream] = []

    def stream(**wanted: object) -> Stream:
        streams.append(Stream(**wanted))
        return streams[-1]

    module = types.SimpleNamespace(PortAudioError=GoneError, RawOutputStream=stream)
    monkeypatch.setitem(sys.modules, "sounddevice", module)
    return streams


def test_portaudio_is_asked_for_a_short_buffer_where_the_others_are_not_there(made, monkeypatch):
    monkeypatch.setattr(output.ctypes, "CDLL", lambda name: (_ for _ in ()).throw(OSError(2, name)))
    out = output.open_output()
    assert out.name == "PortAudio" and out.latency() == 0.042
    out.write(b"\1\0" * 480)
    out.close()
    (stream,) = made
    assert stream.wanted == {"samplerate": RATE, "channels": 1, "dtype": "int16", "latency": output.BUFFER}
    assert stream.data == b"\1\0" * 480 and stream.said == ["start", "stop", "close"]


def test_portaudio_that_goes_away_leaves_silence(made, session):
    speaker = Speaker(session.model, output=output.PortAudio)
    until(lambda: speaker.blocks > 2)
    assert speaker.driver == "PortAudio"
    made[0].gone = True
    until(lambda: speaker.muted)
    assert speaker.driver == "silent"
    speaker.close()


@pytest.mark.parametrize("error", [GoneError("Error querying device -1"), ValueError("No output device")])
def test_portaudio_without_an_output_is_silent(made, monkeypatch, error):
    def refuse(**_: object) -> Stream:
        raise error

    monkeypatch.setattr(sys.modules["sounddevice"], "RawOutputStream", refuse)
    assert output.open_output((output.PortAudio,)).name == "silent"
    with pytest.raises(OSError, match=str(error)):
        output.PortAudio()


def test_without_sounddevice_there_is_no_portaudio(monkeypatch):
    monkeypatch.setitem(sys.modules, "sounddevice", None)
    assert output.open_output((output.PortAudio,)).name == "silent"


def test_a_machine_without_a_card_is_told_nothing(tmp_path):
    code = "from itouch_tools.sound.output import open_output; print(open_output().name)"
    env = {**os.environ, "XDG_RUNTIME_DIR": str(tmp_path), "PULSE_SERVER": f"unix:{tmp_path}/none",
           "ALSA_CONFIG_PATH": str(tmp_path / "none")}  # fmt: skip
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=env)
    assert done.stdout == "silent\n" and done.stderr == ""


def test_a_sound_server_plays_the_modes_that_were_asked_for(tmp_path):
    """A PulseAudio of our own whose only sink is recorded."""
    need_program("pulseaudio", package="pulseaudio")
    need_program("parec", package="pulseaudio-utils")
    os.chmod(tmp_path, 0o700)
    env = {
        **os.environ,
        "XDG_RUNTIME_DIR": str(tmp_path),
        "PULSE_SERVER": f"unix:{tmp_path}/sock",
        "HOME": str(tmp_path),
    }
    server = subprocess.Popen(
        ["pulseaudio", "-n", "--daemonize=no", "--exit-idle-time=-1", "--use-pid-file=no",
         "-L", "module-null-sink sink_name=out rate=48000 channels=1 format=s16le",
         "-L", f"module-native-protocol-unix socket={tmp_path}/sock auth-anonymous=1"],
        env=env, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    try:
        until((tmp_path / "sock").exists)
        words = ["bench", "sound", "--strokes", "4", "--monitor", "out.monitor", "--json", str(tmp_path / "x.json")]
        done = subprocess.run(
            [sys.executable, "-m", "itouch_tools.cli", *words], env=env, capture_output=True, text=True
        )
    finally:
        server.terminate()
        server.wait(300)
    assert done.returncode == 0, done.stderr
    found = json.loads((tmp_path / "x.json").read_text())
    assert found["plays_by"] == "PulseAudio" and found["strokes_heard"] == "4 of 4"
    assert found["modes_off_by_at_most_Hz"] < 8.0


@pytest.mark.parametrize(
    ("written", "recovered", "gone"), [(480, 0, False), (-32, 0, False), (-32, -32, True), (-19, -19, True)]
)
def test_a_card_that_has_run_dry_plays_on_and_one_that_is_gone_is_told(written, recovered, gone):
    asked = []
    library = types.SimpleNamespace(
        snd_pcm_writei=lambda stream, samples, count: written,
        snd_pcm_recover=lambda stream, error, silent: asked.append(error.value) or recovered,
    )
    card = object.__new__(output.Alsa)
    card._library, card._stream = library, None
    if gone:
        with pytest.raises(OSError, match="the sound card has gone"):
            card.write(b"\0" * 960)
    else:
        card.write(b"\0" * 960)
    assert asked == ([written] if written < 0 else []), "only what went wrong is mended"
