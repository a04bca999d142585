"""The texts of systems, scenes, colliders and trajectories: what they are, in a few lines, and never an array."""

import functools
from typing import Any

import numpy as np
import pytest
import warp as wp
from trajectories import write

import msdwarp as msd
from msdwarp.cli.provenance import digest


def press(time):
    return (0, 0, -time)


@wp.func
def rubbing(strain: Any, rate: Any, damping: Any):
    return damping * rate


BLOCK = msd.box((3, 2, 4), 0.1, mass=0.5, stiffness=200.0, damping=0.3).translate((0, 0, 1))


def test_a_system_says_what_it_is():
    # 3·2·4 particles; a box joins each with its 26 neighbours.
    assert repr(BLOCK).splitlines() == [
        f"System of 24 particles in 3 dimensions, {BLOCK.connection_count} connections",
        "  extent 0.2 × 0.1 × 0.3 m, lowest corner (-0.1, -0.05, 0.85) m",
        "  mass 12 kg",
        "  stiffness 200 N/m, damping 0.3 N s/m",
    ]


def test_a_system_says_what_is_unusual():
    dry = msd.CoulombDamper()
    two = msd.sheet((2, 2), damping=0.1).named("one") + msd.sheet((3, 2), stiffness=5.0, damping=0.2).named("two")
    system = two.replace(yield_strain=0.05, damper=dry).pin([0, 1])
    lines = repr(system).splitlines()
    assert lines[2:] == [
        "  mass 8 kg, 2 particles pinned",
        f"  stiffness 5 to 1000 N/m, damping 0.1 to 0.2 by {dry!r}, yields beyond a strain of 0.05",
        "  groups: one (4), two (6)",
    ]
    assert repr(msd.chain(2).pin(slice(None))).splitlines()[2] == "  2 particles pinned"
    many = functools.reduce(lambda system, k: system.named(f"g{k}"), range(9), BLOCK)
    assert repr(many).splitlines()[-1] == "  groups: g0 (24), g1 (24), g2 (24), g3 (24) and 5 more"
    alone = msd.System(position=[[1.0]])
    assert repr(alone).splitlines() == [
        "System of 1 particle in 1 dimension, 0 connections",
        "  extent 0 m, lowest corner (1) m",
        "  mass 1 kg",
    ]


@pytest.mark.parametrize(
    ("collider", "text"),
    [
        (msd.Plane(), "Plane()"),
        (msd.Plane(restitution=0.3, normal=(0, 0, 2)), "Plane(normal=(0.0, 0.0, 1.0), restitution=0.3)"),
        (msd.Sphere(motion=press), "Sphere(motion=press)"),
        (msd.Sphere(motion=lambda t: (0, 0, t)), "Sphere(motion=<lambda>)"),
        (msd.Sphere(motion=functools.partial(press)), "Sphere(motion=partial)"),
        (msd.Box(turn=np.array([0.0, 0.0, 0.5])), "Box(turn=(0.0, 0.0, 0.5))"),
        (msd.Capsule(radius=np.float64(0.5)), "Capsule(radius=0.5)"),
    ],
)
def test_a_collider_says_what_is_not_as_by_default(collider, text):
    assert repr(collider) == text


def test_a_scene_says_what_is_in_it():
    scene = msd.Scene(
        system=BLOCK,
        colliders=[msd.Plane(), *[msd.Sphere()] * 4],
        gravity=(0, 0, -1.62),
        schedule=[msd.at(0.5, mass=1.0), msd.at(0.25, stiffness=lambda k: 2 * k)],
    )
    assert repr(scene).splitlines() == [
        "Scene of 4 s, gravity (0, 0, -1.62) m/s²",
        "  " + repr(BLOCK).splitlines()[0],
        "  colliders: Plane(), Sphere(), Sphere() and 2 more",
        "  schedule: 2 changes, at 0.25 to 0.5 s",
    ]
    dressed = msd.Scene(system=BLOCK.named("block"), looks={"block": msd.Look()})
    assert repr(dressed).splitlines()[-1] == "  looks of their own: block"
    assert repr(msd.Scene(system=BLOCK)).splitlines()[0] == "Scene of 4 s, gravity 9.82 m/s²"


