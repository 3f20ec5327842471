"""``itouch-py calibrate``: measure what a scene's devices need; the dated result is kept beside the scene or rig."""

from __future__ import annotations

import argparse
import datetime
import sys
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from itouch.plugin import Fit, poses
from itouch.schema import ItouchError
from itouch.schema.regular_files import stored_kind
from itouch.schema.terminal import number_of
from itouch.session import calibration
from itouch_tools.cli.arguments import Parser

if TYPE_CHECKING:
    from itouch.session import Session

#: How long [days] a touch-off and a mount fit hold, and how long [s] of simulated time a touch-off may take.
TOUCH_OFF_DAYS, MOUNT_DAYS, LONGEST = 30.0, 180.0, 120.0
_DAY = datetime.timedelta(days=1.0)
#: Pairs of points that fit worse than this (rms) [m] do not belong together; and the ratio of the second to the first
#: singular value up to which points count as lying on a line.
_WORST, _THIN = 5e-3, 4e-4
_PAIRS = ("x [m]", "y [m]", "z [m]", "x there [m]", "y there [m]", "z there [m]")


def main(argv: Sequence[str]) -> int:
    """Calibrate a scene's devices; without options, list what can be calibrated and what is on record."""
    options = _parser().parse_args(argv)
    if stored_kind(options.scene):
        raise ItouchError("calibrate takes a scene: records are kept beside its file")
    if options.kind is None and not options.extend:
        return _list(options)
    if options.extend:
        return _extend(options)
    device = _device(options)
    path = _path(options, device)
    calibration.check_place(path)
    if options.kind == "touch-off":
        record = _touch_off(options, device)
    else:
        record = (_mount_fit if options.kind == "mount-fit" else _fit)(options, device)
        _tell(record)  # first: it took work to measure, and the disk may refuse it
    calibration.store(path, record)
    print(f"written to {path}, holds until {record.expires[:10]}")
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = Parser(prog="itouch-py calibrate", description=main.__doc__)
    parser.add_argument("scene", metavar="SCENE.xml")
    parser.add_argument(
        "--rig", metavar="RIG.xml", help="the devices of another rig file; their records are kept beside it"
    )
    parser.add_argument("--device", metavar="NAME", help="the device; default: the only one that has this calibration")
    parser.add_argument("--kind", metavar="KIND", help="touch-off, mount-fit, or one that the device offers")
    parser.add_argument(
        "--samples", metavar="FILE.csv", help="measured numbers, one sample a line; - reads the terminal"
    )
    parser.add_argument("--to", metavar="NAME", help="mount-fit: the device whose frame the second points are in")
    parser.add_argument(
        "--twin", metavar="all|none|NAME", help="calibrate twins, or hardware, instead of what the scene says"
    )
    parser.add_argument("--days", type=float, metavar="N", help="how long the result holds")
    parser.add_argument("--doubted", action="store_true", help="keep a result although the samples contradict it")
    parser.add_argument("--extend", action="store_true", help="declare that expired records still hold")
    return parser


def _session(options: argparse.Namespace) -> Session:
    from itouch.session import build

    scene, catalog = _scene(options)
    return build(scene, catalog=catalog)


def _scene(options: argparse.Namespace) -> Any:
    """Return the scene with its calibration records applied, expired ones too, and the catalog of plugins.

    A new measurement builds on the records in force.
    """
    from itouch.plugin.discovery import Catalog
    from itouch.session import load_scene

    catalog = Catalog()
    scene = load_scene(options.scene, rig=options.rig, twin=options.twin, catalog=catalog, records=False)
    return calibration.calibrated(scene, stale=True), catalog


def _path(options: argparse.Namespace, device: Any) -> Path:
    scene, _ = _scene(options)
    return calibration.stored_in(scene, device)


def _paths(scene: Any) -> list[Path]:
    """Return the files that hold the scene's records, each once."""
    return list(dict.fromkeys([calibration.home_of(scene), *(_stored(scene))]))


def _stored(scene: Any) -> list[Path]:
    return [calibration.stored_in(scene, device) for device in scene.devices]


def _params(device: Any, catalog: Any) -> Any:
    return device.parts[0].params if device.parts else catalog.device(device.plugin).Params()


def _lacks(fit: Fit | None, device: Any, catalog: Any) -> str:
    """Return what a device of this scene lacks for a calibration; empty: nothing."""
    return fit.missing_parameters(_params(device, catalog)) if fit is not None else ""


def _list(options: argparse.Namespace) -> int:
    scene, catalog = _scene(options)
    for element in scene.devices:
        for kind, fit in sorted(calibration.offered(element, catalog).items()):
            if lack := _lacks(fit, element, catalog):
                print(f"{element.name}  no {kind}: {lack}")
                continue
            doc = fit.doc if fit is not None else _DOCS[kind]
            print(f"{element.name}  --kind {kind}\n    {doc}")
            print(f"    samples: {', '.join(fit.columns if fit is not None else _COLUMNS[kind]) or 'none'}")
    records = [record for path in _paths(scene) for record in calibration.read_records(path)]
    for record in records:
        _tell(record)
    if not records:
        print("no records")
    for note in scene.notes:
        print(note)
    return 0


