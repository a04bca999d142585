"""Probes of tension: against statics, the forces that springs of every law exert, and muscles."""

import itertools

import numpy as np
import pytest
from problems import EPS64

from msdwarp import (
    Actuator,
    CoulombDamper,
    Damper,
    DamperKinds,
    ExponentialSpring,
    LimitedSpring,
    Probe,
    QuadraticDamper,
    Simulation,
    Spring,
    SpringKinds,
    System,
    TensionOnlySpring,
    chain,
)

SPRINGS = (Spring(), TensionOnlySpring(), LimitedSpring(0.05, 10.0), ExponentialSpring(0.5))
DAMPERS = (Damper(), QuadraticDamper(0.5), CoulombDamper(0.3))


def springs_apart() -> System:
    """Return a spring along x for each law of springs and of dampers, twice: one is long and gets longer."""
    kinds = np.array(list(itertools.product(range(len(SPRINGS)), range(len(DAMPERS)), (1, -1))))
    count, sign = len(kinds), kinds[:, 2]
    position, velocity = np.zeros((2, count, 2, 3))
    position[:, 1, 0], position[:, :, 1] = 0.5 + 0.1 * sign, np.arange(count)[:, None]
    velocity[:, 1, 0] = 0.4 * sign
    return System(
        position=position.reshape(-1, 3),
        velocity=velocity.reshape(-1, 3),
        connections=np.arange(2 * count).reshape(-1, 2),
        rest_length=0.5,
        stiffness=np.linspace(20.0, 40.0, count),
        damping=np.linspace(1.0, 2.0, count),
        mass=1.0,
        spring=SpringKinds(SPRINGS, kinds[:, 0]),
        damper=DamperKinds(DAMPERS, kinds[:, 1]),
    )


def test_a_tension_is_what_the_spring_exerts(plain_device):
    # By every law of springs and dampers; the first eight are muscles, the very first two at once.
    system = springs_apart()
    count, substeps = system.connection_count, 6
    muscles = [Actuator(lambda t: 0.2 * np.sin(9 * t), on=range(16)), Actuator(-0.05, on=[0, 1])]
    probes = {"all": Probe(range(2 * count), "tension", every="substep")}
    for k in range(count):
        ends = [2 * k, 2 * k + 1]
        probes |= {f"tension {k}": Probe(ends, "tension", every="substep")}
        probes |= {f"force {k}": Probe(ends[1:], "force", every="substep")}
    how = {"loads": muscles, "gravity": 0.0, "precision": "float64", "substeps": substeps, "device": plain_device}
    simulation = Simulation(system, probes=probes, **how)
    simulation.step(2)
    tension = np.stack([simulation.readings[f"tension {k}"].values for k in range(count)])
    force = np.stack([simulation.readings[f"force {k}"].values for k in range(count)])
    assert tension.shape == (count, 2 * substeps, 2)
    most = 8 * EPS64 * np.abs(force).max()  # the same products and sums in another order
    np.testing.assert_allclose(tension[..., 0], -force[..., 0], rtol=0, atol=most)
    np.testing.assert_array_equal(tension[..., 1], np.abs(tension[..., 0]))
    assert (tension[::2, 0, 0] > 0).all()  # those that are long
    together = simulation.readings["all"].values
    np.testing.assert_allclose(together[:, 0], tension[..., 0].mean(axis=0), rtol=0, atol=count * most)
    np.testing.assert_array_equal(together[:, 1], tension[..., 1].max(axis=0))
    # k (l − l0 (1 + s)) + b l' of the first, a linear muscle.
    _, x, v = simulation.frame()
    (k, b, l0), s = (one[0] for one in (system.stiffness, system.damping, system.rest_length)), 0.2 * np.sin(0.3)
    expected = k * (x[1, 0] - x[0, 0] - l0 * (1 + s - 0.05)) + b * (v[1, 0] - v[0, 0])
    assert tension[0, -1, 0] == pytest.approx(expected, rel=1e-12)


def test_a_rope_between_two_pins_bears_what_its_catenary_says(plain_device):
    # Nine links of 10 cm between masses of 0.5 kg. By statics each has the horizontal force H, and its
    # vertical force differs by m g from the next. Rest lengths are such that links have 10 cm then.
    links, h, mass, stiffness, g = 9, 20.0, 0.5, 2000.0, 9.82
    vertical = mass * g * (np.arange(links) - 4)
    tension = np.hypot(h, vertical)
    steps = 0.1 * np.stack([h + 0 * vertical, 0 * vertical, vertical], axis=1) / tension[:, None]
    rope = chain(links + 1, 0.1, mass=mass, stiffness=stiffness, damping=20.0).pin([0, links])
    rope = rope.replace(position=np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)]))
    rope = rope.replace(rest_length=0.1 - tension / stiffness)
    probes = {f"link {k}": Probe([k, k + 1], "tension") for k in range(links)} | {"pin": Probe([0], "force")}
    simulation = Simulation(rope, probes=probes, precision="float64", gravity=g, device=plain_device)
    simulation.step(30)
    found = [simulation.readings[f"link {k}"].values[-1, 0] for k in range(links)]
    # Positions of 1 m are rounded by EPS64 in each of some hundred substeps: k times that.
    np.testing.assert_allclose(found, tension, rtol=0, atol=1000 * stiffness * EPS64)
    np.testing.assert_allclose(simulation.readings["pin"].values[-1], [h, 0.0, vertical[0]], rtol=0, atol=1e-9)


def test_a_probe_of_tension_must_have_a_connection():
    with pytest.raises(
        ValueError, match=r"probes\['it'\]\.on is \[0, 2\]; for the tension it must contain a conn"
    ):
        Simulation(chain(3), probes={"it": Probe([0, 2], "tension")})
    assert Probe([0, 1], "tension").columns(3) == ["tension_mean_N", "tension_largest_N"]
