"""What lets a session be restored and continue bit for bit: State is complete, and equal seeds give equal bytes."""

from __future__ import annotations

import hashlib
import json
import random
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from itouch.testing.checks import CheckError, NotApplicableError, check
from itouch.testing.child_process import Ending, apart
from itouch.testing.harness import DeviceHarness, TwinBench
from itouch.testing.reproducibility import other_seed, said, script

#: Ticks before and after a restore.
_BEFORE, _AFTER = 337, 900
_LIMIT = 30.0


def _fail(seen: str, cause: str, advice: str) -> CheckError:
    return CheckError(seen, cause=cause, advice=advice)


@check("state-declared", "everything that changes is in State")
def state_declared(harness: DeviceHarness) -> None:
    """Continue from a copy of State: beside the first twin, in a process that knows nothing of it, with new objects."""
    _beside(harness)
    _in_another_process(harness)
    _with_new_objects(harness)


def _beside(harness: DeviceHarness) -> None:
    """Continue with another twin beside the first one, in step."""
    bench, other = harness.bench(seed=3), harness.bench(seed=99)
    bench.step(_BEFORE)
    other.state.raw[:], other.reading.raw[:] = bench.state.raw, bench.reading.raw
    other.start, other.tick = bench.start, bench.tick
    before = attributes(bench.twin)
    for tick in range(300):
        bench.step()
        other.step()
        _compare(bench, other, f"a restored twin continues differently after {tick + 1} ticks")
    changed = [name for name, value in attributes(bench.twin).items() if before.get(name, value) != value]
    if changed:
        raise _fail(
            f"the twin's attribute {', '.join(changed)} changes while it runs",
            "State outside of State",
            "declare a field for it",
        )


def _compare(bench: TwinBench, other: TwinBench, what: str) -> None:
    if bench.state.tobytes() == other.state.tobytes() and bench.reading.tobytes() == other.reading.tobytes():
        return
    names = [n for n in bench.state if bench.state[n].tobytes() != other.state[n].tobytes()] or ["the reading"]
    raise _fail(
        f"{what}, first in {', '.join(names[:3])}",
        "something that changes is kept in an attribute, a global, a file or a generator of its own",
        "declare it in fields() and keep it in state; random words come from State",
    )


def _in_another_process(harness: DeviceHarness) -> None:
    """Continue in one child process, and from its State in another one that knows nothing of the first."""
    straight = _child(lambda: _straight(harness))
    told = json.loads(straight.value)
    held = [bytes.fromhex(told[name]) for name in ("state", "reading")]
    restored = json.loads(_child(lambda: _restored(harness, *held)).value)
    for tick, (ours, theirs) in enumerate(zip(told["after"], restored["after"], strict=True)):
        if ours != theirs:
            raise _fail(
                f"a twin that is restored in a new process continues differently after {10 * (tick + 1)} ticks",
                "something that changes is kept in a global, in the class, in a variable of a function, or in a file",
                "declare it in fields() and keep it in state; random words come from State",
            )


def _child(work: Callable[[], bytes]) -> Ending:
    ending = apart(work, _LIMIT)
    if ending.kind != "returned":
        raise _fail(ending.text, "the twin does not work in a child process", "find out what it needs from the process")
    return ending


def _straight(harness: DeviceHarness) -> bytes:
    scatter(1)
    bench = harness.bench(seed=3)
    bench.step(_BEFORE)
    told = {"state": bench.state.tobytes().hex(), "reading": bench.reading.tobytes().hex()}
    return json.dumps({**told, "after": _prints(bench)}).encode()


def _restored(harness: DeviceHarness, state: bytes, reading: bytes) -> bytes:
    start = harness.bench(seed=3).start
    scatter(2)
    bench = harness.bench(seed=99)
    bench.state.raw[:], bench.reading.raw[:] = np.frombuffer(state, np.uint8), np.frombuffer(reading, np.uint8)
    bench.start, bench.tick = start, _BEFORE
    return json.dumps({"after": _prints(bench)}).encode()


def _prints(bench: TwinBench) -> list[str]:
    found = []
    for _ in range(_AFTER // 10):
        bench.step(10)
        found.append(fingerprint(bench))
    return found


def scatter(number: int) -> None:
    """Change what does not come from the seed: the random generators of the process, and its clocks."""
    random.seed(number)
    np.random.seed(number)
    for name in ("time", "monotonic", "perf_counter"):
        for suffix, scale in (("", 1.0), ("_ns", 1e9)):
            clock, later = getattr(time, name + suffix), type(scale)(number * 86_461.7 * scale)
            setattr(time, name + suffix, lambda clock=clock, later=later: clock() + type(clock())(later))


def fingerprint(bench: TwinBench) -> str:
    """Return a short hash of State and reading."""
    return hashlib.sha256(bench.state.tobytes() + bench.reading.tobytes()).hexdigest()[:16]


def _with_new_objects(harness: DeviceHarness) -> None:
    """Continue with a new twin object in every tick, for as many ticks as fit into two seconds."""
    bench, lone = harness.bench(seed=3), harness.bench(seed=3)
    begin = time.perf_counter()
    for tick in range(200):
        bench.step()
        fresh = harness.bench(seed=50)
        fresh.state.raw[:], fresh.reading.raw[:] = lone.state.raw, lone.reading.raw
        fresh.start, fresh.tick = lone.start, lone.tick
        fresh.be_safe()
        fresh.step()
        lone.state.raw[:], lone.reading.raw[:] = fresh.state.raw, fresh.reading.raw
        lone.tick += 1
        _compare(bench, lone, f"with a new twin object in every tick it behaves differently after {tick + 1} ticks")
        if time.perf_counter() - begin > 2.0:
            return


def attributes(thing: Any) -> dict[str, str]:
    """Return the attributes with plain values; lists and arrays may be scratch, and their effects show elsewhere."""
    found = {}
    names = [*getattr(thing, "__dict__", {}), *(slot for cls in type(thing).__mro__ for slot in _slots(cls))]
    for name in names:
        value = getattr(thing, name, None)
        if name != "params" and isinstance(value, (bool, int, float, complex, str, bytes)):
            found[name] = repr(value)
    return found


def _slots(cls: type) -> tuple[str, ...]:
    slots = cls.__dict__.get("__slots__", ())
    return (slots,) if isinstance(slots, str) else tuple(slots)


@check("determinism", "equal seeds give equal bytes")
def determinism(harness: DeviceHarness) -> str:
    """Run one twin alone, then two side by side, then one in another interpreter."""
    alone = harness.bench(seed=5)
    alone.step(400)
    one, two = harness.bench(seed=5), harness.bench(seed=6)
    for _ in range(400):
        one.step()
        two.step(2)
    if fingerprint(one) != fingerprint(alone):
        raise _fail(
            "a second run, beside another instance, gives other bytes",
            "a shared global, the clock, or random numbers that the seed does not decide",
            "keep everything in State, and draw from the rng that reset() gets",
        )
    try:
        theirs = said(script(harness, f"{__name__}:run_alone"), seed=other_seed())
    except NotApplicableError:
        return "within this process"
    if theirs != fingerprint(alone):
        raise _fail(
            "the same run gives other bytes in another process",
            "hash() of a text, the order of a set, id(), the process's number, or random numbers of its own",
            "keep everything in State, and draw from the rng that reset() gets",
        )
    return "in two processes"


def run_alone(harness: DeviceHarness) -> str:
    """Return the fingerprint of the run with which `determinism` compares."""
    bench = harness.bench(seed=5)
    bench.step(400)
    return fingerprint(bench)
