"""``itouch-py bench tick``: what a tick in contact costs, how far that is from its compiled part, and how it grows.

It also prints the cost of the dearest ticks in which a touch begins, ends or changes its object, to be compared with
the period of the loop.  All figures are of one process on twins; a busy machine shows in p99 first.  Compare two
commits only on the same machine, by running them in turns.
"""

from __future__ import annotations

import argparse
import gc
import json
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from itouch.joining import runner
from itouch.loop.clock import now, processor_time
from itouch.loop.plan import Plan
from itouch.loop.tick_step import Step
from itouch.loop.write_access import WriteGuard
from itouch.plugin import Contact
from itouch.plugin.commands import exit_code, judged
from itouch.plugin.discovery import Catalog
from itouch.scene import Scene, loads
from itouch.session import Session, build, load_scene

#: Numbers of probes, objects and devices for which growth is measured.
PROBES, OBJECTS, DEVICES = (1, 2, 4, 8), (1, 10, 100, 1000), (1, 2, 5, 10)
#: How many ticks are measured together: few enough to be undisturbed on a busy machine, and so many that, at 1 kHz,
#: each check that a monitor makes now and then is among them once.
ROUND = 10
#: Bounds: how many times its compiled steps in one loop a tick may cost, and what a step in plain Python may add [us].
TIMES, SPLIT = 2.0, 10.0
#: The longest search for a contact [simulated s].
SEARCH = 60.0
#: The rates [Hz] at which touches are measured, how many touches, for how many ticks from the one with the event (the
#: finger may be set down, or the report be added to, a moment later), and in how many runs: of each tick the least
#: counts.
RATES, TOUCHES, AFTER, RUNS = (1000.0, 4000.0), 2, 20, 3
#: What a touch may do, by the kinds of its events in a tick.
TURNS = {"begins": {Contact.BEGIN}, "ends": {Contact.END}, "changes": {Contact.BEGIN, Contact.END}}

_BOX = '<box name="box{0}" size="9 9 20 mm" pos="{1} {2} 10 mm" material="wood"/>'
_WOOD = (
    '<materials><material name="wood"><contact stiffness="1.2 N/mm" damping="2 N*s/m" static-friction="0.4"/>'
    "</material></materials>"
)
_PROBE = (
    '<probe name="finger{0}" radius="8 mm" pose-from="arm{0}" force-to="arm{0}"/><operator probe="finger{0}"><motion>'
    '<to pos="0 0 40 mm" in="0.05 s"/><to pos="0 0 24 mm" in="0.2 s" hold="3600 s"/></motion></operator>'
)


