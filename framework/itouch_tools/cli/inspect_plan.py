"""``itouch-py inspect SCENE --plan``: the steps of a tick, what each reads and writes, and what it costs here."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from itouch.session import Session

#: Simulated time [s] for which the scene runs on twins to measure what the steps cost.
SECONDS = 3.0


def plan_facts(path: str) -> dict[str, Any]:
    """Return the plan of a scene, what its steps cost on this machine [us], and what stopped it meanwhile, if it was.

    Raises
    ------
    SceneError
        If the scene has problems.
    """
    from itouch.loop import DeviceFaultError
    from itouch.session import build

    session = build(path, twin="all")
    session.records = False
    rows = [_row(session, step) for step in session.plan.steps]
    stopped = None
    try:
        session.run(SECONDS)
    except DeviceFaultError as fault:  # its plan is as it was; a scene may be there to show a fault
        stopped = str(fault)
    session.close()
    costs = session.times.split()
    for row in rows:
        row["cost_us"] = {name: costs[row["step"]][name] for name in ("p50", "p99")}
    return {
        "kind": "plan",
        "file": path,
        "servo_hz": session.model.scene.rates.servo,
        "steps": rows,
        "writers": session.plan.writers,
        "ticks": session.times.ticks,
        "tick_us": session.times.summary(),
        **({"stopped": stopped} if stopped else {}),
    }


def _row(session: Session, step: Any) -> dict[str, Any]:
    rate = 1.0 / (step.every * session.model.period)
    reads = None if step.reads is None else list(step.reads)
    return {
        "step": step.name,
        "rate_hz": round(rate, 6),
        "code": step.code,
        "reads": reads,
        "writes": list(step.writes),
        **({"amends": list(step.amends)} if step.amends else {}),
    }


def plan_text(facts: dict[str, Any]) -> list[str]:
    """Return the plan as lines for people."""
    if not facts["steps"]:
        return [f"{facts['file']}: a tick has no steps, because the scene has no device and no modality"]
    wide = max(len(row["step"]) for row in facts["steps"])
    count = len(facts["steps"])
    lines = [f"{facts['file']}: {f'the {count} steps' if count > 1 else 'the only step'} of a tick, in order, on twins"]
    lines.append(f"  {'step':<{wide}}  {'Hz':>6}  {'code':<13}  p50 us  p99 us")
    for row in facts["steps"]:
        cost = "  ".join("     -" if us is None else f"{us:6.1f}" for us in row["cost_us"].values())
        lines.append(f"  {row['step']:<{wide}}  {row['rate_hz']:>6g}  {row['code']:<13}  {cost}")
        for verb in ("reads", "writes"):
            lines += _wrapped(verb, row[verb])
        lines += _wrapped("amends", row.get("amends", []))
    whole = facts["tick_us"]
    if whole["p50"] is not None:
        lines.append(
            f"  a whole tick: p50 {whole['p50']:.1f} us, p99 {whole['p99']:.1f} us, of {facts['ticks']} on this machine"
        )
    if "stopped" in facts:
        lines.append(f"  measured until the scene stopped: {facts['stopped']}")
    return lines


def _wrapped(verb: str, names: list[str] | None, width: int = 110) -> list[str]:
    """Return the names of fields, wrapped into lines that fit a terminal."""
    if not names:
        return [] if names is not None else [f"      {verb:<6} (not said by the plugin)"]
    lines, line = [], f"      {verb:<6}"
    for name in names:
        if len(line) + 1 + len(name) > width:
            lines.append(line)
            line = " " * 12
        line += f" {name}"
    return [*lines, line]
