"""What contacts push bodies with: what probes tell of it, and the force on each particle."""

import numpy as np
import pytest

from msdwarp import (
    RK4,
    Contact,
    Leapfrog,
    LinearlyImplicitEuler,
    Plane,
    Probe,
    Simulation,
    SymplecticEuler,
    System,
    box,
)

G = 9.82
FPS = 240
"""Frames are short, for each launch of a frame is recorded, which on a CPU takes longer than the launch itself."""


def two_blocks(**constants) -> System:
    """Return a block that lies on another one on the floor; 27 particles of 20 g each."""
    die = box((3, 3, 3), 0.1, **({"mass": 0.02, "stiffness": 2e4, "damping": 20.0} | constants))
    low = die.translate((0, 0, 0.1)).named("low")
    return low + die.rotate(0.3, axis=(0, 0, 1)).translate((0.02, 0.01, 0.3)).named("high")


WEIGHT = 27 * 0.02 * G


@pytest.mark.slow
def test_blocks_at_rest_bear_what_lies_on_them(device):
    probes = {
        "floor": Probe("low", "contact force"),
        "on low": Probe("low", "touch force"),
        "on high": Probe("high", "touch force"),
        "all on high": Probe("high", "contact force"),
        "both": Probe(np.arange(54), "contact force"),
        "cancels": Probe(np.arange(54), "touch force"),
    }
    floor = Plane(friction=0.5)
    options = {"colliders": [floor], "contact": Contact(), "device": device, "fps": FPS}
    simulation = Simulation(two_blocks(), probes=probes, contact_forces=True, **options)
    simulation.step(360)
    told = {name: simulation.readings[name].values[-1] for name in probes}
    # Damped for 1.5 s, what is left of their motion is below a thousandth of g.
    up = np.array([0.0, 0.0, WEIGHT])
    settled = {"rtol": 0, "atol": 1e-3 * WEIGHT}
    np.testing.assert_allclose(told["on high"], up, **settled)
    np.testing.assert_allclose(told["on low"], -up, **settled)
    np.testing.assert_allclose(told["both"], 2 * up, **settled)  # what the floor bears
    np.testing.assert_allclose(told["floor"], up, **settled)  # 2 weights from below, 1 from above
    np.testing.assert_array_equal(told["all on high"], told["on high"])
    # Forces are whole numbers of a unit, and cancel: what is left is that shares of particles are rounded, each
    # of some hundred times by the float32 that they are stored in.
    eps = 1.2e-7
    for told_of_both in simulation.readings["cancels"].values:
        np.testing.assert_allclose(told_of_both, 0.0, rtol=0, atol=100 * eps * WEIGHT)
    # The same particle by particle.
    force = simulation.contact_force()
    assert force.shape == (54, 3)
    rounded = {"rtol": 0, "atol": 54 * eps * WEIGHT}
    np.testing.assert_allclose(force[27:].sum(axis=0), told["all on high"], **rounded)
    np.testing.assert_allclose(force[:27].sum(axis=0), told["floor"], **rounded)


@pytest.mark.slow
@pytest.mark.parametrize("method", [SymplecticEuler(), Leapfrog(), RK4(), LinearlyImplicitEuler()], ids=str)
def test_touch_impulses_are_what_momentum_lacks(plain_device, method):
    # p' − p = ∫ f dt for each of two blocks that collide in free flight: every method adds up h f, by its weights.
    blocks, high = two_blocks(stiffness=2e3, damping=0.5), np.arange(54)[:, None] >= 27
    speed = np.where(high, (0.2, 0.0, -1.0), (0.0, 0.0, 1.0))
    blocks = blocks.replace(position=blocks.position + 0.01 * high, velocity=speed)
    probes = {name: Probe(name, "touch force") for name in ("low", "high")}
    probes["by substep"] = Probe("high", "touch force", every="substep")
    options = {"gravity": 0.0, "contact": Contact(), "device": plain_device, "precision": "float64", "fps": FPS}
    simulation = Simulation(blocks, integrator=method, probes=probes, **options)
    simulation.step(24)
    frame = simulation.frame()
    gained = 0.02 * (frame.velocity - speed)
    assert np.abs(gained).sum() > 0.1  # they have collided
    # In leapfrog's family the velocity where a frame ends has half of the next force, in contact or not.
    assert simulation.measure().effect_energy == 0.0
    for name, own in (("low", gained[:27]), ("high", gained[27:])):
        impulse = simulation.readings[name].values.sum(axis=0) / FPS
        np.testing.assert_allclose(impulse, own.sum(axis=0), rtol=0, atol=1e-10 * np.abs(gained).sum())
    by_substep = simulation.readings["by substep"].values.reshape(24, -1, 3).mean(axis=1)
    np.testing.assert_allclose(by_substep, simulation.readings["high"].values, rtol=0, atol=1e-9)


@pytest.mark.slow
def test_support_counts_on_what_is_pinned(device):
    # A pinned block below feels what lies on it, though no obstacle's push on it would count.
    blocks = two_blocks()
    blocks = blocks.pin(np.arange(27))
    simulation = Simulation(blocks, contact=Contact(), device=device, contact_forces=True, fps=FPS)
    simulation.step(360)
    force = simulation.contact_force()
    np.testing.assert_allclose(force[:27].sum(axis=0), (0, 0, -WEIGHT), rtol=0, atol=1e-3 * WEIGHT)
    # It touches at vertices that lie r inside its face, a quarter of its spacing: by that share they are the layer
    # below, and else the upper one. Nothing touches the lowest layer.
    spacing = 0.75 * np.linalg.norm(np.diff(blocks.position[blocks.connections], axis=1)[:, 0], axis=1).mean()
    share = 0.25 * spacing / 0.1
    layer = np.rint((blocks.position[:27, 2] - blocks.position[:27, 2].min()) / 0.1).astype(int)
    assert not force[:27][layer == 0].any()
    for k, part in ((1, share), (2, 1.0 - share)):
        borne = force[:27][layer == k].sum(axis=0)
        np.testing.assert_allclose(borne, (0, 0, -part * WEIGHT), rtol=0, atol=1e-3 * WEIGHT)


def test_a_probe_of_what_cannot_touch_is_refused():
    alone = two_blocks()
    with pytest.raises(ValueError, match=r"probes\['a'\]\.what is 'touch force'; bodies must touch then"):
        Simulation(alone, probes={"a": Probe("low", "touch force")}, colliders=[Plane()])
    with pytest.raises(ValueError, match="there must be colliders then, that may touch the group, or bodies"):
        Simulation(alone, probes={"a": Probe("low", "contact force")})
    with pytest.raises(ValueError, match=r"contact_forces is 1\.5"):
        Simulation(alone, contact_forces=1.5)
