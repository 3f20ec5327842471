"""A contact solved in high precision, by other means than the product's: transfer matrices and mpmath.

Temperature and flux are carried from the back to the contact as ``beta * homogeneous + particular`` with cosh and
sinh in long arithmetic (the product uses reflection coefficients in double precision), and the inversion is
Abate and Valko's fixed Talbot rule with its own contour.  A case is the JSON object of a case file, all in degC.
"""

from __future__ import annotations

from typing import Any

import mpmath as mp

DIGITS = 80
NODES = 34
#: A layer this many decay lengths thick is as good as endless (exp(-2 * 60) = 1e-52), and costs no more digits.
OPAQUE = 60


def _layer(layer: dict[str, Any]) -> tuple[Any, Any, Any, Any]:
    length = None if layer.get("L") is None else mp.mpf(layer["L"])
    return length, mp.mpf(layer["k"]), mp.mpf(layer["rho"]) * mp.mpf(layer["c"]), mp.mpf(layer.get("w", 0))


class Line:
    """What lies behind a face, as the line of states ``(T, q) = par + beta * hom``; q is the inward flux."""

    def __init__(self, hom: tuple[Any, Any], par: tuple[Any, Any]) -> None:
        self.hom, self.par = hom, par

    def through(self, length: Any, k: Any, g: Any, p: Any) -> Line:
        """Carry the line outwards through a layer with particular solution p."""
        if opaque(g, length):
            return Line((mp.mpf(1), k * g), (p, mp.mpf(0)))
        hom, par = outwards(self.hom, length, k, g, mp.mpf(0)), outwards(self.par, length, k, g, p)
        if abs(hom[0]) > abs(hom[1]) * mp.mpf(10) ** -6:
            hom, ratio = (mp.mpf(1), hom[1] / hom[0]), par[0]
        else:
            hom, ratio = (hom[0] / hom[1], mp.mpf(1)), par[1]
        return Line(hom, (par[0] - ratio * hom[0], par[1] - ratio * hom[1]))


def opaque(g: Any, length: Any) -> bool:
    return bool(mp.re(g) * length > OPAQUE)


def outwards(pair: Any, x: Any, k: Any, g: Any, p: Any) -> Any:
    """Carry (T, q) outwards over a distance x of one layer."""
    t, q = pair
    if g == 0:
        return (t + q * x / k, q)
    cosh, sinh = mp.cosh(g * x), mp.sinh(g * x)
    return (p + (t - p) * cosh + q * sinh / (k * g), q * cosh + k * g * (t - p) * sinh)


class SideOracle:
    """One side, from its JSON object."""

    def __init__(self, data: dict[str, Any]) -> None:
        self.layers = [_layer(layer) for layer in data["layers"]]
        self.back = data.get("back")
        self.arterial = mp.mpf(data.get("T_art", 0))
        self.initial = data["initial"]
        self.uniform = mp.mpf(self.initial["T"]) if self.initial["type"] == "uniform" else None
        zero = mp.mpf(0)
        if self.uniform is None:
            line = self.lines(zero, self.arterial, self._held())[0]
            if "T_surface" in self.initial:
                beta = (mp.mpf(self.initial["T_surface"]) - line.par[0]) / line.hom[0]
            else:
                h, ambient = mp.mpf(self.initial["h"]), mp.mpf(self.initial["T_amb"])
                beta = (h * (ambient - line.par[0]) - line.par[1]) / (line.hom[1] + h * line.hom[0])
            self.surface = line.par[0] + beta * line.hom[0]
            self.flux = line.par[1] + beta * line.hom[1]
        else:
            self.surface, self.flux = self.uniform, zero

    def _held(self) -> Any:
        return mp.mpf(self.back["T"]) if self.back and "T" in self.back else mp.mpf(0)

    def _p(self, s: Any, c: Any, w: Any, blood: Any) -> Any:
        return w * blood / (s * c + w) if w else mp.mpf(0)

    def lines(self, s: Any, blood: Any, held: Any) -> list[Line]:
        """Return the lines at all faces from the contact to the back, for sources ``blood`` and ``held``."""
        length, k, c, w = self.layers[-1]
        g = mp.sqrt((s * c + w) / k)
        one, zero = mp.mpf(1), mp.mpf(0)
        if length is None:
            found = [Line((one, k * g), (self._p(s, c, w, blood), zero))]
        elif self.back["type"] == "temperature":
            found = [Line((zero, one), (held, zero))]
        elif self.back["type"] == "insulated":
            found = [Line((one, zero), (zero, zero))]
        else:
            h = mp.mpf(self.back["h"])
            found = [Line((one, h), (zero, -h * held))]
        for length, k, c, w in reversed(self.layers):
            g = mp.sqrt((s * c + w) / k)
            inner = found[-1]
            found.append(inner if length is None else inner.through(length, k, g, self._p(s, c, w, blood)))
        return found[::-1]

    def field(self, s: Any, blood: Any, held: Any, surface: Any, depth: Any) -> tuple[Any, Any]:
        """Return (T, q) at a depth when the contact face has the temperature ``surface``."""
        lines = self.lines(s, blood, held)
        for (length, k, c, w), behind in zip(self.layers, lines[1:], strict=True):
            g, p = mp.sqrt((s * c + w) / k), self._p(s, c, w, blood)
            if length is None:
                fall = (surface - p) * mp.exp(-g * depth)
                return p + fall, k * g * fall
            (ht, hq), (pt, pq) = behind.hom, behind.par
            if opaque(g, length):
                beta = (-k * g * (pt - p) - pq) / (hq + k * g * ht)
                inner = (pt + beta * ht, pq + beta * hq)
                if depth <= length:
                    fall = (surface - p) * mp.exp(-g * depth)
                    rise = (inner[0] - p) * mp.exp(-g * (length - depth))
                    return p + fall + rise, k * g * (fall - rise)
            else:
                top = outwards((pt, pq), length, k, g, p)[0], outwards((ht, hq), length, k, g, mp.mpf(0))[0]
                beta = (surface - top[0]) / top[1]
                inner = (pt + beta * ht, pq + beta * hq)
                if depth <= length:
                    return outwards(inner, length - depth, k, g, p)
            surface, depth = inner[0], depth - length
        return inner

    def start(self, depth: Any) -> tuple[Any, Any]:
        """Return initial temperature and inward flux at a depth."""
        if self.uniform is not None:
            return self.uniform, mp.mpf(0)
        return self.field(mp.mpf(0), self.arterial, self._held(), self.surface, depth)

    def sources(self, s: Any) -> tuple[Any, Any]:
        """Return what blood and back add to the deviation from the start."""
        if self.uniform is None:
            return mp.mpf(0), mp.mpf(0)
        held = self._held() - self.uniform if self.back and "T" in self.back else mp.mpf(0)
        return (self.arterial - self.uniform) / s, held / s


