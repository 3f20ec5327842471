"""``itouch-py bench sound``: what sound costs, how late it is heard, and its figures against their bounds."""

from __future__ import annotations

import json
import math
import subprocess
import threading
import time
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from itouch.plugin.commands import exit_code
from itouch.schema import ItouchError
from itouch_tools.cli.arguments import Parser
from itouch_tools.cli.output_files import output_file, write_output

MODES = (523.0, 1250.0, 2890.0, 5110.0)
_SCENE = """<itouch version="1.0">
  <materials><material name="bell"><contact stiffness="1 N/mm"/><sound friction="0.5" grain="0.5 mm">
    {modes}</sound></material></materials>
  <world><box name="block" size="100 100 20 mm" pos="0 0 10 mm" material="bell"/></world>
  <devices><device name="arm" plugin="usb-arm"/></devices>
  <interaction><probe name="finger" radius="8 mm" pose-from="arm" force-to="arm"/></interaction>
</itouch>"""
#: Seconds between two taps, and before the first, in which the sound server settles.
_EVERY, _SETTLE = 0.5, 1.5
#: Time of a frame of the window at 60 Hz [s]; a published state waits for it at most this long.
_FRAME = 1.0 / 60.0


def main(argv: Sequence[str]) -> int:
    """Print the cost of a block, and the time from a published state to its sound."""
    parser = Parser(prog="itouch-py bench sound", description=main.__doc__)
    parser.add_argument("--strokes", type=int, default=10, metavar="N", help="how many taps to time (default 10)")
    parser.add_argument("--monitor", metavar="SOURCE",
                        help="a PulseAudio source that hears what is played (of a null sink: NAME.monitor): "
                             "the taps are recorded from it with parec, timed and analysed")  # fmt: skip
    parser.add_argument(
        "--judge",
        action="store_true",
        help="render taps and slides, and compare decay, modes, level and pitch with what was measured",
    )
    parser.add_argument("--keep", type=Path, metavar="FOLDER", help="with --judge: write the sounds as files, too")
    parser.add_argument("--json", type=output_file, metavar="FILE", help="write the figures, too")
    options = parser.parse_args(argv)
    if not 1 <= options.strokes <= 1000:
        parser.error("--strokes must be 1 to 1000")
    if options.judge:
        return _judge(options.keep, options.json)
    found = measure(options.strokes, options.monitor)
    for name, value in found.items():
        print(f"{name.replace('_', ' '):<34} {value if isinstance(value, str) else _shown(value)}")
    if options.json:
        write_output(options.json, json.dumps(found, indent=1))
    return 0


def _judge(keep: Path | None, path: str | None) -> int:
    """Print each figure beside its bounds, and return the exit code: 1 if one is outside."""
    from itouch_evidence.sound_analysis import judged

    rows = judged(keep)
    for row in rows:
        bound = f"above {row.low:g}" if row.high == math.inf else f"{row.low:.3g} to {row.high:.3g}"
        print(f"{row.what:<58} {row.value:>9.3g} {row.unit:<5} {bound:<18} {'' if row.good else 'OUTSIDE'}".rstrip())
    if path:
        write_output(path, json.dumps([asdict(row) for row in rows], indent=1))
    return exit_code(row.good for row in rows)


def _shown(value: Any) -> str:
    return " ".join(f"{number:.2f}" for number in value) if isinstance(value, list) else f"{value:.3g}"


def measure(strokes: int, monitor: str | None) -> dict[str, Any]:
    """Return the figures; times in milliseconds.

    Raises
    ------
    ItouchError
        If the monitor can't be recorded from.
    """
    from itouch.plugin.discovery import Catalog
    from itouch.scene import loads
    from itouch.session import build
    from itouch_tools.sound.modal import RATE
    from itouch_tools.sound.player import BLOCK, Speaker

    modes = "".join(f'<mode frequency="{f:g} Hz" decay="0.3 s"/>' for f in MODES)
    session = build(loads(_SCENE.format(modes=modes).encode(), Catalog()))
    session.run(0.01)
    found: dict[str, Any] = {"block_ms": 1e3 * BLOCK / RATE, "making_a_block_ms": 1e3 * _cost(session)}
    ear = _SoundRecorder(monitor) if monitor else None
    speaker = Speaker(session.model)
    speaker.hear(session.state)  # contacts before this state make no sound
    time.sleep(_SETTLE)
    told, made, ahead = [], [], []
    rng = np.random.default_rng(1)
    try:
        for _ in range(strokes):
            time.sleep(_EVERY + rng.uniform(0.0, 0.02))
            _strike(session.state)
            speaker.hear(session.state)
            told.append(speaker.heard)
            time.sleep(0.1)
            made.append(speaker.made - speaker.heard)
            ahead.append(speaker.ahead)
        found["plays_by"] = speaker.driver
        time.sleep(0.3)
    finally:
        speaker.close()
        heard = ear.stop() if ear is not None else None
    found |= {
        "told_to_made_p50_max_ms": _spread(made), "waiting_in_the_output_p50_max_ms": _spread(ahead),
        "with_a_frame_at_most_ms": 1e3 * (_FRAME + max(made) + max(ahead)),
    }  # fmt: skip
    return found | (_analysed(*heard, told) if heard is not None else {})


