"""The paper's figures 2-7, 9, 10 and 11, recomputed: same quantities and order; nothing is overlaid from the paper."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from itouch.plugin import Field, Record, Touch
from itouch_thermal.display.column import Array
from itouch_thermal.display.device import DisplayTwin, ThermalDisplay
from itouch_thermal.display.params import FILM, DisplayParams
from itouch_thermal.heat import FINGER, finger_side
from itouch_thermal.rendering.closedloop import AMBIENT, CORE, DEPTH, PERIOD, Case, Run, desired_course, simulate
from itouch_thermal.rendering.materials import material
from itouch_thermal.solver.layers import Back, Contact, Initial, Layer, Side

PAPER = ("aluminium", "pyrex", "wood", "polystyrene")
COLORS = {"aluminium": "#7a7d82", "pyrex": "#2a8fa8", "wood": "#9a5b22", "polystyrene": "#d0589a"}
SKIN = 306.15


def touch(
    name: str, *, resistance: float, seconds: float, films: float = 0.0, press: float = 0.0, period: float = PERIOD
) -> Array:
    """Return the contact flux [W/m2] of a bare finger on 20 mm of a paper's material under so many flux films."""
    from itouch_thermal.solver.stepper import Stepper

    between = (replace(FILM, thickness=films * (FILM.thickness or 0.0)),) if films else ()
    layers = (*between, material(name)[1].layer(DEPTH))
    body = Side(
        layers=layers,
        initial=Initial(kind="uniform", temperature=AMBIENT),
        back=Back(kind="convection", temperature=AMBIENT, coefficient=10.0),
    )
    stepper = Stepper(Contact(finger=finger(), object=body), period)
    times = np.arange(1, round(seconds / period) + 1) * period
    if press == 0.0:
        return stepper.advance(resistance, len(times))
    return stepper.advance(resistance / -np.expm1(-times / press))


def finger(perfusion: float = 1.0) -> Side:
    """Return the nominal finger, its perfusion multiplied."""
    layers = tuple(
        Layer(
            name=layer.name, thickness=layer.thickness, conductivity=layer.conductivity, density=layer.density,
            specific_heat=layer.specific_heat, perfusion=layer.perfusion * perfusion,
        )
        for layer in FINGER
    )  # fmt: skip
    return finger_side(layers, CORE, SKIN, AMBIENT)


def lagged(flux: Array, lag: float) -> Array:
    """Return what a sensor with a time constant [s] shows."""
    keep, found, value = math.exp(-PERIOD / lag), np.empty_like(flux), 0.0
    for i, now in enumerate(flux):
        value = keep * value + (1.0 - keep) * float(now)
        found[i] = value
    return found


def tem_step(current: float = 1.0, seconds: float = 20.0) -> Array:
    """Return the change of the flux out of a resting finger on the plate after a step of current, W/m2 a ms."""
    found = []
    for level in (0.0, current):
        twin = DisplayTwin(DisplayParams(flux_noise=0.0, delay=0.0))
        state = Record.of(twin.fields())
        twin.reset(state, np.random.default_rng(0))
        command = Record.of(Field.of(c) for c in ThermalDisplay.commands)
        on = Touch(ambient=AMBIENT, force=1.0, gap=0.0)
        flux = np.empty(round((seconds + 1.0) / PERIOD))
        for i in range(len(flux)):
            command["current"] = level if i * PERIOD >= 1.0 else 0.0
            twin.step(state, command, on, PERIOD)
            flux[i] = state["true_flux"].item()
        found.append(flux)
    return np.asarray(found[1] - found[0])


def rendered(
    name: str, controller: str, *, resistance: float = 2e-3, start: float | None = None, seconds: float = 10.0
) -> Run:
    """Return a rendered contact on the nominal plant."""
    case = Case(material(name)[1], resistance=resistance, seconds=seconds)
    return simulate(case, desired_course(case), DisplayParams(), controller, seed=1, start=start)


