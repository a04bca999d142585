"""Settling: the equilibrium is that of SciPy, of waiting, and of closed forms; what does not settle is told."""

import numpy as np
import pytest
import volumes
from problems import forces
from statics import equilibrium

import msdwarp as msd

G = 9.82
SOFT = msd.Material(density=1000.0, youngs_modulus=1e5, damping_ratio=0.1)


def hung_cloth() -> msd.System:
    return msd.sheet((9, 9), 0.05, mass=0.001, stiffness=40.0, damping=0.01).pin([0, 8])


def cantilever(ratio: float | None = None) -> msd.System:
    material = msd.Material(density=1000.0, youngs_modulus=1e6, damping_ratio=0.1, poissons_ratio=ratio)
    system = msd.box((13, 4, 4), 0.1, material=material)
    return system.pin(system.position[:, 0] < system.position[:, 0].min() + 0.01)


def weight(system: msd.System) -> np.ndarray:
    return np.where(system.pinned, 0.0, system.mass)[:, None] * (0.0, 0.0, -G)


def held_cloth() -> msd.System:
    """Return a cloth that is held at its rim: its equilibrium is the only one, as all of it is stretched."""
    system = msd.sheet((9, 9), 0.05, mass=0.001, stiffness=40.0)
    return system.pin((np.abs(system.position[:, :2]) > 0.19).any(axis=1))


@pytest.mark.slow
@pytest.mark.parametrize("density", [1000.0, 1030.0])
def test_a_ball_between_plates_that_came_nearer_bears_what_it_bears_later(plain_device, density):
    """A step too long for the dampers of contact lets the pole tremble, sooner or later with the rounding."""

    def plates(gap: float) -> list[msd.Plane]:
        return [msd.Plane((0, 0, s), -gap / 2, friction=0.0, restitution=0.0) for s in (1.0, -1.0)]

    def force() -> float:
        return np.maximum(simulation.contact_force()[:, 2], 0.0).sum()

    body = msd.ball(0.05, 0.0125, material=msd.Material(density, 1e4, 0.1, 0.45))
    surface = msd.Contact(surface_colliders=True)
    simulation = msd.Simulation(
        body, colliders=plates(0.1), contact=surface, gravity=0.0, contact_forces=True, device=plain_device
    )
    simulation.change(colliders=plates(0.096))
    assert simulation.settle().converged
    simulation.step()
    settled = force()
    simulation.step(33)  # 0.55 s, longer than what overlaps takes to be moved apart where it is not settled
    assert settled > 0.1
    # Settled to 1e-4 of the largest force on a particle; in float32, where some dozen particles bear the force.
    assert force() == pytest.approx(settled, rel=1e-3)


def test_a_deformed_body_touches_by_the_mesh_of_its_start(plain_device):
    # Contact meshes lie a quarter of a spacing below surfaces. If that were measured anew in a deformed body,
    # forces would jump.
    body = msd.ball(0.05, 0.0125, material=SOFT)
    body = body.replace(rest_length=0.8 * body.rest_length)
    simulation = msd.Simulation(body, contact=msd.Contact(), gravity=0.0, device=plain_device)
    before = simulation.assembly.body_contact.surfaces
    simulation.settle()
    assert np.ptp(simulation.frame().position[:, 2]) < 0.9 * np.ptp(body.position[:, 2])
    after = simulation.assembly.body_contact.surfaces
    assert after is not before
    for name in ("particle", "weight"):
        np.testing.assert_array_equal(getattr(after.on_host, name), getattr(before.on_host, name))
    np.testing.assert_array_equal(after.density, before.density)


def test_the_equilibrium_is_that_of_scipy(plain_device):
    cloth, beam = held_cloth(), cantilever()
    system = cloth + beam.translate((0, 0, 2.0))
    simulation = msd.Simulation(system, device=plain_device, precision="float64")
    found = simulation.settle(1e-7)
    assert found.converged
    assert found.residual <= found.tolerance == 1e-7
    expected = equilibrium(system, weight(system), residual=1e-7)
    # Forces of 1e-7 N on each particle, against the softest modes: of 0.1 N/m in the cloth, 10 in the cantilever.
    np.testing.assert_allclose(simulation.frame().position, expected, rtol=0, atol=1e-5)
    assert simulation.time == 0.0
    assert not simulation.frame().velocity.any()
    left = forces(system, simulation.frame().position, np.zeros_like(expected)) + weight(system)
    assert np.linalg.norm(left[~system.pinned], axis=1).max() < 2e-7  # by one more substep