def _spread(seconds: list[float]) -> list[float]:
    return [1e3 * float(np.median(seconds)), 1e3 * max(seconds)]


def _strike(state: Any) -> None:
    """Put the event of a beginning contact at 0.3 m/s into the state."""
    table, count = state["events.table"], int(state["events.count"])
    row = table[count % len(table)]
    row["kind"], row["object"], row["speed"], row["tick"] = 1, 0, 0.3, int(state["tick"])
    state["events.count"] = count + 1
    state["tick"] = int(state["tick"]) + 1


def _cost(session: Any) -> float:
    """Return the least time [s] in which a block with all modes is rendered."""
    from itouch_tools.sound.player import BLOCK
    from itouch_tools.sound.synth import Synth

    synth, spent = Synth(session.model), []
    synth.hear(session.state)
    for _ in range(200):
        _strike(session.state)
        begin = time.perf_counter()
        synth.hear(session.state)
        synth.render(BLOCK)
        spent.append(time.perf_counter() - begin)
    return min(spent)


class _SoundRecorder:
    """Records a PulseAudio source in a thread, until ``stop``."""

    def __init__(self, source: str) -> None:
        words = ["parec", "-d", source, "--raw", "--format=s16le", "--rate=48000", "--channels=1", "--latency-msec=10"]
        try:
            self._process = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
        except OSError:
            raise ItouchError("--monitor needs parec (Debian: pulseaudio-utils)") from None
        self._pieces: list[tuple[float, bytes]] = []
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()

    def _listen(self) -> None:
        stream: Any = self._process.stdout
        while data := stream.read1(4096):
            self._pieces.append((time.perf_counter(), data))

    def stop(self) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]:
        """Return the samples, the arrival time [s] of each piece, and how many samples had come with it.

        Raises
        ------
        ItouchError
            If nothing came.
        """
        self._process.terminate()
        self._thread.join(5.0)
        if not self._pieces:
            raise ItouchError("the monitor gave nothing: `pactl list short sources` names what there is")
        samples = np.concatenate([np.frombuffer(data, "<i2") for _, data in self._pieces]) / 32767.0
        counts = np.cumsum([len(data) // 2 for _, data in self._pieces])
        return samples, np.array([when for when, _ in self._pieces]), counts


def _analysed(
    samples: NDArray[np.float64], arrived: NDArray[np.float64], counts: NDArray[np.int64], told: list[float]
) -> dict[str, Any]:
    """Return how long after its state each tap was heard, and how far off its modes are."""
    rate, late, modes = 48_000, [], []
    for when in told:
        begin = int(counts[max(0, int(np.searchsorted(arrived, when)) - 1)])
        piece = samples[begin : begin + round(0.25 * rate)]
        loud = np.flatnonzero(np.abs(np.diff(piece, prepend=piece[:1])) > 2e-3)
        if len(loud):
            place = begin + int(loud[0])
            late.append(float(arrived[int(np.searchsorted(counts, place, side="right"))]) - when)
            modes.append(peaks(samples[place : place + round(0.2 * rate)], len(MODES)))
    off = np.abs(np.array(modes) - np.array(MODES)) if modes else np.full((1, 1), np.inf)
    return {"strokes_heard": f"{len(late)} of {len(told)}", "heard_after_p50_max_ms": _spread(late or [np.inf]),
            "modes_off_by_at_most_Hz": float(off.max())}  # fmt: skip


def peaks(samples: NDArray[np.float64], count: int) -> list[float]:
    """Return the frequencies [Hz] of the highest separate peaks in the spectrum of samples (n,), in order."""
    size = np.abs(np.fft.rfft(samples * np.hanning(len(samples)), 1 << 18))
    frequency = np.fft.rfftfreq(1 << 18, 1 / 48_000)
    found = []
    for _ in range(count):
        at = int(size.argmax())
        found.append(float(frequency[at]))
        size[np.abs(frequency - frequency[at]) < 60] = 0
    return sorted(found)
