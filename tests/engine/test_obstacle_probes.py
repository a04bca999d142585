"""Probes on obstacles: their forces and torques against statics, and against the forces on particles."""

import numpy as np
import pytest
from problems import EPS64

import msdwarp as msd

G = 9.82
FOAM = msd.Material(density=500.0, youngs_modulus=1e5, damping_ratio=0.3)


def test_floor_and_wall_bear_what_presses_on_each(plain_device):
    """A block is pressed by its weight on the floor, and by a force on the wall: its lowest row touches both."""
    block = msd.box((5, 5, 5), 0.1, material=FOAM).translate((0.0, 0.0, 0.2)).named("block")
    floor, wall = msd.Plane(friction=0.0), msd.Plane((1, 0, 0), offset=-0.2, friction=0.0)
    far = msd.Sphere((0.0, 0.0, 5.0), 0.3)
    simulation = msd.Simulation(
        block,
        colliders=[floor, wall, far],
        loads=[msd.Force((-300.0 / 125, 0.0, 0.0))],
        probes={"floor": msd.Probe(floor), "wall": msd.Probe(wall), "far": msd.Probe(far)},
        device=plain_device,
    )
    simulation.step(200)  # the slowest mode is damped at some 10/s: e⁻³⁰ of the start is left
    weight = G * block.mass.sum()
    place = simulation.frame().position.astype(float)
    found = {name: simulation.readings[name].values[-1] for name in ("floor", "wall", "far")}
    # float32 rounds 25 impulses in each of some 10 substeps by 1e-7 of their size.
    near = {"rtol": 0, "atol": 1e-5 * weight}
    np.testing.assert_allclose(found["floor"][:3], (0.0, 0.0, -weight), **near)
    np.testing.assert_allclose(found["wall"][:3], (-300.0, 0.0, 0.0), **near)
    assert not found["far"].any()
    # The torque on the floor, about the origin: where the forces are is between the block's ends.
    assert place[:, 0].min() < found["floor"][4] / weight < place[:, 0].max()
    assert found["wall"][5] == pytest.approx(0.0, abs=1e-5 * weight)  # which is symmetric


@pytest.mark.parametrize("every", ["frame", "substep"])
def test_a_lifted_plate_bears_the_weight_where_it_is(plain_device, every):
    """A plate accelerates upwards by 1 m/s²: it bears m (g + 1), and a torque as the body is beside its middle."""
    block = msd.box((3, 3, 3), 0.1, material=FOAM).translate((0.2, 0.05, 0.1))
    plate = msd.Box((0.0, 0.0, -0.05), (1.0, 1.0, 0.1), motion=lambda t: (0.0, 0.0, 0.5 * t * t))
    probes = {"plate": msd.Probe(plate, every=every)}
    simulation = msd.Simulation(block, colliders=[plate], probes=probes, device=plain_device)
    simulation.step(90)
    force = (G + 1.0) * block.mass.sum()
    values = simulation.readings["plate"].values[-1]
    # Poses are rounded in float32 to 6e-8 m: in a substep of 1 ms that is 1e-4 m/s² of 10 for a particle.
    expected = (0.0, 0.0, -force, -0.05 * force, 0.2 * force, 0.0)
    np.testing.assert_allclose(values, expected, rtol=0, atol=1e-3 * force)


def test_forces_on_all_obstacles_are_those_on_particles(plain_device):
    """Thrown into a corner that turns: what particles get, obstacles get, of opposite sign."""
    block = msd.box((3, 3, 3), 0.1, mass=1.0, stiffness=2000.0, damping=50.0).named("block")
    block = block.translate((0.0, 0.0, 0.15)).with_velocity((2.0, 0.5, -3.0))
    colliders = [
        msd.Plane(friction=0.4),
        msd.Sphere((0.4, 0.1, 0.1), 0.2, motion=lambda t: ((-t, 0.0, 0.0), (0.0, 0.0, 3.0 * t))),
    ]
    probes = {str(k): msd.Probe(one) for k, one in enumerate(colliders)}
    simulation = msd.Simulation(
        block,
        colliders=colliders,
        probes=probes | {"all": msd.Probe("block", "contact force")},
        precision="float64",
        substeps=20,
        device=plain_device,
    )
    simulation.step(30)
    on = [simulation.readings[str(k)].values[:, :3] for k in range(2)]
    size = np.abs(simulation.readings["all"].values).sum()
    assert all(np.abs(one).max() > 10.0 for one in on)
    np.testing.assert_allclose(sum(on), -simulation.readings["all"].values, rtol=0, atol=600 * 27 * EPS64 * size)


def test_in_the_plane_a_torque_is_a_number(plain_device):
    block = msd.sheet((3, 3), 0.1, mass=1.0, stiffness=2000.0, damping=50.0, dim=2).translate((0.3, 0.1))
    floor = msd.Plane()
    probes = {"floor": msd.Probe(floor)}
    simulation = msd.Simulation(block, colliders=[floor], probes=probes, device=plain_device)
    simulation.step(200)
    weight = 9 * G  # float32, as above
    expected = (0.0, -weight, -0.3 * weight)
    np.testing.assert_allclose(simulation.readings["floor"].values[-1], expected, rtol=0, atol=1e-4 * weight)
    assert probes["floor"].columns(2) == ["force_x_N", "force_y_N", "torque_N_m"]
    assert probes["floor"].columns(1) == ["force_x_N"]
    assert repr(probes["floor"]) == "Probe(Plane())"


def test_what_no_probe_on_an_obstacle_measures_is_named():
    body, floor = msd.chain(3, 0.1), msd.Plane()
    with pytest.raises(ValueError, match="what is 'position'; it must be left out for an obstacle"):
        msd.Probe(floor, "position")
    with pytest.raises(
        ValueError, match=r"what is left out.* 'foot', it must be one of 'position'.*: only an obst"
    ):
        msd.Probe("foot")
    with pytest.raises(
        ValueError, match=r"probes\['f'\].on is Plane\(\); it must be one of the scene's colliders"
    ):
        msd.Simulation(body, colliders=[msd.Plane()], probes={"f": msd.Probe(floor)}, device="cpu")
    soft = msd.Plane(stiffness=1e3)
    with pytest.raises(ValueError, match="colliders has soft ones"):
        msd.Simulation(body, colliders=[soft], probes={"f": msd.Probe(soft)}, device="cpu")
    simulation = msd.Simulation(body, colliders=[floor], probes={"f": msd.Probe(floor)}, device="cpu")
    with pytest.raises(ValueError, match="it must be one of the scene's colliders"):
        simulation.change(colliders=[msd.Sphere()])
    simulation.step()  # it is as before
