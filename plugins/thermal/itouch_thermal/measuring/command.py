"""``itouch-py measure``: measure real touches of an instrumented sample, and write their mean as a curve."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from itouch.plugin import ItouchError, parse_quantity
from itouch_thermal.measuring.correct import Average, Sensors, average
from itouch_thermal.measuring.sampling import Source, sample
from itouch_thermal.measuring.touches import TOUCHED, Touched, Wanted, sort_out, touches


def main(argv: Sequence[str]) -> int:
    """Measure touches; returns 0, 1 if too few were good, or 2 for wrong input."""
    parser = argparse.ArgumentParser(prog="itouch-py measure", description=__doc__)
    commands = parser.add_subparsers(metavar="WHAT")
    touch = commands.add_parser("touch", help="touch a sample again and again", description=_touch.__doc__)
    _arguments(touch)
    touch.set_defaults(command=_touch)
    parser.set_defaults(command=None)
    options = parser.parse_args(list(argv))
    if options.command is None:
        parser.print_help()
        return 2
    try:
        return int(options.command(options))
    except ItouchError as error:
        print(error, file=sys.stderr)
    except (ValueError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
    return 2


def _arguments(touch: argparse.ArgumentParser) -> None:
    touch.add_argument("scene", metavar="SCENE", help="a scene with a flux film and a force sensor under a sample")
    touch.add_argument("-o", "--output", required=True, metavar="FILE.csv", help="the curve: t, j and its error")
    touch.add_argument("--force", default="1 N", metavar="1N", help="force of a touch (default 1 N)")
    touch.add_argument("--tolerance", default="15 %", metavar="PART", help="part by which it may be off (15 %%)")
    touch.add_argument("--duration", default="4 s", metavar="4s", help="how long a touch must last (default 4 s)")
    touch.add_argument("--repeat", type=int, default=8, metavar="N", help="good touches that are wanted (default 8)")
    touch.add_argument("--for", dest="longest", metavar="10min", help="longest time; default: the scripted motion")
    touch.add_argument("--every", default="10 ms", metavar="10ms", help="time between rows (default 10 ms)")
    touch.add_argument("--lag", metavar="50ms", help="time constant of the film; default: as the scene has it")
    touch.add_argument("--film-capacity", metavar="QUANTITY", help="heat capacity of the film; default: the scene's")
    touch.add_argument("--raw", metavar="FOLDER", help="write every good touch as it was read, for `identify`")
    touch.add_argument("--who", default="", help="who touches, such as P07")
    touch.add_argument("--what", default="", help="what is touched, such as wood")
    touch.add_argument("--no-prompt", action="store_true", help="no prompts, as where there is no terminal")
    touch.add_argument("--seed", type=int, default=0, metavar="N", help="seed of the twins' noise (default 0)")
    touch.add_argument("--rig", metavar="FILE", help="put another rig under the scene")
    touch.add_argument("--twin", metavar="all|none|NAME", help="run these devices as simulated twins")


def _quantity(text: str, unit: str) -> float:
    import re

    return parse_quantity(re.sub(r"(?<=[0-9.])\s*(?=[A-Za-z%])", " ", text, count=1), unit)[0]


def _touch(options: argparse.Namespace) -> int:
    """Sample touches of a scene, leave out those that are not as wanted, and write the mean of the others as a curve.

    The film's lag, and the heat that the film stores, are taken out.
    """
    wanted = Wanted(
        _quantity(options.force, "N"), _quantity(options.duration, "s"), _quantity(options.tolerance, "")
    )  # fmt: skip
    if options.repeat < 1:
        raise ValueError(f"--repeat {options.repeat} is out of range: 1 or more")
    output = Path(options.output)
    if not output.parent.is_dir() or output.is_dir():
        raise ValueError(f"--output '{output}' can't be written: {output.parent} must be a folder, and it a file")
    prompts = None if options.no_prompt or not sys.stderr.isatty() else _Prompts(wanted, options.repeat)
    record, source = sample(
        options.scene, seed=options.seed, rig=options.rig, twin=options.twin,
        longest=_quantity(options.longest, "s") if options.longest else None, watch=prompts,
    )  # fmt: skip
    good, bad = sort_out(touches(record), Wanted(**{**_as_dict(wanted), "full_scale": source.full_scale}))
    for why in bad:
        print(f"left out: {why}", file=sys.stderr)
    if len(good) < min(2, options.repeat):
        print(f"error: {len(good)} good touches of {len(good) + len(bad)}: too few to be averaged", file=sys.stderr)
        return 1
    good = good[: options.repeat]
    sensors = _sensors(options, source.sensors)
    mean = average(good, sensors, _quantity(options.every, "s"))
    output.write_text(curve_text(mean, good, bad, sensors, wanted, options), encoding="utf-8")
    if options.raw:
        _write_raw(Path(options.raw), good, sensors, options, source)
    print(f"wrote {output}: {len(good)} touches, {len(bad)} left out; {noise_words(mean)}")
    return 0 if len(good) >= options.repeat else 1


def _as_dict(wanted: Wanted) -> dict[str, float]:
    return {name: getattr(wanted, name) for name in wanted.__slots__}


def _sensors(options: argparse.Namespace, of: Sensors) -> Sensors:
    lag = of.lag if options.lag is None else _quantity(options.lag, "s")
    given = options.film_capacity
    return Sensors(lag, of.film_lag, of.capacity if given is None else _quantity(given, "J/(m^2*K)"))


def noise_words(mean: Average) -> str:
    """Say what the correction does to the noise of one touch."""
    at = [k for k in (int(np.searchsorted(mean.times, t - 1e-9)) for t in (0.1, 1.0)) if k < len(mean.times)]
    parts = [
        f"{mean.flux_gain[k]:.2f} x the film's and {mean.film_gain[k]:.0f} W/m2 a kelvin of its thermometer's "
        f"at {mean.times[k]:.2g} s"
        for k in at
    ]
    return "noise of one sample counts " + ", ".join(parts)


def curve_text(
    mean: Average, good: list[Touched], bad: list[str], sensors: Sensors, wanted: Wanted, options: argparse.Namespace
) -> str:  # fmt: skip
    """Return the curve as CSV with a head that says how it came about."""
    skin = [touch.skin - 273.15 for touch in good]
    head = [
        f"what: {options.what or 'not said'}", f"who: {options.who or 'not said'}",
        f"when: {datetime.now(UTC):%Y-%m-%d %H:%M:%S} UTC", f"scene: {options.scene}",
        f"touches: {len(good)} averaged, {len(bad)} left out", *bad,
        f"force: {np.mean([touch.pressed for touch in good]):.3f} N, wanted {wanted.force:g} N",
        f"skin before: {np.mean(skin):.2f} degC ({np.min(skin):.2f} to {np.max(skin):.2f})",
        f"room, by the film before: {np.mean([touch.rest for touch in good]) - 273.15:.2f} degC",
        f"film: lag {sensors.lag:g} s, its thermometer {sensors.film_lag:g} s, {sensors.capacity:g} J/m2K; "
        f"read {np.mean([touch.offset for touch in good]):.2f} W/m2 at rest, which is taken away",
        "j: " + ("flux out of the finger: " if sensors.capacity else "flux through the film's middle: ")
        + ("lag and stored heat taken out" if sensors.capacity else "lag taken out" if sensors.lag else "as read"),
        noise_words(mean),
    ]  # fmt: skip
    rows = [
        f"{t:.9g},{j:.6g},{'' if np.isnan(e) else f'{e:.3g}'}"
        for t, j, e in zip(mean.times.tolist(), mean.flux.tolist(), mean.error.tolist(), strict=True)
    ]
    return "\n".join([*(f"# {line}" for line in head), "t [s],j [W/m^2],error [W/m^2]", *rows, ""])


def _write_raw(
    folder: Path, good: list[Touched], sensors: Sensors, options: argparse.Namespace, source: Source
) -> None:  # fmt: skip
    """Write touches as they were read, with what `identify` must know in the head."""
    folder.mkdir(parents=True, exist_ok=True)
    for k, touch in enumerate(good):
        head = [
            f"# what: {options.what}", f"# who: {options.who}", f"# skin [degC]: {touch.skin - 273.15:.4f}",
            f"# room [degC]: {touch.rest - 273.15:.4f}", f"# force [N]: {touch.pressed:.4f}",
            f"# lag [s]: {sensors.lag:g}", f"# capacity [J/m2K]: {sensors.capacity:g}", f"# device: {source.device}",
        ]  # fmt: skip
        rows = [
            f"{t:.6f},{j:.4f},{film - 273.15:.4f},{force:.4f}"
            for t, j, film, force in zip(
                touch.times.tolist(), touch.flux.tolist(), touch.film.tolist(), touch.force.tolist(), strict=True
            )
        ]
        text = "\n".join([*head, "t [s],j [W/m^2],film [degC],force [N]", *rows, ""])
        (folder / f"touch{k + 1:02d}.csv").write_text(text, encoding="utf-8")


class _Prompts:
    """Tells the operator what to do, and ends the measurement once enough touches were long enough."""

    def __init__(self, wanted: Wanted, repeat: int) -> None:
        self._wanted, self._repeat = wanted, repeat
        self._done, self._begun, self._told = 0, 0.0, ""

    def __call__(self, time: float, force: float) -> bool:
        """Take note of a force; return whether all touches are over."""
        if force <= TOUCHED:
            self._begun = 0.0
            if self._told == "lift the finger, and wait until the sample has recovered":
                self._done += 1
            if self._done >= self._repeat:
                return True
            self._say(f"touch {self._done + 1} of {self._repeat}: press with {self._wanted.force:g} N")
            return False
        self._begun = self._begun or time
        if time - self._begun < self._wanted.duration:
            self._say(f"hold for {self._wanted.duration:g} s")
        else:
            self._say("lift the finger, and wait until the sample has recovered")
        return False

    def _say(self, words: str) -> None:
        if words != self._told:
            self._told = words
            print(words, file=sys.stderr, flush=True)
