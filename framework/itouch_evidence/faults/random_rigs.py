"""Random rigs: limits, faults, taps, re-arms, restores, evil plugins; no absolute limit may ever be passed."""

from __future__ import annotations

import random
import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from itouch.monitors import default_limits
from itouch.monitors.thresholds import DOSE_FROM, DOSE_UNIT
from itouch.plugin import DeviceError, ItouchError, Role
from itouch.plugin.discovery import Catalog, Found
from itouch.scene import loads
from itouch.session import Session, build
from itouch_evidence.faults.plants import FELT, HostileModality, PlateKind, arm, plate, table
from itouch_evidence.resumable import Kept

#: Longest run of a case before its restores [s].
LONGEST = 14.0
_KINDS = (
    "disconnect", "freeze", "nan", "spike", "delay", "drop", "reversed-sign", "saturated", "wrong-units", "garbage",
)  # fmt: skip

#: Narrowest range of temperature [K] to which the limits of a rig are tightened.
NARROWEST = 1.0


class _Entry:
    """Stands in for the entry point of a plugin that exists only in this process."""

    value = "a random rig"

    def __init__(self, loaded: Any) -> None:
        self._loaded = loaded

    def load(self) -> Any:
        """Return the plugin's class."""
        return self._loaded


@dataclass(slots=True)
class Case:
    """One random rig and what is done to it."""

    number: int
    scene: str
    catalog: Catalog
    plates: list[PlateKind]
    tapped: bool
    force: float
    seconds: float
    restores: int
    tightens: bool = False
    #: Fraction of every budget that is left when the case begins.
    left: float = 1.0
    broken: list[str] = field(default_factory=list)
    trips: list[str] = field(default_factory=list)


def draw(number: int, seed: int) -> Case:
    """Draw a case at random; the same ``number`` and ``seed`` always give the same one."""
    rng = random.Random(f"{seed} {number}")
    words = _words(rng)
    plates = [
        PlateKind(next(words), next(words), next(words), rng.random() < 0.3, rng.uniform(4.0, 60.0),
                  rng.uniform(8.0, 30.0), rng.choice((0.0, 0.007, 0.02, 0.023)))
        for _ in range(rng.choice((1, 1, 2)))
    ]  # fmt: skip
    tapped = rng.random() < 0.5
    force = rng.choice((3.0, 3.0, 1.0, 0.5))
    devices: dict[str, Any] = {f"p{index}": plate(kind) for index, kind in enumerate(plates)}
    listed = [_listed(kind.device, f"p{index}", rng, heats=not kind.target) for index, kind in enumerate(plates)]
    probe = ""
    if tapped:
        devices |= {"a": arm(), "t": table((rng.uniform(0.3, 12.0), rng.choice((0.011, 0.02, 0.1, 1.0)),
                                            rng.choice((0.04, 0.4, 1.0))), rng.choice((0.0, 0.007)))}  # fmt: skip
        listed += ['<device name="hand" plugin="a"/>', '<device name="lift" plugin="t"/>']
        probe = '<probe name="tip" pose-from="hand" force-to="hand" surface-to="lift"/>'
    faults = "".join(_fault(rng, plates) for _ in range(rng.choice((0, 1, 1, 2))))
    foreign = _foreign(rng, plates, tapped)
    evil = type("Evil", (HostileModality,), {
        "targets": tuple((f"{k.device}.{k.obeys}", _drive(rng, k)) for k in plates), "foreign": foreign,
        "since": rng.uniform(0.5, 5.0),
    })  # fmt: skip
    groups = {"itouch.devices": devices, "itouch.modalities": {"evil.push": evil}}
    catalog = Catalog(lambda g: {n: Found(n, "random", "1", _Entry(v)) for n, v in groups.get(g, {}).items()})  # type: ignore[arg-type]
    safety = rng.choice(("", f'dose="{rng.uniform(1.0, 60.0):.1f} s"', f'contact-time="{rng.uniform(0.5, 5.0):.1f} s"'))
    text = (
        '<itouch version="1.0" xmlns:evil="urn:itouch:plugin:evil">'
        f'<rates servo="500 Hz"/><devices>{"".join(listed)}</devices>'
        f'<interaction>{probe}<evil:push/></interaction><safety force="{force:g} N" {safety}/>{faults}</itouch>'
    )
    return Case(number, text, catalog, plates, tapped, force, rng.uniform(4.0, LONGEST), rng.choice((0, 1, 3)),
                rng.random() < 0.5, rng.choice((1.0, 10.0 ** -rng.uniform(0.5, 4.0))))  # fmt: skip