def draw(out: Path) -> list[tuple[str, str]]:
    """Draw all figures as SVG and PNG; return file stems and captions."""
    try:
        import matplotlib
    except ImportError as missing:
        raise ValueError("figures need matplotlib: pip install 'itouch-py[plot]'") from missing
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    made = []
    for stem, caption, painter in (
        ("figure02", "Flux measured through the film on four materials; the touch begins at 1 s.", _figure2),
        ("figure03", "Flux on the plate held at temperatures relative to the room's.", _figure3),
        ("figure04", "Flux out of a resting finger after 1 A of current through the module at 1 s.", _figure4),
        ("figure05", "Tracking of metal: desired, obtained, pumped.", lambda p: _tracking(p, "aluminium")),
        ("figure06", "Tracking of wood: desired, obtained, pumped.", lambda p: _tracking(p, "wood")),
        (
            "figure07",
            "Tracking of polystyrene: desired, obtained, pumped; the published loop with a tight contact.",
            lambda p: _tracking(p, "polystyrene", tight=True),
        ),
        ("figure09", "A contact split into the half-spaces' exact flux and a smooth remainder.", _figure9),
        ("figure10", "What the simulation takes in, computes and gives out.", _figure10),
        ("figure11", "Flux of four materials as simulated, without a film.", _figure11),
    ):
        figure = painter(plt)
        for ending in ("svg", "png"):
            figure.savefig(out / f"{stem}.{ending}", dpi=110, bbox_inches="tight", metadata=_still(ending))
        plt.close(figure)
        made.append((stem, caption))
    return made


def _still(ending: str) -> dict[str, Any]:
    return {"Date": None} if ending == "svg" else {"Software": None}


def _axes(plt: Any, title: str) -> tuple[Any, Any]:
    figure, axes = plt.subplots(figsize=(6.4, 3.8))
    axes.set_title(title, fontsize=10)
    axes.set_xlabel("time [s]")
    axes.set_ylabel("heat flux out of the finger [W/m²]")
    axes.grid(alpha=0.3)
    return figure, axes


def _figure2(plt: Any) -> Any:
    figure, axes = _axes(plt, "Touch of instrumented materials, R = 0.002 K m²/W pressed on in 50 ms")
    for name in PAPER:
        flux = lagged(touch(name, films=1, resistance=2e-3, seconds=9.0, press=0.05), 0.05)
        axes.plot(
            np.concatenate(([0.0, 1.0], 1.0 + np.arange(1, 9001) * PERIOD)),
            [0.0, 0.0, *flux],
            color=COLORS[name],
            label=name,
        )
    axes.legend()
    return figure


def _figure3(plt: Any) -> Any:
    figure, axes = _axes(plt, "Plate held at a temperature relative to the room")
    for offset in (-8, -4, 0, 4, 8, 12, 16):
        run = rendered("aluminium", "hold", start=AMBIENT + offset)
        axes.plot(
            np.arange(len(run.flux)) * PERIOD,
            run.flux,
            color=plt.cm.coolwarm((offset + 8) / 24),
            label=f"{offset:+d} K",
        )
    axes.legend(ncol=2)
    return figure


def _figure4(plt: Any) -> Any:
    figure, axes = _axes(plt, "Step of 1 A at 1 s")
    flux = tem_step()
    axes.plot(np.arange(len(flux)) * PERIOD, flux, color="black")
    axes.set_ylabel("change of the flux [W/m²]")
    return figure


