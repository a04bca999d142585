"""What is doubtful about a start is said when a simulation is made, once, and what is not is not."""

import math
import re
import warnings

import numpy as np
import pytest

import msdwarp as msd


def simulate(system: msd.System, *colliders, **options) -> msd.Simulation:
    return msd.Simulation(system, colliders=colliders, device="cpu", **options)


def cube(height: float = 0.0, **options) -> msd.System:
    """Return a cube of 0.2 m on a spacing of 0.1 m, whose lowest particles are at this height [m]."""
    body = msd.box((3, 3, 3), 0.1, mass=0.01, stiffness=100.0, **options)
    return body.translate((0, 0, height - body.position[:, 2].min()))


# Inside an obstacle


@pytest.mark.parametrize(
    ("collider", "depth"),
    [
        (msd.Plane(), 0.05),
        (msd.Sphere((0, 0, -0.45), 0.5), 0.1),
        (msd.Box((0, 0, -0.45), (1, 1, 1)), 0.1),
        (msd.Capsule((-1, 0, -0.45), (1, 0, -0.45), 0.5), 0.1),
        (msd.Cone((0, 0, -1), (0, 0, 0), 2.0), 0.05),
        (msd.Box((5, 0, -0.45), (1, 1, 1), motion=lambda t: (-5, 0, 0)), 0.1),
        (msd.Box((0, 0, -0.45), (1, 1, 1), motion=lambda t: ((0, 0, 0), (math.pi / 2, 0, 0))), 0.1),
    ],
    ids=lambda one: type(one).__name__ if not isinstance(one, float) else "",
)
def test_what_starts_inside_is_named(collider, depth):
    told = rf"starts {depth:g} m inside colliders\[1\], a {type(collider).__name__} .*deepest.*strain its.*or pin"
    with pytest.warns(msd.StartWarning, match=told) as all_told:
        simulate(cube(-0.05), msd.Plane(offset=-9), collider)
    assert len(all_told) == 1
    assert all_told[0].filename == __file__  # where the simulation is made, at least by a function of the user's


@pytest.mark.parametrize(
    "collider",
    [
        msd.Box((0, 0, 0.1), (1, 1, 1)),
        msd.Box((0, 0, 0.1), (9, 9, 0.4)),  # a wall, out of which half of it would go up and half of it down
        msd.Sphere((0, 0, 0.1), 0.5),
        msd.Box((5, 0, 0.1), (1, 1, 1), motion=lambda t: (-5, 0, 0)),
    ],
    ids=["box", "wall", "sphere", "moving"],
)
def test_a_body_that_would_be_torn_on_its_way_out_is_refused(collider):
    told = rf"the body of particle 4 starts wholly inside colliders\[1\], a {type(collider).__name__}: .*tear it"
    with pytest.raises(ValueError, match=told):
        simulate(msd.System(position=np.full((4, 3), 3.0)) + cube(), msd.Plane(offset=-9), collider)


@pytest.mark.slow
def test_a_body_near_one_side_of_a_box_is_led_out_whole():
    with pytest.warns(msd.StartWarning, match=r"starts 0.25 m inside colliders\[0\], a Box"):
        simulation = simulate(cube(-0.25, damping=1.0), msd.Box((0, 0, -1), (4, 4, 2), restitution=0.0))
    simulation.step(45)  # half as long again as it is led out
    position = simulation.frame().position
    assert position[:, 2].min() > -0.001  # what counts as touching is a hundredth of the spacing
    # It rests, and sags: 18 particles of 0.1 N weigh on 9 columns of some 100 N/m, which is 2 mm of 0.2 m.
    assert np.ptp(position, axis=0) == pytest.approx(0.2, rel=0.02)


@pytest.mark.parametrize(
    ("thick", "warned"), [(0.1, True), (0.15, True), (0.6, False)], ids=["one cell", "a cell and a half", "thick"]
)
@pytest.mark.parametrize("contact", [None, msd.Contact(surface_colliders=True)], ids=["particles", "surface"])
def test_a_plate_through_a_body_is_told_when_it_is_put_there(thick, warned, contact):
    # A cube of 0.2 m on a floor: a plate from 0.05 m on that is thinner than the rest of it has particles on both
    # sides, and a thick one leads all of them down.
    simulation = simulate(cube(), msd.Plane(), contact=contact)
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        simulation.change(colliders=[msd.Plane(), msd.Box((0, 0, 0.05 + thick / 2), (1, 1, thick))])
    assert [one.category for one in told] == [msd.StartWarning] * warned
    if warned:
        assert "leave colliders[1], a Box, on opposite sides" in str(told[0].message)
        assert told[0].filename == __file__
    pinned = simulate(cube().pin(slice(None)))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        pinned.change(colliders=[msd.Box((0, 0, 0.05 + thick / 2), (1, 1, thick))])


def test_particle_and_depth_are_those_of_the_deepest():
    points = msd.System(position=[[0.0, 0.3], [0.0, -0.2], [0.0, 0.5]])
    with pytest.warns(
        msd.StartWarning, match=r"^particle 1 starts 0.2 m inside colliders\[0\], a Plane: if it"
    ) as told:
        simulate(points, msd.Plane())
    assert "connections" not in str(told[0].message)  # there are none
    with pytest.warns(msd.StartWarning, match=r"^particle 0 starts 0.3 m inside colliders\[0\], a Box: "):
        simulate(msd.System(position=[[0.2, 0.0], [0.9, 0.0]]), msd.Box((0.0, 0.0), (1.0, 1.0)))


