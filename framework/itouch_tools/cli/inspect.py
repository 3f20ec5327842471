"""``itouch-py inspect FILE``: what a scene, a session or a recording holds."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from itouch.schema import ItouchError
from itouch.schema.regular_files import stored_kind
from itouch.schema.wait_notices import waiting
from itouch_tools.cli.arguments import Parser, add_json
from itouch_tools.cli.inspect_plan import plan_facts, plan_text
from itouch_tools.cli.output_files import picture_file
from itouch_tools.cli.progress import measured

Facts = dict[str, Any]


def main(argv: Sequence[str]) -> int:
    """Say what a scene, a session or a recording holds."""
    parser = Parser(prog="itouch-py inspect", description=main.__doc__)
    parser.add_argument("file", metavar="FILE", help="a scene (.xml), a session (.itouch) or a recording (.mcap)")
    add_json(parser)
    parser.add_argument("--picture", type=picture_file, metavar="FILE.png", help="draw a scene before anything runs")
    parser.add_argument("--plan", action="store_true", help="the steps of a tick of a scene, and what they cost here")
    options = parser.parse_args(argv)
    if options.picture:
        with waiting(f"drawing {options.file}"):
            _draw(options.file, options.picture)
    with measured(f"measuring {options.file}") if options.plan else waiting(f"reading {options.file}"):
        facts = _plan(options.file) if options.plan else _facts(options.file)
    if options.json:
        print(json.dumps(facts, indent=1))
    else:
        print("\n".join(plan_text(facts) if options.plan else _text(facts)))
    return 0


def _plan(path: str) -> Facts:
    """Return the plan of the scene in a file.

    Raises
    ------
    ItouchError
        If the file is not a scene.
    """
    from itouch.session import is_session

    if is_session(path):
        raise ItouchError("--plan shows the steps of a scene (.xml); a session or a recording has none of its own")
    return plan_facts(path)


def _draw(path: str, picture: str) -> None:
    """Draw a scene, or a session in the State in which it was saved, to a PNG file."""
    from itouch.session import build, is_session, restore
    from itouch_tools.viewer.context import write_png
    from itouch_tools.viewer.offscreen import Offscreen

    if stored_kind(path) == "recording":
        raise ItouchError("--picture draws a scene or a session; `itouch-py report` draws a recording")
    session = restore(path, opens=False) if is_session(path) else build(path)
    shots = Offscreen(session.model)
    shots.picture.choices.curves = False
    write_png(picture, shots.shoot(session.state))
    shots.close()


def _facts(path: str) -> Facts:
    from itouch.session import is_session

    if stored_kind(path) == "recording":
        return recording_facts(path)
    return session_facts(path) if is_session(path) else scene_facts(path)


def recording_facts(path: str) -> Facts:
    """Return the contents of a recording.

    Raises
    ------
    RecordingError
        If it can't be read.
    """
    from itouch.recording import read
    from itouch_tools.export.contacts import contacts_of

    found = read(path)
    manifest = found.session.get("manifest", {})
    channels = [
        {"track": t.name, "channel": c.name, "size": max(1, c.size), "unit": c.unit or "1",
         "rate_hz": 1.0 / (t.every * found.period), "samples": len(found[t.name])}
        for t in found.tracks.values() for c in t.columns
    ]  # fmt: skip
    return {
        "kind": "recording",
        "file": path,
        "scene": manifest.get("source"),
        "begin": _utc(int(found.session["start_ns"]) * 1e-9 + _first(found.ticks) * found.period),
        "seconds": found.duration,
        "ticks": len(found.ticks),
        "first_tick": _first(found.ticks),
        "whole": found.whole,
        "losses": list(found.losses),
        "versions": {"itouch-py": manifest.get("itouch-py"), **manifest.get("plugins", {})},
        "git": manifest.get("git"),
        "seed": manifest.get("seed"),
        "twins": manifest.get("twins"),
        "host": manifest.get("host"),
        "channels": channels,
        "meanings": found.meanings,
        "contacts": [c._asdict() for c in contacts_of(found)],
        "marks": found.marks,
        "faults": found.faults,
        "timing": _figures(found.timing[-1]) if found.timing else None,
    }


def _figures(timing: Mapping[str, Any]) -> Facts:
    """Return the figures of a recorded note on timing, without its histograms."""
    return {name: value for name, value in timing.items() if not isinstance(value, list)}


def _first(ticks: Any) -> int:
    return int(ticks[0]) if len(ticks) else 0


def _utc(seconds: float) -> str:
    from datetime import UTC, datetime

    return datetime.fromtimestamp(seconds, UTC).isoformat(timespec="milliseconds")


def session_facts(path: str) -> Facts:
    """Return the contents of a snapshot.

    Raises
    ------
    SessionError
        If it can't be read.
    """
    from itouch.plugin.discovery import Catalog
    from itouch.session.open import read_session

    found = read_session(path, Catalog())
    manifest, record = found.manifest, found.state[0]
    period = 1.0 / found.scene.rates.servo
    statuses = ("CLOSED", "OPEN", "ENABLED", "FAULT")
    return {
        "kind": "session",
        "file": path,
        "format": manifest.get("format"),
        "scene": manifest.get("source"),
        "tick": int(record["tick"]),
        "seconds": int(record["tick"]) * period,
        "seed": manifest.get("seed"),
        "versions": {"itouch-py": manifest.get("itouch-py"), **manifest.get("plugins", {})},
        "git": manifest.get("git"),
        "host": manifest.get("host"),
        "devices": {
            device.name: {"twin": device.twin, "status": statuses[int(record[f"{device.name}.status"]) % 4]}
            for device in found.scene.devices
            if f"{device.name}.status" in (found.state.dtype.names or ())
        },
        "calibration": manifest.get("calibration"),
        "files": manifest.get("files", {}),
        "bases": len(found.bases),
        "state_bytes": found.state.dtype.itemsize,
        "contacts": [_span(contact) for contact in found.ledger.get("contacts", [])],
        "faults": found.ledger.get("faults", []),
    }


def _span(contact: Facts) -> Facts:
    return {
        "probe": contact["probe"],
        "object": contact["object"],
        "begin": contact["begin_s"],
        "end": contact["end_s"],
    }


def scene_facts(path: str) -> Facts:
    """Return the contents of a scene, and the channels that can be recorded.

    Raises
    ------
    SceneError
        If the scene has problems.
    """
    from itouch.plugin.discovery import Catalog
    from itouch.session import load_scene
    from itouch.session.row_layout import recordable
    from itouch.world import Model, declared, make_state

    catalog = Catalog()
    model = Model.of(load_scene(path, catalog=catalog), catalog)
    state = make_state(model)
    return {
        "kind": "scene",
        "file": path,
        "servo_hz": model.scene.rates.servo,
        "objects": {o.name: {"kind": type(o).__name__.lower(), "material": o.material} for o in model.scene.objects},
        "devices": {d.name: {"plugin": d.plugin, "twin": d.twin} for d in model.devices.values()},
        "modalities": {m.name: {"plugin": m.plugin, "commands": list(m.commands)} for m in model.modalities},
        "state_bytes": state.nbytes,
        "channels": [
            {"channel": name, "size": int(state[name].size), "unit": field.unit, "meaning": field.doc}
            for name, field in declared(model).items()
            if recordable(state, name)
        ],
        "notices": list(model.notices),
    }


def _text(facts: Facts) -> list[str]:
    """Return the facts as lines for people."""
    lines = [f"{facts['file']}: {facts['kind']}"]
    for key, value in facts.items():
        if key in ("file", "kind", "meanings") or value in (None, [], {}):
            continue
        writer = _WRITERS.get(key)
        lines += writer(value) if writer is not None else [f"  {key.replace('_', ' '):<12} {_short(value)}"]
    return lines


def _short(value: Any) -> str:
    if isinstance(value, dict):
        told = {name: item for name, item in value.items() if item not in (None, [], {}, "")}
        return ", ".join(
            f"{name} ({_short(item)})" if isinstance(item, dict) else f"{name} {_short(item)}"
            for name, item in told.items()
        )
    if isinstance(value, list):
        return " ".join(_short(item) for item in value)
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _channels(rows: list[Facts]) -> list[str]:
    lines = ["  channels"]
    for row in rows:
        name = f"{row['track']}.{row['channel']}" if "track" in row else row["channel"]
        rate = f"  {row['rate_hz']:g} Hz, {row['samples']} samples" if "rate_hz" in row else ""
        meaning = f"  {row['meaning']}" if row.get("meaning") else ""
        lines.append(f"    {name:<34} {row['size']:>3} x {row['unit']:<10}{rate}{meaning}".rstrip())
    return lines


def _contacts(rows: list[Facts]) -> list[str]:
    lines = ["  contacts"]
    for row in rows:
        end = "open" if row["end"] is None else f"{row['end']:.3f} s"
        lines.append(f"    {row['probe']} on {row['object']}: {row['begin']:.3f} s to {end}")
    return lines


def _listed(title: str, *names: str) -> Callable[[list[Facts]], list[str]]:
    def write(rows: list[Facts]) -> list[str]:
        lines = [f"  {title}"]
        for row in rows:
            when = row.get("time", row.get("time_s", 0.0))
            lines.append(f"    {when:.3f} s: " + " ".join(str(row.get(name, "")) for name in names))
        return lines

    return write


def _sentences(rows: list[str]) -> list[str]:
    return [f"  missing      {row}" for row in rows]


_WRITERS: dict[str, Callable[[Any], list[str]]] = {
    "channels": _channels,
    "contacts": _contacts,
    "marks": _listed("marks", "name", "payload"),
    "faults": _listed("faults", "device", "cause"),
    "losses": _sentences,
}