def _invert(transform: Any, t: Any) -> list[Any]:
    """Fixed Talbot rule of Abate and Valko for a vector of transforms."""
    m = NODES
    r = mp.mpf(2) * m / (5 * t)
    total = [mp.exp(r * t) * value / 2 for value in transform(r)]
    for n in range(1, m):
        theta = n * mp.pi / m
        cot = mp.cot(theta)
        s = r * theta * (cot + 1j)
        sigma = theta + (theta * cot - 1) * cot
        weight = mp.exp(s * t) * (1 + 1j * sigma)
        for i, value in enumerate(transform(s)):
            total[i] += mp.re(weight * value)
    return [mp.re(value) * r / m for value in total]


def solve(case: dict[str, Any], times: list[float]) -> dict[str, list[float]]:
    """Return j, T_skin, T_object, Q and the probes of a case, degC, at times [s]."""
    with mp.workdps(DIGITS):
        sides = {name: SideOracle(case[name]) for name in ("finger", "object")}
        resistance, probes = mp.mpf(case["Rth"]), case.get("probes", [])

        def transform(s: Any) -> list[Any]:
            # Inward deviations of the flux are -J - q0/s (finger) and J - q0/s (object).
            line = {name: side.lines(s, *side.sources(s))[0] for name, side in sides.items()}
            z = {name: a.hom[0] / a.hom[1] for name, a in line.items()}
            level = {name: a.par[0] - a.par[1] * z[name] - z[name] * sides[name].flux / s for name, a in line.items()}
            gap = (sides["finger"].surface - sides["object"].surface) / s + level["finger"] - level["object"]
            j = gap / (z["finger"] + z["object"] + resistance)
            rise = {"finger": level["finger"] - z["finger"] * j, "object": level["object"] + z["object"] * j}
            out = [j, rise["finger"], rise["object"], j / s]
            for probe in probes:
                side = sides[probe["side"]]
                t, q = side.field(s, *side.sources(s), rise[probe["side"]], mp.mpf(probe["depth"]))
                out.append(t if probe["what"] == "T" else -q if probe["side"] == "finger" else q)
            return out

        names = ["j", "T_skin", "T_object", "Q", *(probe["name"] for probe in probes)]
        offsets = [mp.mpf(0), sides["finger"].surface, sides["object"].surface, mp.mpf(0)]
        for probe in probes:
            t, q = sides[probe["side"]].start(mp.mpf(probe["depth"]))
            offsets.append(t if probe["what"] == "T" else -q if probe["side"] == "finger" else q)
        columns: dict[str, list[float]] = {name: [] for name in names}
        for t in times:
            for name, offset, value in zip(names, offsets, _invert(transform, mp.mpf(t)), strict=True):
                columns[name].append(float(offset + value))
        return columns