def scene_of(probes: int = 1, objects: int = 1, devices: int = 1) -> Scene:
    """Return a scene with arms, of which the first ``probes`` lead fingers that rest on boxes; the others are idle."""
    aside = [(20.0 * (i % 32), 20.0 * (i // 32)) for i in range(objects)]
    boxes = "".join(_BOX.format(i, f"{x:g}", f"{y:g}") for i, (x, y) in enumerate(aside))
    arms = "".join(f'<device name="arm{i}" plugin="usb-arm"/>' for i in range(max(probes, devices)))
    fingers = "".join(_PROBE.format(i) for i in range(probes))
    text = (
        f'<itouch version="1.0">{_WOOD}<world>{boxes}</world><devices>{arms}</devices>'
        f"<interaction>{fingers}</interaction></itouch>"
    )
    return loads(text.encode(), Catalog(), shown="bench-tick.xml")


def sliding() -> Scene:
    """Return a scene of one finger that slides from a box to the one beside it, and lifts, twice."""
    down = '<to pos="0 0 24 mm" in="0.2 s"/><to pos="9 0 24 mm" in="0.1 s"/><to pos="9 0 40 mm" in="0.1 s"/>'
    boxes = _BOX.format(0, "0", "0") + _BOX.format(1, "9", "0")
    motion = f'<motion><to pos="0 0 40 mm" in="0.05 s"/>{down}<to pos="0 0 40 mm" in="0.1 s"/>{down}</motion>'
    probe = '<probe name="finger" radius="8 mm" pose-from="arm" force-to="arm"/>'
    text = (
        f'<itouch version="1.0">{_WOOD}<world>{boxes}</world><devices><device name="arm" plugin="usb-arm"/></devices>'
        f'<interaction>{probe}<operator probe="finger">{motion}</operator></interaction></itouch>'
    )
    return loads(text.encode(), Catalog(), shown="bench-tick.xml")


def in_contact(session: Session) -> bool:
    """Run until a finger touches; return whether one does."""

    def touched() -> bool:
        return any(int(session.state[f"{probe.name}.contact.object"]) >= 0 for probe in session.model.probes)

    session.records = False
    session.run(SEARCH, until=touched)
    if not touched():
        return False
    session.run(0.05)
    return True


def durations(session: Session, ticks: int) -> NDArray[np.float64]:
    """Run a number of ticks; return how long each took [s], shape (ticks,)."""
    spent, tick = np.empty(ticks), session.tick
    for index in range(ticks):
        begin = now()
        tick()
        spent[index] = now() - begin
    return spent


def _spent(plan: Plan, session: Session, ticks: int) -> NDArray[np.float64]:
    """Run a plan for a number of ticks; return how long it took in each [s].  The State is put back."""
    kept, spent = session.state.tobytes(), np.empty(ticks)
    for index in range(ticks):
        tick = int(session.state["tick"])
        begin = now()
        plan.run(tick, True)
        spent[index] = now() - begin
        session.state["tick"] = tick + 1
    session.adopt(kept)
    return spent


def beside_the_limit(session: Session, rounds: int) -> tuple[float, float, int]:
    """Return the times [s] of a tick and of its joined steps in one compiled loop, and how many steps the loop misses.

    Both times are medians of the means over short rounds, which take turns; what is done in every tenth tick is in
    both.  A step that is left to Python is missing in the loop, which is counted.
    """
    kept, tick, found, left = session.state.tobytes(), session.tick, np.empty((max(1, rounds), 2)), 0
    for chain in session.plan.chains:
        chain.repeat(0, session.state["tick"].reshape(1))  # compiled now
    for row in found:
        session.adopt(kept)
        tick()  # the first tick after that is Python's, which checks what was adopted
        begin = now()
        for _ in range(ROUND):
            tick()
        row[0] = now() - begin
        session.adopt(kept)
        tick()
        begin = now()
        for chain in session.plan.chains:
            left += chain.repeat(ROUND, session.state["tick"].reshape(1))
        row[1] = now() - begin
    session.adopt(kept)
    whole, compiled = np.median(found, axis=0) / ROUND
    return float(whole), float(compiled), left


def cost_of_a_split(session: Session, ticks: int) -> float:
    """Return the cost [s] of a Python step that does nothing but split the plan: by medians, both plans in turns."""
    steps = list(session.plan.steps)
    inside = next((names for names in session.plan.pieces if len(names) > 1), None)
    at = session.plan.names.index(inside[1]) if inside is not None else len(steps)
    nothing = Step("nothing", lambda tick, ready: None)
    plans = [Plan(steps, session.state), Plan([*steps[:at], nothing, *steps[at:]], session.state)]
    found = np.array([[float(np.median(_spent(plan, session, ticks))) for plan in plans] for _ in range(5)])
    return float(np.median(found[:, 1] - found[:, 0]))


def cost_of_a_fence(session: Session, ticks: int) -> float:
    """Return the cost [s] of remembering and comparing State round a modality: the median of a call of both."""
    fence = WriteGuard([], session.state)
    calls = runner((fence.keep, fence.look))
    found = np.empty(ticks)
    for i in range(ticks):
        begin = now()
        calls()
        found[i] = now() - begin
    return float(np.median(found))


def turns(scene: Scene, rate: float) -> dict[str, float | None]:
    """Return the processor time [s] of the dearest tick of touches that begin, end or change their object; None: none.

    The keys are those of TURNS.  A touch that changes its object ends and begins in one tick.

    Parameters
    ----------
    scene, rate
        The scene, on twins, and the rate of its loop [Hz].
    """
    spent: list[float] = []
    kinds: dict[int, set[int]] = {}
    for _ in range(RUNS):
        session = build(replace(scene, rates=replace(scene.rates, servo=rate)), twin="all")
        session.records = False
        passed, kinds = _passed(session, round(SEARCH * rate))
        spent = [min(pair) for pair in zip(spent, passed, strict=True)] if spent else passed
        session.close()
    found: dict[str, float | None] = dict.fromkeys(TURNS)
    for tick, what in kinds.items():
        for name, wanted in TURNS.items():
            if what & TURNS["changes"] == wanted:
                found[name] = max(found[name] or 0.0, *spent[tick : tick + AFTER])
    return found


def _passed(session: Session, most: int) -> tuple[list[float], dict[int, set[int]]]:
    """Run until touches have ended; return the processor time of each tick [s], and the kinds of event by tick."""
    spent: list[float] = []
    kinds: dict[int, set[int]] = {}
    count, table, seen, rest = session.state["events.count"], session.state["events.table"], 0, most
    session.enable()
    gc.collect()
    gc.freeze()
    gc.disable()  # as while a loop runs in real time
    try:
        while rest > 0:
            begin = processor_time()
            session.tick()
            spent.append(processor_time() - begin)
            rest -= 1
            if count.item() == seen:
                continue
            for number in range(seen, count.item()):
                kinds.setdefault(len(spent) - 1, set()).add(int(table[number % len(table)]["kind"]))
            seen = count.item()
            if sum(what == TURNS["ends"] for what in kinds.values()) == TOUCHES:
                rest = min(rest, AFTER)
    finally:
        gc.enable()
        gc.unfreeze()
    return spent, kinds


def measure(scene: Scene, ticks: int) -> dict[str, Any]:
    """Return the figures of a scene [us].

    Raises
    ------
    ValueError
        If nothing is touched in it.
    """
    session = build(scene, twin="all")
    if not in_contact(session):
        raise ValueError(f"nothing is touched in {SEARCH:g} s of '{scene.source}': bench a scene with a touch")
    spent = durations(session, ticks) * 1e6
    rounds = max(1, min(ticks, 4000) // ROUND)
    whole, compiled, left = beside_the_limit(session, rounds)
    p50, p99 = (float(np.percentile(spent, percent)) for percent in (50, 99))
    return {
        "scene": scene.source,
        "ticks": ticks,
        "tick_us": {"p50": p50, "p99": p99, "mean": float(spent.mean())},
        "real_time": session.model.period * 1e6 / float(spent.mean()),
        "steps": len(session.plan.steps),
        "joined_steps": sum(bool(step.bounds) for step in session.plan.steps),
        "calls": len(session.plan.pieces),
        "round_us": whole * 1e6,
        "compiled_us": compiled * 1e6,
        "left_to_python": left / (rounds * ROUND),
        "split_us": cost_of_a_split(session, min(ticks, 400)) * 1e6,
        "fence_us": cost_of_a_fence(session, min(ticks, 2000)) * 1e6,
    }


def growth(ticks: int) -> Iterator[dict[str, Any]]:
    """Yield p50 of a tick [us] by the number of probes, objects and devices."""
    for name, counts in (("probes", PROBES), ("objects", OBJECTS), ("devices", DEVICES)):
        for count in counts:
            session = build(scene_of(**{name: count}))
            in_contact(session)
            yield {"of": name, "count": count, "p50_us": float(np.median(durations(session, ticks))) * 1e6}


def main(argv: Sequence[str]) -> int:
    """Measure what a tick costs in contact, on twins; exit code 1: a bound is missed."""
    parser = argparse.ArgumentParser(prog="itouch-py bench tick", description=main.__doc__)
    parser.add_argument("--scene", metavar="FILE", help="a scene with a touch; default: a finger on a box")
    parser.add_argument("--ticks", type=int, default=4000, metavar="N", help="how many are measured (default 4000)")
    parser.add_argument("--growth", action="store_true", help="also by numbers of probes, objects and devices")
    parser.add_argument("--json", action="store_true", help="print JSON")
    options = parser.parse_args(argv)
    scene = load_scene(options.scene) if options.scene else scene_of()
    try:
        found = measure(scene, max(10, options.ticks))
    except ValueError as error:
        parser.error(str(error))
    touched = scene if options.scene else sliding()
    found["turns"] = [{"rate_hz": rate, **turns(touched, rate)} for rate in RATES]
    found["growth"] = list(growth(min(options.ticks, 2000))) if options.growth else []
    print(json.dumps(found, indent=1) if options.json else "\n".join(_text(found)))
    return exit_code([is_near(found), is_cheap(found), *map(fits, found["turns"])])


def is_near(found: dict[str, Any]) -> bool | None:
    """Tell whether a tick is near the limit of its compiled steps, if any is, given the figures of ``measure``."""
    return bool(found["round_us"] <= TIMES * found["compiled_us"]) if found["compiled_us"] else None


def is_cheap(found: dict[str, Any]) -> bool:
    """Tell whether a step in plain Python adds no more than it may, given the figures of ``measure``."""
    return bool(found["split_us"] <= SPLIT)


def fits(row: dict[str, Any]) -> bool:
    """Tell whether the dearest ticks of touches fit into the period, given a row of ``turns``."""
    return all(row[name] is None or row[name] <= 1.0 / row["rate_hz"] for name in TURNS)


def _text(found: dict[str, Any]) -> Iterator[str]:
    tick = found["tick_us"]
    yield f"{found['scene']}: {found['ticks']} ticks in contact, on twins, this machine"
    yield f"  tick            p50 {tick['p50']:.1f} us, p99 {tick['p99']:.1f} us: {found['real_time']:.0f} x real time"
    joined = f"{found['joined_steps']} of them compiled"
    yield f"  plan            {found['steps']} steps, {joined}, in {found['calls']} calls from Python"
    limit = found["compiled_us"]
    times, single = ((us / limit if limit else float("inf")) for us in (found["round_us"], tick["p50"]))
    yield f"  compiled steps  {limit:.2f} us in one compiled loop, the limit"
    bound = f"bound {TIMES:g}{_told(is_near(found))}"
    yield f"  the same ticks  {found['round_us']:.2f} us, {times:.1f} x that ({bound}); p50 {single:.1f} x"
    if found["left_to_python"]:
        yield f"                  {found['left_to_python']:.3f} steps a tick are Python's, and missing in the limit"
    split = f"{found['split_us']:.2f} us (bound {SPLIT:g}{_told(is_cheap(found))})"
    yield f"  a Python step   that splits the plan and does nothing costs {split}"
    yield f"  a modality      costs {found['fence_us']:.2f} us besides its own work: a fence, if it is the first"
    for row in found["turns"]:
        dearest = ", ".join(f"{name} {_us(row[name])}" for name in TURNS)
        bound = f"(bound {_us(1.0 / row['rate_hz'])}{_told(fits(row))})"
        yield f"  a touch         at {row['rate_hz'] / 1e3:g} kHz: {dearest}, in its dearest tick {bound}"
    for row in found["growth"]:
        yield f"  {row['count']:>5} {row['of']:<9} p50 {row['p50_us']:.1f} us"


def _told(holds: bool | None) -> str:
    return "" if holds is None or holds else f", {judged(holds)}"


def _us(seconds: float | None) -> str:
    return "-" if seconds is None else f"{seconds * 1e6:.0f} us"