_DOCS = {
    "touch-off": "runs the scene until the plate was felt, and keeps the height that it found",
    "mount-fit": "touch the same points with this device and another: how both frames lie to each other",
}
_COLUMNS: dict[str, tuple[str, ...]] = {"touch-off": (), "mount-fit": _PAIRS}


def _tell(record: calibration.CalibrationRecord) -> None:
    now = calibration.now()
    state = " EXPIRED" if record.stale(now) else " (IN THE FUTURE)" if record.early(now) else ""
    what = ", ".join(f"{name} = {value:.6g}" for name, value in record.values.items())
    if record.mount:
        x, y, z = (value * 1e3 for value in record.mount[:3])
        what = f"mount at {x:.3f} {y:.3f} {z:.3f} mm"
    whose = "twin" if record.twin else "hardware"
    print(f"{record.device} ({whose}) {record.kind} of {record.made[:10]}, until {record.expires[:10]}{state}: {what}; "
          f"residual {record.residual:.3g} {record.unit} over {record.samples} samples")  # fmt: skip


def _device(options: argparse.Namespace) -> Any:
    scene, catalog = _scene(options)
    able = [e for e in scene.devices if options.kind in calibration.offered(e, catalog)]
    if options.device is not None:
        able = [e for e in able if e.name == options.device]
    if len(able) == 1:
        return able[0]
    names = ", ".join(e.name for e in scene.devices)
    if not able:
        raise ItouchError(f"no device has a calibration '{options.kind}' (devices: {names}); omit --kind to see them")
    raise ItouchError(f"several devices have a calibration '{options.kind}': say which with --device")


def _record(
    options: argparse.Namespace, device: Any, days: float, residual: float, unit: str, samples: int,
    *, values: dict[str, float] | None = None, mount: Iterable[float] = (),
) -> calibration.CalibrationRecord:  # fmt: skip
    made = calibration.now()
    expires = made + (_days(options) or datetime.timedelta(days=days))
    return calibration.CalibrationRecord(
        device.name, options.kind, bool(device.twin), made.isoformat(), expires.isoformat(), values or {},
        tuple(float(v) for v in mount), residual, unit, samples,
    )  # fmt: skip


def _days(options: argparse.Namespace) -> datetime.timedelta | None:
    """Return how long a result is to hold, if ``--days`` says so."""
    if options.days is None:
        return None
    if not 0.0 < options.days <= 3650.0:
        raise ItouchError(f"--days {options.days:g} is out of range: more than 0, at most 3650")
    return datetime.timedelta(days=options.days)


def _samples(options: argparse.Namespace, columns: tuple[str, ...]) -> NDArray[np.float64]:
    """Read the samples, shape (n, columns); a first line of words is a heading."""
    if options.samples is None:
        raise ItouchError(f"write the samples to a file and give it as --samples: columns {', '.join(columns)}")
    try:
        if options.samples == "-":
            print(f"one sample a line ({', '.join(columns)}), an empty line or end of input ends:", file=sys.stderr)
            lines = [line for line in iter(sys.stdin.readline, "") if line.strip()]
        else:
            with open(options.samples, encoding="utf-8") as stream:
                lines = [line for line in stream if line.strip() and not line.startswith("#")]
    except (OSError, UnicodeDecodeError) as error:
        raise ItouchError(f"samples '{options.samples}' cannot be read: {error}") from error
    rows = [line.replace(",", " ").replace(";", " ").split() for line in lines]
    if rows and not _number(rows[0][0]):
        rows = rows[1:]
    for number, row in enumerate(rows, 1):
        if len(row) != len(columns) or not all(_number(word) for word in row):
            raise ItouchError(f"sample {number} is '{' '.join(row)}', not {len(columns)} numbers: {', '.join(columns)}")
    return np.array([[float(word) for word in row] for row in rows]).reshape(-1, len(columns))


def _number(word: str) -> bool:
    try:
        return bool(np.isfinite(float(word)))
    except ValueError:
        return False


def _fit(options: argparse.Namespace, device: Any) -> calibration.CalibrationRecord:
    _, catalog = _scene(options)
    fit = calibration.offered(device, catalog)[options.kind]
    if fit is None:
        raise ItouchError(f"'{options.kind}' is not a calibration of device '{device.name}'")
    if lack := _lacks(fit, device, catalog):
        raise ItouchError(f"calibration '{options.kind}': {lack}")
    samples = _samples(options, fit.columns)
    try:
        found = fit.solve(_params(device, catalog), samples)
    except ValueError as error:
        raise ItouchError(f"calibration '{options.kind}': {error}") from error
    for doubt in found.doubts:
        print(f"warning: {doubt}", file=sys.stderr)
    if found.doubts and not options.doubted:
        lead = f"calibration '{options.kind}' is doubted, and nothing is kept: {found.doubts[0]}"
        raise ItouchError(f"{lead}; measure again, or say with --doubted that it is right")
    return _record(options, device, fit.valid_days, found.residual, found.unit, len(samples), values=dict(found.values))


