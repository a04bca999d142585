"""Round bodies for contact_mechanics.py: a ball that rolls, a rope around a bollard, a ball that is pressed."""

import itertools
import math
from typing import Any

import numpy as np

from msdwarp import (
    Capsule,
    Contact,
    Force,
    Material,
    Plane,
    PrescribedMotion,
    Simulation,
    System,
    ball,
    chain,
    cylinder,
)

from ..common import METHODS
from .contact_blocks import FPS, RESTITUTIONS, G, advances, down, methods, motion, pinned_slab, slope_of

GROUNDS = ("plane", "plane, surface", "pinned slab")
"""A `Plane`; one with `Contact(surface_colliders=True)`; a body."""

# --- Rolling ---

ROLLING: dict[str, Any] = {"mass": 0.01, "stiffness": 1e4, "damping": 4.0}
RADIUS, FINE, SLOPE, GRIP = 0.15, 0.05, 20.0, 0.8
"""Radius and spacing of the ball that rolls [m], the slope [°], and its friction: enough by far."""
ROLLS, BEGINS = 0.6, 0.8
"""How long it rolls [s], and its speed at the start [m/s]."""
TURN = (0.9, (1.0, 2.0, 3.0))
"""The ball is turned by this angle [rad] about this axis, so that it does not stand on a face of its lattice."""


def moment_of(body: System) -> float:
    """Return the moment of inertia about an axis through the centre, the mean of three axes [kg m²]."""
    x = body.position - body.center_of_mass
    return float(2 / 3 * (body.mass[:, None] * x**2).sum())


def measure_rolling(options) -> list[dict]:
    """Return a row for each ground and restitution."""
    rows = []
    for ground, restitution in itertools.product(GROUNDS, RESTITUTIONS[1:2] if options.quick else RESTITUTIONS):
        for method in methods(ground == GROUNDS[2] and restitution == 0.3 and not options.quick):
            rows.append(_rolled(ground, restitution, method, options.device))
    return rows


