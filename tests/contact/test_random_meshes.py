"""Meshes that nobody chose: on every one the probe stays outside, is never locked, and keeps to its cone."""

from __future__ import annotations

import numpy as np
import pytest
from probing import Floats, winding
from random_meshes import KINDS, Mesh, normals

from itouch.contact import Proxy, Surface
from itouch_evidence.contact.contact_workload import standard

STEPS = 260


def path_over(
    surface: Surface, mesh: Mesh, radius: float, pace: float, depth: float, rng: np.random.Generator
) -> Floats:
    """Walk by chance over a surface, diving below it and coming out again, at a bounded pace."""
    vertices, faces = mesh
    up = normals(vertices, faces)
    up /= np.maximum(np.linalg.norm(up, axis=1, keepdims=True), 1e-300)
    place, velocity = vertices[faces[int(rng.integers(len(faces)))]].mean(axis=0), np.zeros(3)
    hips = np.empty((STEPS, 3))
    for k in range(STEPS):
        velocity = 0.95 * velocity + rng.normal(size=3) * pace * 0.3
        velocity *= min(1.0, pace / max(float(np.linalg.norm(velocity)), 1e-300))
        place, _, face = surface.closest(place + velocity)
        hips[k] = place + up[face] * (radius + depth * np.cos(0.05 * k))
    most = max(3 * pace, 0.1 * depth)
    for k in range(1, STEPS):
        jump = hips[k] - hips[k - 1]
        size = float(np.linalg.norm(jump))
        hips[k] = hips[k - 1] + jump * min(1.0, most / max(size, 1e-300))
    return hips


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("kind", KINDS)
def test_a_probe_stays_outside_is_never_locked_and_keeps_its_cone(kind: str, seed: int) -> None:
    rng = np.random.default_rng([seed, len(kind)])
    size = float(10 ** rng.uniform(-3, 1))
    vertices, faces = KINDS[kind](rng)
    vertices = vertices * size + rng.normal(size=3) * size * float(rng.choice([0, 10]))
    surface = Surface(vertices, faces)
    assert surface.is_solid or kind == "terrain"
    radius = float(rng.choice([0.0, 1e-4, 0.002, 0.02, 0.1])) * size
    friction, pace = float(rng.choice([0.0, 0.3, 0.8, 2.0])), float(rng.choice([1e-4, 1e-3, 5e-3, 2e-2])) * size
    depth = float(rng.choice([0.002, 0.01])) * size
    hips = path_over(surface, (vertices, faces), radius, pace, depth, rng)
    proxy = Proxy(surface, radius=radius, stiffness=1.0, static_friction=friction, dynamic_friction=0.6 * friction)
    away = max(radius, surface.skin)
    most = 4 * ((depth + 3 * pace) * (1 + friction) + away)  # a fast path cuts through walls now and then
    for k, hip in enumerate(hips):
        force = proxy.step(hip) if k else proxy.reset(hip)
        assert np.linalg.norm(force) <= most
        push = float(force @ proxy.normal)
        assert np.linalg.norm(force - push * proxy.normal) <= friction * push * (1 + 1e-6) + 1e-12 * size
        assert proxy.in_contact == bool(force.any())
        assert surface.closest(proxy.position)[1] >= away * (1 - 1e-5) - 3e-2 * surface.skin
        if surface.is_solid and k % 65 == 0:
            assert winding(surface, proxy.position) < 0.5


@pytest.mark.parametrize("kind", ["gyroid", "torus", "hull", "blob"])
def test_a_slow_path_in_free_space_feels_nothing_and_one_inside_feels_the_way_out(kind: str) -> None:
    rng = np.random.default_rng(len(kind))
    vertices, faces = KINDS[kind](rng)
    surface = Surface(vertices, faces)
    radius, depth = 0.02, 0.006
    hips = path_over(surface, (vertices, faces), radius, 5e-4, depth, rng)
    proxy = Proxy(surface, radius=radius, stiffness=1.0)
    _, away, _ = surface.closest(hips)
    for hip, distance in zip(hips, away, strict=True):
        size = np.linalg.norm(proxy.step(hip))
        if distance >= radius:
            assert size == 0.0
        else:  # never less than the way to the nearest free place
            assert size >= radius - distance - 1e-6


def test_a_closed_loop_through_a_frictionless_stiff_contact_gives_back_no_more_than_the_bound() -> None:
    """The bound of a sampled spring: each step may gain K |dx|^2 / 2 at most (Colgate and Schenkel 1997)."""
    stiffness = 2000.0
    for kind in KINDS:
        rng = np.random.default_rng(7)
        vertices, faces = KINDS[kind](rng)
        surface = Surface(vertices, faces)
        start = vertices[faces[len(faces) // 2]].mean(axis=0)
        up = normals(vertices, faces)[len(faces) // 2]
        up /= np.linalg.norm(up)
        aside = np.cross(up, [0.3, 0.5, 0.8])
        aside /= np.linalg.norm(aside)
        for radius in (0.0, 0.01):
            turn = np.linspace(0, 2 * np.pi, 700)[:, None]
            hips = start + up * (radius + 0.004 * np.cos(turn)) + aside * 0.006 * np.sin(turn)
            proxy = Proxy(surface, radius=radius, stiffness=stiffness)
            proxy.reset(hips[0])
            forces = proxy.follow(hips[1:])
            way = np.diff(hips, axis=0)
            held = np.vstack([np.zeros(3), forces[:-1]])  # the force of a step is held over the next
            gained = float(np.einsum("ni,ni->", held, way))
            assert gained <= 0.5 * stiffness * float((way**2).sum()) + 1e-9


@pytest.mark.parametrize("kind", ["hf", "ico"])
@pytest.mark.parametrize("radius", [0.0, 1e-4, 1e-3, 5e-3])
def test_small_probes_feel_the_depth_and_no_facet_holds_them(kind: str, radius: float) -> None:
    work = standard(kind, "10k", 2000, 1.0, radius)
    surface = Surface(work.vertices, work.faces)
    proxy = Proxy(surface, radius=radius, stiffness=1000.0)
    forces = np.concatenate([[proxy.reset(work.hips[0])], proxy.follow(work.hips[1:])])
    feet, away, faces = surface.closest(work.hips)
    up = normals(work.vertices, work.faces)[faces]
    below = np.einsum("ni,ni->n", work.hips - feet, up) < 0
    depth = np.where(below, away, -away) + radius
    error = np.abs(np.linalg.norm(forces, axis=1) - 1000.0 * np.maximum(depth, 0))
    assert np.percentile(error, 99) < 0.01
    assert error.max() < 0.1
    assert not forces[depth < -1e-6].any()