def test_drives_laws_of_one_s_own_and_modes_say_what_they_are():
    assert repr(msd.PrescribedMotion("top", press)) == "PrescribedMotion(on='top', motion=press)"
    assert repr(msd.PrescribedMotion("top")).endswith(" at rest")
    assert repr(msd.OwnDamper(rubbing, 4.0)) == "OwnDamper(rubbing, 4)"
    found = msd.Modes(np.array([0.0, 12.3456]), np.zeros((3, 2)), np.zeros((2, 3, 2)), np.zeros(2), np.ones(2))
    assert repr(found) == "<2 modes: 0, 12.35 Hz>"


def test_surfaces_and_tracked_points_say_how_many_they_are():
    assert repr(msd.sheet((2, 2)).surface) == "Surface of 4 vertices, 2 triangles"
    points = msd.TrackedPoints([0.0, 0.0, 0.5], [3, 4, 3], np.zeros((3, 2)))
    assert repr(points) == "TrackedPoints: 3 rows of 2 particles"


def test_a_trajectory_says_what_is_in_it_also_when_it_is_closed(tmp_path):
    write(tmp_path / "a.vtkhdf", BLOCK, 3, attributes={"scene": "cube"})
    with msd.Trajectory(tmp_path / "a.vtkhdf") as trajectory:
        lines = repr(trajectory).splitlines()
        assert lines[0] == f"Trajectory {tmp_path / 'a.vtkhdf'}"
        assert lines[1].startswith("  3 frames from 0 to ")
        assert lines[2] == f"  24 particles in 3 dimensions, {BLOCK.connection_count} connections"
        assert lines[3:] == ["  of the scene cube"]
    assert repr(trajectory).splitlines() == [f"{lines[0]}, closed", *lines[1:]]


def test_a_gradient_says_by_what_it_is():
    simulation = msd.Simulation(BLOCK, device="cpu")
    gradient = simulation.gradient(
        lambda frames: (0.5, 0 * frames.position, None), 1, by=("stiffness", "velocity")
    )
    assert repr(gradient) == f"Gradient of 0.5 by stiffness ({BLOCK.connection_count},), velocity (24, 3)"


def test_digests_of_scenes_are_those_of_earlier_versions():
    # By which `resume` knows a scene again: they do not depend on how a thing is printed.
    colliders = [msd.Plane(friction=0.25), msd.Box((0, 0, -1), (2, 2, 0.5), turn=(0, 0, 0.5)), msd.Cone()]
    system = msd.box((2, 2, 2), 0.25, mass=0.5, stiffness=64.0, damping=0.5).replace(damper=msd.QuadraticDamper())
    assert digest(msd.Scene(system=system, colliders=colliders)) == "9198e3b068716237"


def test_readings_say_which_probes_they_are_of():
    simulation = msd.Simulation(msd.chain(2), probes={"end": msd.Probe([1], "position")}, device="cpu")
    assert repr(simulation.readings) == "Readings({'end': times and values of 0 readings})"
    simulation.step(3)
    assert repr(simulation.readings) == "Readings({'end': times and values of 3 readings})"


def test_an_ensemble_says_in_what_its_worlds_differ():
    ensemble = msd.Ensemble(msd.chain(2), 3, stiffness=[1, 2, 3], mass=[1, 2, 3], device="cpu", substeps=4)
    assert repr(ensemble).splitlines() == [
        "<Ensemble of 3 worlds of 2 particles, which differ in stiffness, mass",
        "  4 substeps a frame at 60 frames a second, on cpu",
        "  at 0 s, frame 0>",
    ]
