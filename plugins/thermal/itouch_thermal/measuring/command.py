"""Measure real touches of an instrumented sample, and write their mean as a curve."""

from __future__ import annotations

import argparse
import os
import re
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from itouch.plugin import ItouchError, parse_quantity
from itouch.plugin.commands import command_parser, output_file, output_folder
from itouch_thermal.atomic_write import write_whole
from itouch_thermal.measuring.correct import Average, average
from itouch_thermal.measuring.sampling import Given, Sampled, sample
from itouch_thermal.measuring.touches import BASE, LASTS, TOUCHED, Touched, Wanted, pressed, sort_out, touches

_LIFT = "lift the finger, and wait until the sample has recovered"


def main(argv: Sequence[str]) -> int:
    """Measure real touches of a sample, and average them to a flux curve; returns 0, 1 if too few were good, or 2."""
    parser = command_parser("itouch-py measure", __doc__)
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
        return error.exit_code
    except (ValueError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
    return 2


def _arguments(touch: argparse.ArgumentParser) -> None:
    touch.add_argument("scene", metavar="SCENE", help="a scene with a flux film and a force sensor under a sample")
    touch.add_argument("-o", "--output", type=output_file(), required=True, metavar="FILE.csv",
                       help="the curve: t, j and its error")  # fmt: skip
    touch.add_argument("--force", default="1 N", metavar="1N", help="force of a touch (default 1 N)")
    touch.add_argument("--tolerance", default="15 %", metavar="PART", help="part by which it may be off (15 %%)")
    touch.add_argument("--duration", default="4 s", metavar="4s", help="how long a touch must last (default 4 s)")
    touch.add_argument(
        "--repeat", type=int, default=8, metavar="N", help="how many good touches to measure (default 8)"
    )
    touch.add_argument("--for", dest="longest", metavar="10min", help="longest time; default: the scripted motion")
    touch.add_argument("--every", default="10 ms", metavar="10ms", help="time between rows (default 10 ms)")
    touch.add_argument("--lag", metavar="50ms", help="time constant of the film; default: as the scene has it")
    touch.add_argument("--film-capacity", metavar="QUANTITY", help="heat capacity of the film; default: the scene's")
    touch.add_argument("--raw", type=output_folder, metavar="FOLDER",
                       help="write every good touch as it was read, for `identify`")  # fmt: skip
    touch.add_argument("--who", default="", help="who touches, such as P07")
    touch.add_argument("--what", default="", help="what is touched, such as wood")
    touch.add_argument("--seed", type=int, default=0, metavar="N", help="seed of the twins' noise (default 0)")
    touch.add_argument("--rig", metavar="FILE", help="put another rig under the scene")
    touch.add_argument("--twin", metavar="all|none|NAME", help="run these devices as simulated twins")


@dataclass(frozen=True, slots=True)
class _Asked:
    """The parsed options, each checked before anything is measured."""

    wanted: Wanted
    longest: float | None
    every: float
    given: Given
    output: Path
    raw: Path | None


def _asked(options: argparse.Namespace) -> _Asked:
    """Check and return the options.

    Raises
    ------
    ValueError
        If one is wrong; the message names it, the value given and what is allowed.
    OSError
        If the folder for raw touches can't be created.
    """
    duration = _quantity(options, "duration", "s", 0.05, 3600.0)
    wanted = Wanted(
        _quantity(options, "force", "N", 0.06, 1000.0), duration, _quantity(options, "tolerance", "", 1e-3, 1.0)
    )  # fmt: skip
    every = _quantity(options, "every", "s", 1e-4, 0.5 * duration)
    given = Given(
        None if options.lag is None else _quantity(options, "lag", "s", 0.0, min(2.0, duration)),
        None if options.film_capacity is None else _quantity(options, "film_capacity", "J/(m^2*K)", 0.0, 1e4),
    )
    longest = None if options.longest is None else _quantity(options, "longest", "s", 1e-3, 7.0 * 86400.0)
    if not 0 <= options.seed < 1 << 63:
        raise ValueError(f"--seed {options.seed} is out of range: 0 to 2^63 - 1")
    if options.repeat < 1:
        raise ValueError(f"--repeat {options.repeat} is out of range: 1 or more")
    output = Path(options.output)
    if not output.parent.is_dir() or output.is_dir():
        raise ValueError(f"--output '{output}' can't be written: {output.parent} must be a folder, and it a file")
    raw = Path(options.raw) if options.raw else None
    if raw is not None:
        if any(part.exists() and not part.is_dir() for part in (raw, *raw.parents)):
            raise ValueError(f"--raw '{raw}' is not a folder, and none can be made there; name another one")
        raw.mkdir(parents=True, exist_ok=True)
        if not os.access(raw, os.W_OK):
            raise ValueError(f"--raw '{raw}': nothing can be written there; name another folder")
        if any(raw.glob("*.csv")):
            raise ValueError(f"--raw '{raw}' holds files already, which `identify` would take for these touches; name "
                             f"another folder, or remove them")  # fmt: skip
    return _Asked(wanted, longest, every, given, output, raw)


def _quantity(options: argparse.Namespace, name: str, unit: str, low: float, high: float) -> float:
    text, flag = str(getattr(options, name)), "for" if name == "longest" else name.replace("_", "-")
    try:
        value = float(parse_quantity(re.sub(r"(?<=[0-9.])\s*(?=[A-Za-z%])", " ", text, count=1), unit)[0])
    except ValueError as error:
        raise ValueError(f"--{flag} {text}: {error}") from error
    if not low <= value <= high:
        raise ValueError(f"--{flag} {text} is out of range: {low:g} to {high:g} {unit}".rstrip())
    return value


def _touch(options: argparse.Namespace) -> int:
    """Sample touches of a scene, leave out those that are not as wanted, and write the mean of the others as a curve.

    The film's lag, and the heat that the film stores, are taken out.
    """
    asked = _asked(options)
    wanted = asked.wanted
    prompts = Prompts(wanted, options.repeat) if sys.stderr.isatty() else None
    found = sample(
        options.scene, seed=options.seed, rig=options.rig, twin=options.twin, longest=asked.longest, watch=prompts,
        given=asked.given,
    )  # fmt: skip
    if found.stopped:
        print(f"stopped: {found.stopped}; what was read before is used", file=sys.stderr)
    good, bad = sort_out(touches(found.record), replace(wanted, full_scale=found.source.full_scale))
    for why in bad:
        print(f"left out: {why}", file=sys.stderr)
    good = good[: options.repeat]
    if asked.raw is not None:
        _write_raw(asked.raw, good, options, found)
    if len(good) < min(2, options.repeat):
        print(f"error: {len(good)} good touches of {len(good) + len(bad)}: too few to be averaged", file=sys.stderr)
        return 1
    mean = average(good, found.source.sensors, asked.every)
    write_whole(asked.output, curve_text(mean, good, bad, found, wanted, options))
    print(f"wrote {asked.output}: {len(good)} touches, {len(bad)} left out; {noise_words(mean)}")
    return 0 if len(good) >= options.repeat and not found.stopped else 1


def _room(touch: Touched, found: Sampled) -> float:
    """Return the room's temperature [K]: the film's before a touch, or the scene's without a film thermometer."""
    return touch.rest if np.isfinite(touch.rest) else found.room


def noise_words(mean: Average) -> str:
    """Return a sentence on how the correction amplifies the noise of one touch."""
    at = [k for k in (int(np.searchsorted(mean.times, t - 1e-9)) for t in (0.1, 1.0)) if k < len(mean.times)]
    parts = [
        f"{mean.flux_gain[k]:.2f} x the film's and {mean.film_gain[k]:.0f} W/m2 a kelvin of its thermometer's "
        f"at {mean.times[k]:.2g} s"
        for k in at
    ]
    return "noise of one sample counts " + ", ".join(parts)


def curve_text(
    mean: Average, good: list[Touched], bad: list[str], found: Sampled, wanted: Wanted, options: argparse.Namespace
) -> str:  # fmt: skip
    """Return the curve as CSV with a header that documents its origin."""
    sensors = found.source.sensors
    skin = [touch.skin - 273.15 for touch in good]
    by = "by the film before" if found.source.film else "as the scene has it"
    head = [
        f"what: {options.what or 'not said'}", f"who: {options.who or 'not said'}",
        f"when: {datetime.now(UTC):%Y-%m-%d %H:%M:%S} UTC", f"scene: {options.scene}",
        f"touches: {len(good)} averaged, {len(bad)} left out", *bad,
        f"force: {np.mean([touch.pressed for touch in good]):.3f} N, desired {wanted.force:g} N",
        f"skin before: {np.mean(skin):.2f} degC ({np.min(skin):.2f} to {np.max(skin):.2f})",
        f"room, {by}: {np.mean([_room(touch, found) for touch in good]) - 273.15:.2f} degC",
        f"film: lag {sensors.lag:g} s, its thermometer {sensors.film_lag:g} s, {sensors.capacity:g} J/m2K; "
        f"read {np.mean([touch.offset for touch in good]):.2f} W/m2 at rest, which is subtracted",
        f"calibration: {found.source.calibration}",
        "j: " + ("flux out of the finger: " if sensors.capacity else "flux through the film's middle: ")
        + ("lag and stored heat taken out" if sensors.capacity else "lag taken out" if sensors.lag else "as read"),
        noise_words(mean),
    ]  # fmt: skip
    rows = [
        f"{t:.9g},{j:.6g},{'' if np.isnan(e) else f'{e:.3g}'}"
        for t, j, e in zip(mean.times.tolist(), mean.flux.tolist(), mean.error.tolist(), strict=True)
    ]
    return "\n".join([*(f"# {line}" for line in head), "t [s],j [W/m^2],error [W/m^2]", *rows, ""])


def _write_raw(folder: Path, good: list[Touched], options: argparse.Namespace, found: Sampled) -> None:
    """Write touches as they were read, with what `identify` needs in the header."""
    source, sensors = found.source, found.source.sensors
    for k, touch in enumerate(good):
        head = [
            f"# what: {options.what}", f"# who: {options.who}", f"# skin [degC]: {touch.skin - 273.15:.4f}",
            f"# room [degC]: {_room(touch, found) - 273.15:.4f}", f"# force [N]: {touch.pressed:.4f}",
            f"# lag [s]: {sensors.lag:g}", f"# capacity [J/m2K]: {sensors.capacity:g}",
            *([f"# film resistance [m2K/W]: {sensors.resistance:g}"] if sensors.resistance > 0.0 else []),
            f"# device: {source.device}",
        ]  # fmt: skip
        rows = [
            f"{t:.6f},{j:.4f},{'' if np.isnan(film) else f'{film - 273.15:.4f}'},{force:.4f}"
            for t, j, film, force in zip(
                touch.times.tolist(), touch.flux.tolist(), touch.film.tolist(), touch.force.tolist(), strict=True
            )
        ]
        text = "\n".join([*head, "t [s],j [W/m^2],film [degC],force [N]", *rows, ""])
        write_whole(folder / f"touch{k + 1:02d}.csv", text)


class Prompts:
    """Tells an operator at a terminal when to press, hold and lift; ends the measurement after enough good touches."""

    def __init__(self, wanted: Wanted, repeat: int) -> None:
        self._wanted, self._repeat = wanted, repeat
        self._done, self._told = 0, ""
        #: Time since which nothing has touched [s], time since which the force has been low, times and forces of this
        #: touch.
        self._free: float | None = None
        self._low: float | None = None
        self._touch: list[tuple[float, float]] = []

    def __call__(self, time: float, force: float) -> bool:
        """Record a force; return whether all touches are done."""
        free = self._free = time if self._free is None else self._free
        if force > TOUCHED:
            self._low = None
            self._touch.append((time, force))
        elif self._touch:
            self._low = time if self._low is None else self._low
            if time - self._low >= LASTS - 1e-9:
                self._over(time, free)
        if self._done >= self._repeat:
            return True
        self._say(self._words(time))
        return False

    def _words(self, time: float) -> str:
        if self._touch:
            held = time - self._touch[0][0] < self._wanted.duration
            return f"hold for {self._wanted.duration:g} s" if held else _LIFT
        if self._free is not None and time - self._free < BASE:
            return _LIFT if self._told == _LIFT else "keep the finger off"
        return f"touch {self._done + 1} of {self._repeat}: press with {self._wanted.force:g} N"

    def _over(self, time: float, free: float) -> None:
        """Count a touch that has ended, or say why it does not count."""
        at, force = np.array(self._touch).T
        self._touch, self._low = [], None
        if at[-1] - at[0] < LASTS:
            return  # too short to be a touch
        self._free = time
        why = self._wanted.why_not_held(float(at[0]) - free, float(at[-1] - at[0]), pressed(at - at[0], force))
        if why:
            self._say(f"that one does not count: {why}")
        else:
            self._done += 1

    def _say(self, words: str) -> None:
        if words != self._told:
            self._told = words
            print(words, file=sys.stderr, flush=True)