def _words(rng: random.Random) -> Iterator[str]:
    seen = {"hand", "lift", "tip", "push"}
    while True:
        word = "".join(rng.choices("abcdefghijklmnopqrstuvwxyz", k=rng.randint(4, 9)))
        if word not in seen:
            seen.add(word)
            yield word


def _listed(name: str, plugin: str, rng: random.Random, *, heats: bool) -> str:
    current = f'current="{rng.uniform(0.2, 2.0):.2f} A"' if heats and rng.random() < 0.4 else ""
    low, high = rng.uniform(15.0, 22.0), rng.uniform(30.0, 40.0)
    warm = f'temperature="{low:.1f} {high:.1f} degC"' if rng.random() < 0.4 else ""
    return f'<device name="{name}" plugin="{plugin}"><limits {current} {warm}/></device>'


def _fault(rng: random.Random, plates: list[PlateKind]) -> str:
    kind = rng.choice(plates)
    ends = f' for="{rng.uniform(0.1, 3.0):.2f} s"' if rng.random() < 0.5 else ""
    at = rng.uniform(0.2, 8.0)
    return f'<fault device="{kind.device}" kind="{rng.choice(_KINDS)}" at="{at:.2f} s"{ends}/>'


def _drive(rng: random.Random, kind: PlateKind) -> float:
    return rng.choice((250.0, 300.0, 400.0)) if kind.target else rng.choice((-9.0, -2.0, -0.7, 0.7, 2.0, 9.0))


def _foreign(rng: random.Random, plates: list[PlateKind], tapped: bool) -> tuple[tuple[str, float], ...]:
    if rng.random() < 0.85:
        return ()
    name = plates[0].device
    wanted = [(f"{name}.{plates[0].reads}", 300.0), (f"{name}.heat.dose", 0.0), (f"{name}.status", 2.0)]
    wanted += [(f"{name}.sent.{plates[0].obeys}", 2.0), ("hold", 2.0**62), (f"{name}.heat.share", 1.0)]
    wanted += [(f"lift.{FELT.name}", 0.0), ("lift.surface.contact_time", 0.0)] if tapped else []
    return (rng.choice(wanted),)


class Truth:
    """The true temperatures, forces and exposures of the finger, over all restores of a case."""

    def __init__(self, case: Case) -> None:
        self.case, self.dose, self.cold, self.touch = case, 0.0, 0.0, 0.0
        self.low, self.high, self.push = np.inf, -np.inf, 0.0
        # The monitors count cold from COLD_FROM, a kelvin early, so that a failing sensor may be off by that much.
        self.cold_from = default_limits.COLD_ABSOLUTE if "<fault " in case.scene else default_limits.COLD_FROM - 1e-2

    def follow(self, session: Session) -> None:
        """Note the truth after each tick of a session."""
        plates = [session.state[f"{kind.device}.twin.true"] for kind in self.case.plates]
        period = session.model.period
        devices, tapped = session.model.devices, self.case.tapped
        felt_by = devices["lift"].field(Role.CONTACT_FORCE) if tapped else ""
        pushed_by = devices["hand"].field(Role.FORCE_ON_OPERATOR, "sent") if tapped else ""

        def note(tick: int) -> None:
            for view in plates:
                true = view.item()
                self.low, self.high = min(self.low, true), max(self.high, true)
                if true >= DOSE_FROM:
                    self.dose += period * (0.5 if true >= DOSE_UNIT else 0.25) ** (DOSE_UNIT - true)
                self.cold += period * (true < self.cold_from)
            if tapped:
                state = session.state
                felt = float(np.linalg.norm(state[felt_by][:3]))
                self.touch = max(0.0, self.touch + (period if felt > 0.03 else -period))
                self.push = max(self.push, float(np.linalg.norm(state[pushed_by][:3])) + felt)

        session.taps.append(note)

    def broken(self) -> list[str]:
        """Return which absolute limits were passed."""
        found = []
        ran, (least, most) = self.low <= self.high, default_limits.PLATE_ABSOLUTE
        if ran and not least <= self.low <= self.high <= most:
            found.append(f"plate {self.low - 273.15:.2f} to {self.high - 273.15:.2f} degC")
        if self.dose > 1.05 * default_limits.DOSE:
            found.append(f"dose {self.dose:.1f} s")
        if self.cold > 1.05 * default_limits.COLD_TIME:
            found.append(f"{self.cold:.1f} s in the cold")
        if self.touch > 120.0:
            found.append(f"touched for {self.touch:.1f} s")
        if self.push > default_limits.PLATE_FORCE_ABSOLUTE:
            found.append(f"pushed with {self.push:.1f} N")
        return found