@pytest.mark.parametrize("depth", [0.0, 1e-7, 0.9e-3], ids=lambda depth: f"{depth:g} m")
def test_what_touches_is_not_inside(depth):
    # A hundredth of the shortest rest length, 0.1 m, is what putting back may stretch a connection by.
    simulate(cube(-depth), msd.Plane()).step()
    simulate(msd.System(position=[[0.0, 0.0, -depth]]), msd.Plane()).step()
    # Far from the origin it is as exact as places are.
    simulate(msd.System(position=[[1e4, 0.0, 1e4 - 1e-3]]), msd.Plane(offset=1e4)).step()


@pytest.mark.slow
def test_what_is_pinned_may_be_inside():
    row = msd.chain(3, spacing=0.1).pin(0).translate((0.0, 0.0, 0.05))
    simulate(row, msd.Sphere(tuple(row.position[0]), 0.05)).step()
    simulate(row.pin([0, 1, 2]), msd.Plane(offset=9)).step()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        simulate(cube().pin(slice(None)), msd.Box((0, 0, 0.1), (1, 1, 1)))


def test_what_was_said_is_not_said_again():
    with pytest.warns(msd.StartWarning) as told:
        simulation = simulate(cube(-0.05), msd.Plane(), schedule=[msd.at(0.02, stiffness=200.0)], refresh=True)
    assert len(told) == 1
    simulation.step(3)
    simulation.change(stiffness=100.0)
    simulation.reset()
    simulation.step(3)


def test_a_divergence_of_what_started_inside_says_so():
    with pytest.warns(msd.StartWarning):
        simulation = simulate(cube(-0.15), msd.Plane(), substeps=1, allow_unstable=True)
    with pytest.raises(
        msd.SimulationDiverged, match=r"particle \d+ starts 0.15 m inside colliders\[0\], a Plane"
    ) as told:
        simulation.step(30)
    assert "stretching" not in str(told.value)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("apart", "self_contact", "told"),
    [
        (0.08, False, r"^the body of particle 0 starts 0\.\d+ m inside that of particle 8 \("),
        (None, True, "inside itself"),
    ],
)
def test_bodies_in_each_other_and_in_themselves_are_named(apart, self_contact, told):
    if apart is None:  # a strip whose ends lie in each other
        system = msd.sheet((7, 3), 0.1, stiffness=100.0)
        folded = system.position.copy()
        middle = folded[:, 0].mean()
        folded[:, 2] = 0.01 * (folded[:, 0] > middle)
        folded[:, 0] = abs(folded[:, 0] - middle)
        system = system.replace(position=folded)
    else:
        body = msd.box((2, 2, 2), 0.1, stiffness=100.0)
        system = body + body.translate((apart, 0.0, 0.0))
    with pytest.warns(msd.StartWarning, match=told):
        msd.Simulation(system, contact=msd.Contact(self_contact=self_contact), device="cpu")


# Far from the origin


@pytest.mark.parametrize(("far", "apart"), [(1e6, 0.062), (-1e6, 0.062), (2e4, 0.002)])
def test_a_body_far_away_is_named_in_float32(far, apart):
    body = cube().translate((far, 0, 0))
    told = (
        rf"reaches to {abs(far):.3g} m from the origin, where numbers of float32 are {apart:g} m apart .*float64"
    )
    with pytest.warns(msd.StartWarning, match=told.replace("+", r"\+")) as all_told:
        simulation = simulate(body)
    simulation.change(stiffness=90.0)
    assert len(all_told) == 1


def test_what_precision_bears_is_not_named():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        simulate(cube().translate((500.0, 0, 0)))
        simulate(cube().translate((1e6, 0, 0)), precision="float64")
        simulate(cube().translate((1e6, 0, 0)), precision="float32-compensated")
        simulate(msd.System(position=np.full((1, 3), 1e6)))  # it has no strain


@pytest.mark.parametrize("substeps", ["auto", 60])
def test_what_is_led_out_without_gravity_is_no_divergence(substeps):
    # Where nothing else moves, the energy of being led out is all there is.
    body = msd.box((3, 3, 3), 0.1, mass=0.01, stiffness=200.0, damping=1.0).translate((0, 0, -0.15))
    with pytest.warns(msd.StartWarning):
        simulation = msd.Simulation(body, colliders=[msd.Plane()], gravity=0.0, substeps=substeps, device="cpu")
    simulation.step(60)
    assert simulation.frame().position[:, 2].min() > 0


# Units


def test_a_body_in_millimetres_is_told():
    for spacing in (1000.0, 1e-7):
        with pytest.warns(msd.UnitWarning, match=re.escape(f"0 is {2 * spacing:.3g} m long")) as told:
            simulate(msd.chain(3, spacing))
        assert told[0].filename == __file__
    near = msd.chain(3, 400.0)
    simulate(near + near.translate((5000.0, 0.0, 0.0)), precision="float64")  # both are shorter than 1 km
    simulate(msd.System(position=[[0.0], [1e4]]), precision="float64")  # which is no body


def test_a_density_in_other_units_is_told():
    for density in (1.2, 1e6):
        with pytest.warns(msd.UnitWarning, match=re.escape(f"density is {density:g} kg/m³; solids")) as told:
            msd.Material(density=density, youngs_modulus=1e5)
        assert told[0].filename == __file__
    msd.Material(density=10.0, youngs_modulus=1e5)
