"""``itouch-py bench contact``: what a step of contact costs, compared with libraries that a Python user might take."""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from itouch.contact import Proxy, Surface
from itouch.plugin.commands import exit_code
from itouch.schema import ItouchError
from itouch_evidence.contact.contact_workload import HEIGHT_FIELD_CELLS, Work, around, standard
from itouch_evidence.contact.measure import CHUNK, Row, building, closest_row, peer_row, proxy_rows
from itouch_evidence.contact.peers import PACKAGES, PEERS
from itouch_evidence.contact.step_bounds import Figure, judged
from itouch_tools.cli.arguments import Parser
from itouch_tools.cli.output_files import output_file, write_output

Floats = NDArray[np.float64]
Ints = NDArray[np.int32]

FRICTION = (0.5, 0.3)


def _parser() -> argparse.ArgumentParser:
    parser = Parser(
        prog="itouch-py bench contact",
        description="Measure what a step of contact costs beside what a Python user would pick instead.",
    )
    parser.add_argument("--mesh", type=Path, help="measure on this mesh file in place of the standard surfaces")
    parser.add_argument("--json", type=output_file, help="write the figures to this file too")
    parser.add_argument("--sizes", nargs="+", choices=list(HEIGHT_FIELD_CELLS), default=["10k", "100k", "1M"])
    parser.add_argument("--surfaces", nargs="+", choices=["hf", "ico"], default=["hf", "ico"])
    parser.add_argument("--speed", type=float, default=1.0, help="1: brisk (the default), 0.1: slow exploration")
    parser.add_argument("--steps", type=int, default=4000, help="length of the path [ms]")
    parser.add_argument("--scale", type=float, default=1.0, help="length of one unit of the mesh file [m]")
    parser.add_argument("--no-cache", action="store_true", help="neither use nor keep built hierarchies")
    parser.add_argument("--no-peers", action="store_true", help="leave the other libraries out")
    return parser


def _works(options: argparse.Namespace) -> Iterator[tuple[Work, str]]:
    """Yield the works to measure, each with the size by which its times are judged ("": they are not)."""
    if options.mesh is not None:
        vertices, faces = _read(options)
        yield around(options.mesh.name, vertices, faces, options.steps, options.speed), ""
        return
    for kind in options.surfaces:
        for size in options.sizes:
            judged_size = size if kind == "hf" and options.speed == 1.0 else ""
            yield standard(kind, size, options.steps, options.speed, 0.02), judged_size


def _read(options: argparse.Namespace) -> tuple[Floats, Ints]:
    """Return the triangles of a mesh file, repaired as in a scene; print how long it takes with and without the cache.

    Raises
    ------
    ItouchError
        If it is not a mesh that can be touched.
    """
    from itouch.contact.meshfile import MeshError, load_mesh

    try:
        begin = time.perf_counter()
        mesh = load_mesh(options.mesh, scale=options.scale, use_cache=not options.no_cache)
        first, begin = time.perf_counter() - begin, time.perf_counter()
        if not options.no_cache:
            load_mesh(options.mesh, scale=options.scale)
        again = time.perf_counter() - begin
    except MeshError as error:
        raise ItouchError(str(error)) from error
    for finding in mesh.findings:
        print(f"{finding.severity}: {finding.sentence}")
    how = "from the cache" if mesh.cached else "read, checked and built"
    later = "" if options.no_cache else f", again from the cache {again * 1e3:.0f} ms"
    print(f"{options.mesh.name}: {first * 1e3:.0f} ms {how}{later}")
    return mesh.surface.vertices, mesh.surface.faces


def _rows(work: Work, with_peers: bool) -> tuple[list[Row], list[str]]:
    """Measure one work; return all rows, and why peers are missing."""
    surface, built, memory = building(lambda: Surface(work.vertices, work.faces, work.two_sided))
    rows = [*proxy_rows(surface, work, FRICTION), *proxy_rows(surface, work, (0.0, 0.0))]
    rows.append(closest_row(surface, work, built, max(memory, surface.memory_bytes / 1e6)))
    missing = []
    for name, (peer, most_queries, most_triangles) in PEERS.items() if with_peers else ():
        if len(work.faces) > most_triangles:
            missing.append(f"{name}: not at this size")
            continue
        try:
            rows.append(peer_row(name, peer, work, most_queries))
        except ImportError:
            missing.append(f"{name}: not installed (pip install {PACKAGES[name]})")
        except Exception as reason:  # a peer may refuse a surface, which is no error of the bench
            missing.append(f"{name}: {type(reason).__name__}: {reason}")
    return rows, missing


def _line(row: Row) -> str:
    extra = []
    if row.build_ms is not None:
        extra.append(f"build {row.build_ms:8.1f} ms {row.memory_mb:7.1f} MB")
    if row.locked is not None:
        extra.append(
            f"locked {row.locked}, force in free space {row.force_in_free_space}, through {row.popped_through}"
        )
    if row.error_p99_n is not None:
        extra.append(f"force error p99 {row.error_p99_n:.4f} N")
    return f"  {row.name:<62}{row.p50_us:9.2f}{row.p99_us:10.2f}{row.max_us:10.1f}   {'; '.join(extra)}"


def main(argv: list[str]) -> int:
    """Measure and print; exit code 1: a figure misses its limit."""
    options = _parser().parse_args(argv)
    if options.steps < 2 * CHUNK:
        raise ItouchError(f"--steps {options.steps} is too few; at least {2 * CHUNK} are needed")
    warm = Proxy(Surface(np.eye(3), np.array([[0, 1, 2]])), radius=0.01)
    warm.step((0.0, 0.0, 0.0))
    warm.follow(np.zeros((2, 3)))
    document: list[dict[str, object]] = []
    figures: list[Figure] = []
    packages = " ".join(PACKAGES.values()).split()
    peers = {name: version for name in packages if (version := _version(name))}
    print("installed: " + (", ".join(f"{name} {version}" for name, version in peers.items()) or "no other library"))
    for work, size in _works(options):
        rows, missing = _rows(work, not options.no_peers)
        print(f"{work.name}: {len(work.faces)} triangles, {len(work.hips)} steps, speed {options.speed:g}")
        print(f"  {'us, the best of 3 passes for each step or query':<62}{'p50':>9}{'p99':>10}{'max':>10}")
        print("\n".join(map(_line, rows)))
        print("".join(f"  - {reason}\n" for reason in missing), flush=True)
        figures += judged(work.name, size, rows, smooth=options.mesh is None)
        document.append(
            {
                "name": work.name,
                "triangles": len(work.faces),
                "steps": len(work.hips),
                "speed": options.speed,
                "rows": [row.as_dict() for row in rows],
                "missing": missing,
            }
        )
    print("\n".join(["figures to reach", *(figure.line() for figure in figures)]))
    if options.json is not None:
        judgements = [figure.as_dict() for figure in figures]
        text = json.dumps({"contact": document, "figures": judgements, "peers": peers}, indent=1)
        write_output(options.json, text)
    return exit_code(figure.passed for figure in figures)


def _version(package: str) -> str:
    """Return the version of an installed package, or nothing."""
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return ""