def run(case: Case) -> Case:
    """Run a case to its end or to a fault; then restore and re-arm it as often as it says."""
    truth, text = Truth(case), case.scene
    session = _built(text, case)
    _use_up(session, case.left, truth)
    truth.follow(session)
    _go(session, case, case.seconds)
    for way in range(case.restores):
        spent = _spent(session)
        if way % 2 == 0:
            stored = session.snapshot()
            if case.tightens:
                text = tightened(text, stored.state["tick"].item())
            session = _built(text, case)
            truth.follow(session)
            session.take_up(stored)
            if spent and not _spent(session):  # tighter limits give back even less
                case.broken.append(f"a budget came back: {spent}")
        try:
            session.rearm()
        except (DeviceError, ItouchError) as error:
            case.trips.append(f"refused: {str(error).split(' at tick')[0][:60]}")
            break
        _go(session, case, 2.0)
    case.broken += truth.broken()
    return case


def _use_up(session: Session, left: float, truth: Truth) -> None:
    """Use a part of every budget up, as by an earlier session of the participant; all plates touch one finger."""
    for runner in session.runners:
        most, part = runner.model.limits, (1.0 - left) / len(truth.case.plates)
        for post in runner.gate.heats:
            dose, cold = part * (most.dose or default_limits.DOSE), part * (most.cold_time or default_limits.COLD_TIME)
            post.state["dose"], post.state["cold_time"] = dose, cold
            truth.dose, truth.cold = truth.dose + dose, truth.cold + cold


def _spent(session: Session) -> str:
    """Return the first device with a used-up budget, and which budget; empty if there is none."""
    return next((f"{r.model.name} {said}" for r in session.runners if (said := r.gate.device_monitors.spent())), "")


def tightened(text: str, seed: int) -> str:
    """Return a scene whose limits are drawn again, none of them looser than before."""
    rng = random.Random(seed)

    def less(found: re.Match[str]) -> str:
        return f'{found[1]}="{float(found[2]) * rng.uniform(0.3, 1.0):.3f}'

    def narrower(found: re.Match[str]) -> str:
        low, high = float(found[1]) + rng.uniform(0.0, 3.0), float(found[2]) - rng.uniform(0.0, 3.0)
        if high - low < NARROWEST:  # after several restores, too little of the range may be left
            return found[0]
        return f'temperature="{low:.1f} {high:.1f}'

    head, mark, safety = text.rpartition("<safety ")
    if "dose=" not in safety and rng.random() < 0.5:
        safety = f'dose="{rng.uniform(1.0, 60.0):.1f} s" {safety}'
    text = re.sub(r'(current|force|dose|contact-time)="([0-9.]+)', less, f"{head}{mark}{safety}")
    return re.sub(r'temperature="([0-9.]+) ([0-9.]+)', narrower, text)


def _built(text: str, case: Case) -> Session:
    return build(loads(text.encode(), case.catalog), catalog=case.catalog, seed=case.number)


def _go(session: Session, case: Case, seconds: float) -> None:
    try:
        session.run(seconds)
    except ItouchError:
        faults = session.report()["faults"]
        case.trips.append(faults[-1]["trip"] if faults and faults[-1]["trip"] else "refused")


def campaign(count: int, seed: int, keep: str | None = None) -> int:
    """Run ``count`` cases, except those whose results are kept already, and print a summary of all results.

    Returns
    -------
    int
        How many cases passed an absolute limit or got a used-up budget back.
    """
    kept = Kept(keep)
    for number in range(count):
        if (seed, number) in kept:
            continue
        case = run(draw(number, seed))
        trips = [trip.partition(": device")[0] for trip in case.trips or ["none: inside the limits"]]
        kept.add(seed, number, {"trips": trips, "broken": case.broken})
        if case.broken:
            wrong = "; ".join(case.broken)
            print(f"case {number} of seed {seed}: WRONG: {wrong}; {case.trips}\n  {case.scene}", flush=True)
    return _sum_up(kept)


def _sum_up(kept: Kept) -> int:
    rows = list(kept.rows.values())
    wrong = [row for row in rows if row["broken"]]
    seeds = ", ".join(map(str, kept.seeds))
    print(f"{len(rows)} random rigs of seed {seeds}, {len(wrong)} wrong")
    for trip, times in Counter(trip for row in rows for trip in row["trips"]).most_common():
        print(f"  {times:5d}  {trip}")
    return len(wrong)