def _touch_off(options: argparse.Namespace, device: Any) -> calibration.CalibrationRecord:
    """Run until the rig is calibrated, tell what mount was found, and return the record of it."""
    from itouch.loop import DeviceFaultError
    from itouch_tools.viewer.fault_messages import outcome

    session = _session(options)
    with session:
        session.enable()
        try:
            session.run(LONGEST, until=lambda: bool(session.state["ready"]))
        except DeviceFaultError as fault:
            for line in outcome(session.statistics.faults[-1]):
                fault.add_note(line)
            raise
        if not session.state["ready"]:
            raise ItouchError(f"touch-off of '{device.name}' did not end within {LONGEST:g} s")
        if session.model.devices[device.name].touch_off == 0:
            raise ItouchError(f"device '{device.name}' has no <calibration method=\"touch-off\"/> in the scene")
        found = np.array(session.state[f"{device.name}.calibration"])
        offsets = np.array(session.state[f"{device.name}.touch_off.offsets"])
        current = next(e for e in session.scene.devices if e.name == device.name)
        mount = poses.compose(np.array(calibration.mount_pose(current.mount)), found)
        residual = float(np.std(offsets)) * 1e3
        record = _record(options, device, TOUCH_OFF_DAYS, residual, "mm", len(offsets), mount=mount)
        _tell(record)  # while the devices are still open: one may fail when it is closed
    return record


def _mount_fit(options: argparse.Namespace, device: Any) -> calibration.CalibrationRecord:
    """Fit the device's mount to pairs of points, by least squares over rotations and translations."""
    scene, _ = _scene(options)
    others = {e.name: e for e in scene.devices if e.name != device.name}
    if options.to is None or options.to not in others:
        raise ItouchError(f"mount-fit: say with --to in whose frame the second points are: {', '.join(others)}")
    samples = _samples(options, _PAIRS)
    try:
        relation, residual = rigid(samples[:, :3], samples[:, 3:])
    except ValueError as error:
        raise ItouchError(f"calibration 'mount-fit': {error}") from error
    mount = poses.compose(np.array(calibration.mount_pose(others[options.to].mount)), relation)
    return _record(options, device, MOUNT_DAYS, residual * 1e3, "mm", len(samples), mount=mount)


def rigid(here: NDArray[np.float64], there: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
    """Return the pose that takes points (n, 3) [m] to their partners, and the rms distance left [m] (Kabsch 1976).

    Raises
    ------
    ValueError
        If there are fewer than three pairs, if all lie on a line, or if no rigid motion takes one set to the other.
    """
    if len(here) < 3:
        raise ValueError(f"{len(here)} pairs of points are too few: three or more")
    a, b = here - here.mean(axis=0), there - there.mean(axis=0)
    left, sizes, right = np.linalg.svd(a.T @ b)
    if sizes[1] <= _THIN * sizes[0]:
        raise ValueError("the points lie on a line, or nearly: spread them")
    turn = right.T @ np.diag([1.0, 1.0, np.sign(np.linalg.det(right.T @ left.T))]) @ left.T
    shift = there.mean(axis=0) - turn @ here.mean(axis=0)
    rest = there - here @ turn.T - shift
    left_over = float(np.sqrt(np.mean(np.sum(rest * rest, axis=1))))
    if left_over > _WORST:
        raise ValueError(
            f"even at best the pairs lie {left_over * 1e3:.3g} mm (rms) apart: "
            "are they in metres and in the same order, and is no axis reversed?"
        )
    return np.concatenate([shift, _quaternion(turn)]), left_over


def _quaternion(turn: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the unit quaternion of a rotation matrix: the eigenvector of Bar-Itzhack's matrix."""
    (a, b, c), (d, e, f), (g, h, i) = turn
    k = np.array([
        [a + e + i, h - f, c - g, d - b],
        [h - f, a - e - i, b + d, c + g],
        [c - g, b + d, e - a - i, f + h],
        [d - b, c + g, f + h, i - a - e],
    ])  # fmt: skip
    quaternion: NDArray[np.float64] = np.linalg.eigh(k)[1][:, -1]
    return quaternion if quaternion[0] >= 0.0 else -quaternion


def _extend(options: argparse.Namespace) -> int:
    """Let records that have expired, or are of the future, hold again, for ``--days`` or as long as they did before."""
    scene, _ = _scene(options)
    longer, now, changed = _days(options), calibration.now(), 0
    for path in _paths(scene):
        records, before = list[calibration.CalibrationRecord](), calibration.read_records(path)
        for record in before:
            meant = options.device in (None, record.device) and options.kind in (None, record.kind)
            if meant and (record.stale(now) or record.early(now)):
                made, expires = (datetime.datetime.fromisoformat(text) for text in (record.made, record.expires))
                dated = now.isoformat() if record.early(now) else record.made  # when it was made is not known
                until = now + (longer or max(_DAY, expires - made))
                record = replace(record, made=dated, expires=until.isoformat())
                changed += 1
                _tell(record)
            records.append(record)
        if records != before:
            calibration.write_records(path, records)
    print(f"{number_of(changed, 'record')} extended")
    return 0
