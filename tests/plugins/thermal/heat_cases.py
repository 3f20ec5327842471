"""Solved cases and random ones for the tests of the contact-heat solver."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

FOLDER = Path(__file__).parent / "cases"
SOLVED = sorted(path.stem for path in FOLDER.glob("*.json"))


def solved(name: str) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Return a case and the columns of its solution."""
    text = (FOLDER / f"{name}.csv").read_text()
    rows = np.loadtxt(text.splitlines(), delimiter=",", skiprows=1)
    return json.loads((FOLDER / f"{name}.json").read_text()), dict(
        zip(text.splitlines()[0].split(","), rows.T, strict=True)
    )


def random_case(seed: int) -> dict[str, Any]:
    """Return a case with 1 to 16 layers a side, 1 um to 50 mm thick, foam to copper, any back and start."""
    rng = np.random.default_rng(seed)
    case = {"finger": _side(rng, finger=True), "object": _side(rng, finger=False)}
    case["Rth"] = 0.0 if rng.random() < 0.3 else _log(rng, 1e-6, 1e-2)
    case["probes"] = [_probe(rng, case, n) for n in range(3)]
    return case


def _log(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _layer(rng: np.random.Generator, finger: bool) -> dict[str, Any]:
    layer = {
        "L": _log(rng, 1e-6, 0.05),
        "k": _log(rng, 0.02, 400),
        "rho": _log(rng, 20, 9000),
        "c": _log(rng, 300, 4200),
    }
    if finger and rng.random() < 0.7:
        layer["w"] = _log(rng, 500, 5e4)
    return layer


def _side(rng: np.random.Generator, *, finger: bool) -> dict[str, Any]:
    layers = [_layer(rng, finger) for _ in range(int(rng.choice([1, 1, 2, 3, 5, 16])))]
    temperature = float(rng.uniform(-10, 80))
    held = 37.0 if finger else temperature
    side: dict[str, Any] = {"layers": layers, "T_art": 37.0} if finger else {"layers": layers}
    kind = str(rng.choice(["temperature", "convection", "insulated", "endless"]))
    if kind == "endless":
        layers[-1]["L"] = None
    elif kind == "insulated":
        side["back"] = {"type": kind}
    else:
        side["back"] = {"type": kind, "T": held} | ({"h": _log(rng, 1, 1e3)} if kind == "convection" else {})
    anchored = kind in ("temperature", "convection") or any("w" in layer for layer in layers)
    draw = rng.random()
    if draw < 0.4 or not anchored:
        side["initial"] = {
            "type": "uniform",
            "T": float(rng.uniform(20, 40)) if finger else temperature + 5 * (draw > 0.2),
        }
    elif draw < 0.8:
        side["initial"] = {"type": "steady", "h": _log(rng, 1, 50), "T_amb": float(rng.uniform(-10, 40))}
    else:
        side["initial"] = {"type": "steady", "T_surface": float(rng.uniform(25, 36))}
    return side


def _probe(rng: np.random.Generator, case: dict[str, Any], number: int) -> dict[str, Any]:
    side = str(rng.choice(["finger", "object"]))
    depth = sum(0.05 if layer["L"] is None else layer["L"] for layer in case[side]["layers"])
    return {
        "name": f"p{number}",
        "side": side,
        "depth": float(rng.uniform(0, depth)),
        "what": str(rng.choice(["T", "j"])),
    }