def test_a_chain_hangs_in_the_shape_of_its_forces(device):
    # Each link carries the weight below it on one side: a constant horizontal pull, and a vertical one that grows
    # by the weight of a particle from link to link.
    system = msd.chain(31, 0.1, mass=0.01, stiffness=1e4).pin([0, 30])
    system = system.replace(position=system.position * (0.8, 1, 1), rest_length=0.1)
    simulation = msd.Simulation(system, device=device, precision="float64")
    simulation.settle(1e-8)
    links = np.diff(simulation.frame().position, axis=0)
    length = np.linalg.norm(links, axis=1)
    pull = (1e4 * (length - 0.1) / length)[:, None] * links
    np.testing.assert_allclose(pull[:, 0], pull[0, 0], rtol=1e-5)
    np.testing.assert_allclose(np.diff(pull[:, 2]), 0.01 * G, rtol=1e-5)


@pytest.mark.parametrize("cubic", [5.0, 60.0, 6000.0])
def test_a_chain_settles_whose_springs_stiffen_fast(plain_device, cubic):
    # The steps that are stable at the start were much too long at the end, and settling diverged.
    law = msd.PolynomialSpring((1.0, 0.0, cubic))
    system = msd.chain(5, 0.1, mass=0.05, stiffness=20.0).pin([0]).replace(spring=law)
    simulation = msd.Simulation(system, precision="float64", device=plain_device)
    settled = simulation.settle()
    assert settled.converged
    length = np.linalg.norm(np.diff(simulation.frame().position, axis=0), axis=1)
    strain = length / 0.1 - 1.0
    below = 0.05 * G * np.arange(4, 0, -1)  # weight below each spring [N]
    # The forces on all particles below a spring add up to what its force lacks.
    np.testing.assert_allclose(20.0 * 0.1 * (strain + cubic * strain**3), below, atol=4 * settled.tolerance)


@pytest.mark.slow
def test_what_settles_stays(plain_device):
    resting = msd.box((4, 4, 4), 0.1, material=SOFT).translate((0, 0, 0.16))
    around = {"colliders": [msd.Plane(), msd.Sphere((2.0, 0, 0.1), 0.15)], "device": plain_device}
    scenes = {
        "on a floor": msd.Simulation(resting, **around),
        "over a ball": msd.Simulation(hung_cloth().translate((2.0, 0, 0.3)), **around),
        "a stack": msd.Simulation(resting + resting.translate((0.05, 0, 0.32)), contact=msd.Contact(), **around),
    }
    for name, simulation in scenes.items():
        assert simulation.settle().converged, name
        before = simulation.frame().position
        simulation.step(45)
        assert np.abs(simulation.frame().position - before).max() < 2e-3, name


@pytest.mark.slow
def test_cells_are_in_equilibrium_too(plain_device):
    system = cantilever(0.45)
    simulation = msd.Simulation(system, device=plain_device, precision="float64")
    simulation.settle(1e-6)
    x, still = simulation.frame().position, np.zeros_like(system.position)
    left = forces(system, x, still) + volumes.forces(system, x, still) + weight(system)
    assert np.linalg.norm(left[~system.pinned], axis=1).max() < 2e-6
    assert np.linalg.norm(volumes.forces(system, x, still), axis=1).max() > 1.0


@pytest.mark.parametrize("of_scene", [False, True])
def test_a_run_goes_on_from_the_equilibrium(of_scene):
    scene = msd.Scene(system=hung_cloth(), schedule=[msd.at(0.2, gravity=0.0)], settled=of_scene)
    simulation = msd.Simulation.from_scene(scene, device="cpu")
    begun = simulation.frame().position
    assert (begun[:, 2].min() < -0.3) == of_scene
    simulation.step(6)
    simulation.settle()
    assert simulation.time == pytest.approx(0.1)
    simulation.step(12)
    assert simulation.measure().kinetic_energy > 1e-6  # without gravity it contracts
    simulation.reset()
    np.testing.assert_array_equal(simulation.frame().position, begun)