def _rolled(ground: str, restitution: float, method: str, device: str) -> dict:
    body, on_slab = ball(RADIUS, FINE, **ROLLING).rotate(*TURN), ground == "pinned slab"
    mass, moment = float(body.mass.sum()), moment_of(body)
    expected = G * math.sin(math.radians(SLOPE)) / (1 + moment / (mass * RADIUS**2))
    spin, forward = np.array([0.0, BEGINS / RADIUS, 0.0]), np.array([BEGINS, 0.0, 0.0])
    body = body.replace(velocity=np.cross(spin, body.position) + forward)
    system, colliders = body, [Plane(friction=GRIP, restitution=restitution)]
    if on_slab:
        length = BEGINS * ROLLS + 0.5 * expected * ROLLS**2 + 4 * RADIUS
        slab = pinned_slab(length, 2 * RADIUS, FINE, **ROLLING)
        system, colliders = slab + body.translate((1.5 * RADIUS, -0.007, RADIUS)), []
    else:
        # It touches a plane with its surface, or with its particles, some of which are outside of the surface.
        assert body.surface is not None
        touches = body.surface.points(body.position) if ground == "plane, surface" else body.position
        lowest = touches[:, 2].min()
        system = body.translate((0.0, 0.0, -lowest))
    simulation = Simulation(
        system,
        gravity=down(SLOPE),
        colliders=colliders,
        contact=Contact(friction=GRIP, restitution=restitution, surface_colliders=ground == "plane, surface"),
        integrator=METHODS[method],
        device=device,
        fps=FPS,
    )
    substeps = simulation.substeps
    x, v = motion(simulation, ROLLS, slice(-body.particle_count, None))
    centre, speed = x.mean(axis=1), v.mean(axis=1)
    spin = np.cross(x - centre[:, None], v - speed[:, None]).mean(axis=1)[:, 1] * mass / moment
    t = (np.arange(len(x)) + 1) / FPS
    acceleration = slope_of(t, speed[:, 0], t > 0.1)
    return {
        "ground": ground,
        "restitution": restitution,
        "method": method,
        "substeps": substeps,
        "expected": expected,  # [m/s²]
        "acceleration": acceleration,
        "ratio": acceleration / expected,
        "rolls": float((spin * RADIUS / speed[:, 0])[t > 0.1].mean()),  # 1 if it rolls on the radius that is drawn
        "height": float(centre[len(x) // 2 :, 2].mean() / RADIUS) if len(x) else math.nan,  # of the centre, by r
    }


# --- A rope around a bollard ---

BOLLARD, LINK, TAIL = 0.1, 0.01, 14
"""Radius of the bollard and length of a link [m], links of each free end."""
ROPE: dict[str, Any] = {"mass": 5e-3, "stiffness": 2.5e4, "damping": 2.0}
PULL, FRICTIONS = 2.0, (0.1, 0.3, 0.5)
"""Force on the lighter end [N]. There is no gravity."""
BOLLARDS = ("pinned cylinder", "capsule", "capsule, surface")
RISES, PULLS, SPAN = 0.15, 0.7, (0.75, 1.3)
"""The other end is pulled more, in so long to 0.75 of the expected ratio, then slowly to 1.3 of it [s]."""
STARTS, MOVING = 5e-5, 0.02
"""So far from its place the lighter end has begun to move [m]; at this speed it slides [m/s]."""


def rope_around(radius: float) -> System:
    """Return a rope that lies over a horizontal bollard along y: half a turn, and two ends that hang."""
    arc = math.pi * radius
    links = round(arc / LINK)
    s = (np.arange(links + 1 + 2 * TAIL) - TAIL) * arc / links
    phi = np.clip(s / radius, 0.0, math.pi)
    x = np.stack([-radius * np.cos(phi), 0 * s, radius * np.sin(phi) + np.minimum(0, s)], axis=1)
    x[:, 2] -= np.maximum(0, s - arc)
    rope = chain(len(s), arc / links, **ROPE).replace(position=x)
    # As long as the first pull makes it.
    return rope.replace(rest_length=rope.length - PULL / ROPE["stiffness"])


def measure_capstan(options) -> list[dict]:
    """Return a row for each bollard and friction."""
    rows = []
    for bollard, friction in itertools.product(BOLLARDS, FRICTIONS[1:2] if options.quick else FRICTIONS):
        for method in methods(bollard == BOLLARDS[0] and friction == 0.3 and not options.quick):
            rows.append(_pulled(bollard, friction, method, options.device))
    return rows


def _pulled(bollard: str, friction: float, method: str, device: str) -> dict:
    grown = math.exp(friction * math.pi)

    def ratio(t):
        """Return the ratio of the forces on the two ends."""
        begins = max(1.0, SPAN[0] * grown)
        rises = np.clip(t / RISES, 0.0, 1.0) * (begins - 1)
        return 1 + rises + np.maximum(0.0, t - RISES) / PULLS * (SPAN[1] * grown - begins)

    def pull(t):
        return np.array([0 * t, 0 * t, -PULL * ratio(t)])

    if bollard == "pinned cylinder":
        post = cylinder(BOLLARD, 0.1, 0.05, stiffness=ROPE["stiffness"], mass=0.1).rotate(math.pi / 2, (1, 0, 0))
        post, colliders = post.pin(np.arange(post.particle_count)), []
        rope = rope_around(BOLLARD + 0.25 * LINK)  # links are so thick
        system = post + rope
    else:
        colliders = [Capsule((0, -0.1, 0), (0, 0.1, 0), BOLLARD, friction=friction)]
        inside = LINK**2 / (8 * BOLLARD) if bollard == "capsule, surface" else 0.0  # the middle of a link would be
        system = rope = rope_around(BOLLARD + inside)
    light, heavy = system.particle_count - rope.particle_count, system.particle_count - 1
    simulation = Simulation(
        system,
        gravity=0.0,
        loads=[Force((0.0, 0.0, -PULL), on=[light]), Force(pull, on=[heavy])],
        colliders=colliders,
        contact=Contact(friction=friction, surface_colliders=bollard == "capsule, surface"),
        integrator=METHODS[method],
        device=device,
        fps=2 * FPS,
    )
    row = {"bollard": bollard, "friction": friction, "method": method, "substeps": simulation.substeps}
    height, speed = [], []
    while simulation.time < RISES + PULLS and (not height or height[-1] < -4 * LINK):
        if not advances(simulation):
            break
        frame = simulation.frame()
        height.append(float(frame.position[light, 2]))
        speed.append(float(frame.velocity[light, 2]))
    t, z, v = (np.arange(len(height)) + 1) / (2 * FPS), np.array(height), np.array(speed)
    still = np.flatnonzero(z < z[(t > 0.7 * RISES) & (t <= 1.3 * RISES)].mean() + STARTS)
    starts, slides, sliding = math.nan, math.nan, (v > MOVING) & (t > RISES)
    if still[-1] + 1 < len(t):
        starts = float(ratio(t[still[-1]]))
    if sliding.sum() >= 4:
        # Forces on both ends, less what accelerates the rope and leads it around the bollard.
        a, line = np.gradient(v, t)[sliding], ROPE["mass"] / LINK
        end, turns = (TAIL + 1) * ROPE["mass"], line * v[sliding] ** 2
        between = line * BOLLARD * (grown - 1) / friction
        strong = PULL * ratio(t[sliding]) - (end + between) * a - turns
        slides = float(np.median(strong / (PULL + end * a - turns)))
    return row | {
        "expected": grown,
        "starts": starts,  # ratio of the forces at the ends
        "slides": slides,  # ratio of the tensions at both ends of the half turn
        "effective_start": math.log(max(starts, 1e-9)) / math.pi,  # friction that would give this ratio
        "effective": math.log(max(slides, 1e-9)) / math.pi,
    }


# --- Hertz ---

PRESSED, CELLS = 0.2, (8, 16)
"""Radius of the ball that is pressed [m], and how many cells it is across."""
RUBBERY: dict[str, Any] = {"density": 1000.0, "youngs_modulus": 1e5, "damping_ratio": 0.3}
DEPTHS = (0.01, 0.02, 0.03, 0.04, 0.06)
"""Approaches that are measured, by the radius."""
PRESSES = 0.6
"""How long it takes to press the ball [s]."""


def measure_hertz(options) -> list[dict]:
    """Return a row for each ground, ball and approach.

    The ball's middle layer is held, and the ground rises: so the approach is that of the ball's centre.
    """
    rows = []
    for ground, cells in itertools.product(GROUNDS, CELLS[:1] if options.quick else CELLS):
        rows += _pressed(ground, cells, options.device)
    return rows


def _pressed(ground: str, cells: int, device: str) -> list[dict]:
    material = Material(**RUBBERY)
    stiff = material.youngs_modulus / (1 - 0.25**2)
    body = ball(PRESSED, 2 * PRESSED / cells, material=material).translate((0.0, 0.0, PRESSED))
    x = body.position
    middle = np.flatnonzero(np.abs(x[:, 2] - PRESSED) < 0.6 * 2 * PRESSED / cells)
    # The ground starts so low that neither particles nor the surface touch it.
    lowest = min(0.0, x[:, 2].min()) - 1e-3 * PRESSED
    highest = 1.05 * DEPTHS[-1] * PRESSED

    def lift(t):
        way = np.minimum(t / PRESSES, 1.0) * (highest - lowest)
        return np.array([0 * way, 0 * way, way])

    system, loads, colliders = body.pin(middle), [], []
    if ground == "pinned slab":
        slab = pinned_slab(1.5 * PRESSED, 1.5 * PRESSED, PRESSED / 8, material=material)
        slab = slab.translate((-0.75 * PRESSED + 0.003, 0.002, lowest))
        slab = slab.replace(mass=np.where(np.isfinite(slab.mass), slab.mass, 1.0))
        loads = [PrescribedMotion(on=np.arange(slab.particle_count), motion=lift)]
        system = slab + system
    else:
        colliders = [Plane(offset=lowest, friction=0.0, motion=lift)]
    simulation = Simulation(
        system,
        gravity=0.0,
        loads=loads,
        colliders=colliders,
        contact=Contact(friction=0.0, surface_colliders=ground == "plane, surface"),
        device=device,
        fps=2 * FPS,
        contact_forces=True,
    )
    assert body.surface is not None
    mine = slice(-body.particle_count, None)
    levels, forces, overlaps = [], [], []
    for _ in range(round(2 * FPS * PRESSES)):
        simulation.step()
        # The force is the mean of a frame: half of it is at the level in its middle.
        levels.append(float(lowest + lift(simulation.time - 0.25 / FPS)[2]))
        forces.append(float(simulation.contact_force()[mine, 2].sum()))
        surface = body.surface.points(simulation.frame().position[mine])
        overlaps.append(max(0.0, float(lowest + lift(simulation.time)[2] - surface[:, 2].min())))
    level, force, overlap = np.array(levels), np.array(forces), np.array(overlaps)
    loaded = np.flatnonzero(force > 1e-4 * force.max())
    touch = float(level[loaded[0]]) if len(loaded) else math.nan
    rows = []
    for depth in DEPTHS:
        d = depth * PRESSED
        law = 4 / 3 * stiff * math.sqrt(PRESSED)
        found, inside = (float(np.interp(d, level, one)) for one in (force, overlap))
        after = float(np.interp(d, level - touch, force))
        rows.append(
            {
                "ground": ground,
                "cells": cells,
                "approach": d,  # of the centre, from where the drawn surface touches [m]
                "contact_radius": math.sqrt(PRESSED * d) * cells / (2 * PRESSED),  # in spacings
                "hertz": law * d**1.5,  # [N]
                "force": found,
                "ratio": found / (law * d**1.5),
                "overlap": inside,  # how deep the drawn surface is in the ground [m]
                "ratio_less_overlap": found / (law * max(d - inside, 1e-9) ** 1.5),
                "touch": touch,  # level at which the force begins; below 0 outside the drawn surface [m]
                "ratio_from_touch": after / (law * d**1.5),  # as far after the first force
            }
        )
    return rows