def _tracking(plt: Any, name: str, *, tight: bool = False) -> Any:
    """Draw a contact under the published loop and under `model`; with ``tight`` the former at R = 1e-4 as well."""
    shown = [("paper", "as published: eq. 3 + PI", 2e-3), ("model", "model", 2e-3)]
    shown += [("paper", "as published, R = 1e-4", 1e-4)] if tight else []
    figure, panels = plt.subplots(1, len(shown), figsize=(5.25 * len(shown), 3.8), sharey=not tight)
    for axes, (controller, title, resistance) in zip(panels, shown, strict=True):
        run = rendered(name, controller, resistance=resistance)
        times = np.arange(1, len(run.flux) + 1) * PERIOD
        axes.plot(times, run.flux, color="black", label="obtained")
        axes.plot(times, run.desired, color=COLORS[name], ls="--", label="desired")
        axes.set_title(f"{name}: {title}", fontsize=10)
        axes.set_xlim(-0.05, 2.0 if resistance < 1e-3 else 10.0)
        axes.set_xlabel("time [s]")
        axes.grid(alpha=0.3)
        pump = axes.twinx()
        pump.plot(times, run.pump / 1e3, color="green", lw=0.6, alpha=0.7, label="pumped flux (right)")
        pump.set_ylim(-40, 40)
        pump.set_ylabel("pumped flux [kW/m²]", color="green")
        lines = axes.get_lines() + pump.get_lines()
        axes.legend(lines, [line.get_label() for line in lines], fontsize=8)
    panels[0].set_ylabel("heat flux out of the finger [W/m²]")
    figure.tight_layout()
    return figure


def halfspaces(times: Any, resistance: float, name: str) -> Array:
    """Return the exact flux of two half-spaces through a constant resistance."""
    from math import erfc

    ours, other = FINGER[0].effusivity, material(name)[1].effusivity
    h = (1.0 / ours + 1.0 / other) / resistance
    found = [
        (SKIN - AMBIENT) / resistance * math.exp(h * h * t) * erfc(h * math.sqrt(t)) for t in times if h * h * t < 600
    ]
    return np.array(
        found + [(SKIN - AMBIENT) / (1 / ours + 1 / other) / math.sqrt(math.pi * t) for t in times[len(found) :]]
    )


def _figure9(plt: Any) -> Any:
    figure, axes = _axes(plt, "Wood, R = 0.002 K m²/W: whole = problem 1 (half-spaces) + problem 2")
    whole = touch("wood", resistance=2e-3, seconds=10.0)
    times = np.arange(1, len(whole) + 1) * PERIOD
    first = halfspaces(times, 2e-3, "wood")
    for flux, label, style in (
        (whole, "whole", "-"),
        (first, "problem 1, analytic", "--"),
        (whole - first, "problem 2", ":"),
    ):
        axes.semilogx(times, flux, style, label=label, color="black")
    axes.legend()
    return figure


def _figure10(plt: Any) -> Any:
    figure, axes = plt.subplots(figsize=(8.0, 3.2))
    axes.axis("off")
    boxes = (
        (0.12, 0.75, "materials, tissue,\nresistance"),
        (0.12, 0.25, "object's temperature,\ninfrared skin temperature"),
        (0.46, 0.5, "modes of finger\nand object"), (0.7, 0.5, "contact step:\nflux at the face"),
        (0.93, 0.5, "desired flux,\nskin temperature"),
    )  # fmt: skip
    for x, y, label in boxes:
        axes.text(x, y, label, ha="center", va="center", fontsize=9, bbox={"boxstyle": "round", "fc": "#eef2f7"})
    for a, b in (
        ((0.22, 0.72), (0.36, 0.57)),
        ((0.28, 0.3), (0.36, 0.43)),
        ((0.555, 0.5), (0.6, 0.5)),
        ((0.8, 0.5), (0.83, 0.5)),
    ):
        axes.annotate("", xy=b, xytext=a, arrowprops={"arrowstyle": "->"})
    axes.annotate(
        "", xy=(0.45, 0.36), xytext=(0.68, 0.36), arrowprops={"arrowstyle": "->", "connectionstyle": "arc3,rad=-0.4"}
    )
    axes.text(0.565, 0.12, "next period", ha="center", fontsize=9)
    return figure


def _figure11(plt: Any) -> Any:
    figure, axes = _axes(plt, "Simulated touch of the bare materials, R = 0.002 K m²/W")
    for name in PAPER:
        flux = touch(name, resistance=2e-3, seconds=9.0)
        axes.plot(1.0 + np.arange(1, 9001) * PERIOD, flux, color=COLORS[name], label=name)
    axes.set_xlim(0.0, 10.0)
    axes.legend()
    return figure