def test_friction_holds_what_has_settled_from_the_first_frame_on():
    # A die on a slope: friction bears m g sin α, within 0.6 of what presses it on.
    die = msd.box((3, 3, 3), 0.1, mass=0.02, stiffness=2e3, damping=4.0).translate((0, 0, 0.1)).named("die")
    slab = msd.box((7, 7, 2), 0.1, mass=0.02, stiffness=2e3, damping=4.0).translate((0, 0, -0.05))
    angle, weight = np.radians(15), die.mass.sum() * 9.82
    slope = msd.Scene(
        system=slab.pin(slice(None)) + die,
        gravity=(9.82 * np.sin(angle), 0, -9.82 * np.cos(angle)),
        contact=msd.Contact(friction=0.6),
        probes={"force": msd.Probe("die", "contact force")},
    )
    expected = -weight * np.sin(angle), 0.0, weight * np.cos(angle)
    for settled in (False, True):
        simulation = msd.Simulation.from_scene(slope.replace(settled=settled), device="cpu")
        for again in (False, True):  # a settled scene starts so after a reset, too
            if again:
                simulation.reset()
            if not settled:
                simulation.settle()
            simulation.step()
            # The force on each particle may be wrong by a thousandth of its weight.
            found = simulation.readings["force"][1][-1]
            np.testing.assert_allclose(found, expected, rtol=0, atol=1e-3 * weight)


def later(time):
    """Return what a function of time has until 0.5 ms, and then rises steeply: long before a body could settle."""
    return np.clip(1e3 * (time - 5e-4), 0.0, 1.0)


def test_functions_of_time_stand_still():
    body = msd.chain(5, 0.1, mass=0.01, stiffness=100.0)
    chains = [body.pin(ends).translate((0, 3.0 * k, 0)) for k, ends in enumerate(([0, 4], [0], [0], [0, 4]))]
    system = sum(chains[1:], chains[0])
    found = []
    for value in (later, lambda time: 0.0 * time):

        def shift(time, value=value):
            return 0.0 * time, 0.0 * time, 0.01 * value(time)

        carrier = msd.Sphere((0.2, 6.0, 0), 0.05, motion=shift)
        loads = [
            msd.PrescribedMotion([9], shift),
            msd.Attachment([14], carried_by=carrier, stiffness=50.0),
            msd.Force(lambda time, value=value: (0.0 * time, 0.0 * time, 0.1 * value(time)), on=[17]),
        ]
        obstacle = msd.Sphere((0, 0, -0.06), 0.05, motion=shift)
        simulation = msd.Simulation(system, colliders=[obstacle], loads=loads, device="cpu")
        assert simulation.settle().converged
        found.append(simulation.frame().position)
    np.testing.assert_array_equal(*found)  # the same numbers by the same kernels


def test_what_falls_freely_is_told_and_stays():
    block = msd.box((2, 2, 2), 0.1, mass=0.1, stiffness=500.0).named("block")
    simulation = msd.Simulation(hung_cloth() + block.translate((0, 0, -1)), device="cpu")
    before = simulation.frame().position
    with pytest.raises(ValueError, match=r"particle .* of 'block' has moved by .* m while settling"):
        simulation.settle()
    np.testing.assert_array_equal(simulation.frame().position, before)
    # It falls two hundred times its own size before it meets a floor.
    simulation = msd.Simulation(block, colliders=[msd.Plane(offset=-20)], device="cpu")
    assert simulation.settle().converged


def test_what_does_not_settle_is_told():
    simulation = msd.Simulation(hung_cloth(), device="cpu")
    with pytest.warns(msd.SettleWarning, match=r"the largest force left is .* N, above the tolerance") as heard:
        found = simulation.settle(substeps=100)
    assert heard[0].filename == __file__
    assert not found.converged
    for wrong, said in (({"tolerance": 0.0}, "tolerance is 0"), ({"substeps": 0}, "substeps is 0")):
        with pytest.raises(ValueError, match=said):
            simulation.settle(**wrong)
    with pytest.raises(ValueError, match="no springs"):
        msd.Simulation(msd.System(position=np.eye(3)), device="cpu").settle()
