"""What is no argument at all is named at the call: by the argument, what it was, and what is allowed."""

import re

import numpy as np
import pytest

import msdwarp as msd
from msdwarp import checks

BODY = msd.chain(3)
HUGE = 10**400
"""A whole number beyond all floats."""


def scene(**options) -> msd.Scene:
    return msd.Scene(system=BODY, **options)


def simulate(**options) -> msd.Simulation:
    return msd.Simulation(BODY, device="cpu", **options)


def renderer(**options) -> msd.Renderer:
    return msd.Renderer(scene(), BODY.position, **({"backend": "raycast", "resolution": (64, 64)} | options))


TEXT = [
    (lambda: msd.at("1"), "time is '1'; it must be a number of at least 0"),
    (lambda: BODY.rotate("1"), "angle is '1'; it must be a number from"),
    (
        lambda: BODY.rotate((0, 0, 90)),
        "angle is (0, 0, 90); it must be a number [rad], with the axis as the second",
    ),
    (lambda: BODY.rotate(1.0, axis="xyz"), "axis must be an array of numbers, not 'xyz'"),
    (lambda: msd.chain(3, mass=True), "mass must be an array of numbers, not True"),
    (lambda: msd.ball(True, 0.1), "radius is True; it must be a number above 0"),
    (lambda: msd.chain(3, mass=[1, "2", 3]), "mass must be an array of numbers, not [1, '2', 3]"),
    (lambda: msd.chain(3, mass=np.array(["1", "2", "3"])), "mass must be an array of numbers, not array(['1'"),
    (lambda: simulate(refresh="no"), "refresh is 'no'; it must be one of False, True"),
    (lambda: simulate(allow_unstable="no"), "allow_unstable is 'no'; it must be one of False, True"),
]
HUGE_NUMBERS = [
    (lambda: msd.chain(3, mass=HUGE), "mass must be an array of numbers up to 1.8e+308, not 1000"),
    (lambda: msd.chain(3, mass=10**5000), "mass must be an array of numbers up to 1.8e+308, not a whole number"),
    (lambda: msd.chain(3, mass=[1, HUGE, 1]), "mass must be an array of numbers up to 1.8e+308, not [1, 1000"),
    (lambda: msd.chain(3, spacing=HUGE), "spacing is 1000"),
    (lambda: BODY.rotate(HUGE), "angle is 1000"),
    (lambda: msd.chain(HUGE), "count is 1000"),
    (lambda: msd.from_mesh(msd.icosphere(1.0, 0), across=HUGE), "across is 1000"),
]
TYPES = [
    (lambda: msd.Scene(system=3), "system is 3; it must be a System, such as chain(5)"),
    (lambda: msd.stability_limit(3, msd.RK4()), "system is 3; it must be a System, such as chain(5)"),
    (lambda: msd.stability_limit(BODY, 3), "integrator is 3; it must be an Integrator, such as RK4()"),
    (lambda: BODY.replace(directions=3), "directions is 3; it must be a sequence of Mapping"),
    (lambda: BODY.replace(directions=[3]), "directions[0] is 3; it must be a Mapping, such as {'x': slice(0, 4)}"),
    (lambda: BODY.replace(directions=[{"x": 3}]), "directions[0]['x'] is 3; it must be a slice, such as slice("),
    (
        lambda: BODY.replace(directions=[{"x": slice(None)}]),
        "directions[0]['x'] is slice(None, None, None); its start and stop must be whole numbers of at least 0",
    ),
    (lambda: BODY.replace(directions=[{3: 3}]), "a name in directions[0] is 3; it must be a str, such as 'x'"),
    (lambda: msd.Simulation.from_scene(BODY), "it must be a Scene, such as Scene(system=chain(5))"),
    (lambda: BODY.replace(surface=3), "surface is 3; it must be a Surface"),
    (lambda: msd.System(position=[[0.0]], groups=3), "groups is 3; it must be a Mapping"),
    (lambda: BODY.named(3), "name is 3; it must be a str"),
    (lambda: BODY.direction("x", 3), "body is 3; it must be one of -1, 0"),
    (lambda: simulate(colliders=msd.Plane()), "colliders is Plane(); it must be a sequence of Collider objects"),
    (lambda: simulate(colliders=[msd.Plane(), msd.Plane(motion=lambda: 0)]), "colliders[1] has no place at 0 s: "),
    (lambda: simulate(gravity=lambda t: (1, (1, 2))), "gravity has no value at 0 s: "),
    (lambda: simulate(schedule=3), "schedule is 3; it must be a sequence of Change objects, such as [at("),
    (lambda: simulate(precision=np.array([1, 2])), "precision is array([1, 2]); it must be one of 'float32'"),
    (lambda: msd.chain(3, mass=[1, None, 3]), "mass must be an array of numbers, not [1, None, 3]"),
    (lambda: msd.chain(3, mass=1j), "mass must be an array of numbers, not 1j"),
    (lambda: msd.Plane(restitution=[0.5]), "restitution is [0.5]; it must be a number from 0 to 1"),
    (lambda: scene(look="red"), "look is 'red'; it must be a Look"),
    (lambda: scene(gravity=(0, 1)), "gravity has shape (2,); it must be a number or have shape (3,)"),
    (lambda: msd.chain(3, dim=True), "dim is True; it must be one of 1, 2, 3"),
    (lambda: simulate().gradient(3, 1), "loss is 3; it must be a function of the frames"),
    (
        lambda: msd.Ensemble(BODY, 2, threads=(1, 1), device="cpu"),
        "threads is (1, 1); it must be a whole number of at least 1",
    ),
    (lambda: scene(colliders=[msd.Sphere((0, 0), 1.0)]), "colliders[0].position is (0.0, 0.0); it must have 3"),
]
ARRAYS = [  # whose truth value NumPy does not tell
    (lambda: simulate(threads=np.ones(2)), "threads is array([1., 1.]); it must be a whole number of at least 1"),
    (lambda: simulate(threads=10**9), "threads is 1000000000; it must be at most 1024"),
    (lambda: simulate(probes=np.ones(2)), "probes is array([1., 1.]); it must be"),
    (lambda: simulate(blocks=np.ones(2)), "blocks is array([1., 1.]); it must be 'auto', None, or (blocks,"),
    (lambda: msd.chain(3, material=msd.CORK, area=np.ones(2)), "area is array([1., 1.]); it must be a number"),
    (lambda: msd.von_mises([1.0, 2.0]), "stress has shape (2,); it must be (..., d, d), with d = 1, 2 or 3"),
    (
        lambda: BODY.replace(mass=np.ma.array(np.ones(3), mask=[False, True, False])),
        "mass has masked entries; it must be an array of numbers, none of them masked",
    ),
    (
        lambda: msd.Ensemble(BODY, 2, mass=[[1.0], [1.0, 2.0]], device="cpu"),
        "mass must be an array of numbers, not [[1.0], [1.0, 2.0]]",
    ),
]
SELECTIONS = [
    (lambda: BODY.pin([]), "selection is []; it must name one particle at least"),
    (lambda: BODY.pin(BODY.position[:, 0] > 9), "it must name one particle at least"),
    (lambda: BODY.replace(groups={"a": []}).pin("a"), "selection is 'a'; it must name one particle at least"),
    (
        lambda: msd.join(BODY, BODY, within=1.0, stiffness=1.0, on=([], None)),
        "on[0] is []; it must name one particle at least",
    ),
    (lambda: simulate(gravity=-9.82), "gravity is -9.82; a number is downwards, and must be at least 0; upwards"),
    (lambda: simulate().change(gravity=-1.0), "gravity is -1; a number is downwards"),
    (lambda: scene(gravity=-9.82), "gravity is -9.82; a number is downwards"),
    (lambda: msd.Ensemble(BODY, worlds=2, gravity=[1.0, -9.82], device="cpu"), "gravity"),
    (lambda: BODY.pin(None), "selection does not index 3 particles: it is None; it must be indices, a slice or a"),
    (lambda: BODY.pin([[0], [1, 2]]), "selection does not index 3 particles"),
    (lambda: BODY.pin([0, 1, 1]), "selection holds 0 and 1 for each of 3 particles"),
    (lambda: BODY.pin(np.array([0, 0, 1], dtype=np.uint8)), "a mask must be of booleans, such as mask == 1"),
    (lambda: BODY.replace(groups={"a": [0, 0, 1]}), "groups['a'] holds 0 and 1 for each of 3 particles"),
    (lambda: BODY.replace(groups={3: [0]}), "a group's name is 3; it must be a str"),
    (lambda: simulate().change(group=[0, 1, 1], mass=2.0), "group holds 0 and 1 for each of 3 particles"),
    (lambda: msd.at(1.0, group=[0], set_rest_shape="no"), "set_rest_shape is 'no'; it must be one of False, True"),
]
WORLD = [
    (lambda: msd.Sphere(radius=0.0), "radius is 0; it must be a number above 0"),
    (lambda: msd.Sphere("here"), "position must be an array of numbers, not 'here'"),
    (lambda: msd.Box(size=(1, 0, 1)), "size is (1, 0, 1)"),
    (lambda: msd.Box(size=(1, 1)), "size is (1, 1); it must be 3 numbers above 0"),
    (lambda: msd.Box(turn=(0, 1)), "turn is (0, 1); it must be 3 finite numbers"),
    (lambda: msd.Box(turn=(0, np.nan, 0)), "turn is (0, nan, 0)"),
    (lambda: msd.Box((0, 0), (1, 1), np.nan), "turn is [nan]; it must be a finite number"),
    (lambda: msd.Box((0, 0), (1, 1), (0, 0, 1)), "turn is [(0, 0, 1)]; it must be a finite number"),
    (lambda: msd.Box((0,), (1,), 0.5), "turn is 0.5; in one dimension nothing turns"),
    (lambda: msd.Capsule((0, 0, 0), (0, 0, 0)), "end is (0.0, 0.0, 0.0); it must be another point than start"),
    (lambda: msd.Capsule((0, 0), (1,)), "end is (1.0,); it must be another point than start, with as many"),
    (lambda: msd.Cone((0, 0, 0), (0, 0, 0)), "base is (0.0, 0.0, 0.0); it must be another point than apex"),
    (lambda: msd.Sphere(motion=(0, 0, 1)), "motion is (0, 0, 1); it must be a function of time"),
    (lambda: msd.Cone(restitution=2.0), "restitution is 2.0"),
    (lambda: msd.Contact(restitution=0.04), "restitution is 0.04"),
    (lambda: msd.Contact(restitution=1.1), "restitution is 1.1"),
    (lambda: msd.Contact(self_contact="some"), "self_contact is 'some'; it must be one of False, True"),
    (lambda: msd.Contact(thickness=0), "thickness is 0; it must be a number above 0"),
    (lambda: msd.Contact(stiffness=0.0), "stiffness is 0"),
    (lambda: msd.Contact(groups="die"), "groups is 'die'; it must be two names of groups"),
    (lambda: msd.Contact(groups=("die",)), "groups is ('die',); it must be two names"),
    (lambda: msd.Contact(groups=(1, 2)), "groups is (1, 2); it must be two names"),
    (lambda: msd.Contact(surface_colliders="no"), "surface_colliders is 'no'; it must be one of False, True"),
    (lambda: msd.Contact(on="die"), "on is 'die'; the bodies are given by groups"),
    (lambda: msd.at(-1.0), "time is -1; it must be a number of at least 0, and finite"),
    (lambda: msd.at(np.nan), "time is nan"),
    (lambda: msd.at("soon"), "time is 'soon'"),
    (lambda: msd.at(1.0, color=1.0), "parameter is 'color'; it must be one of 'mass', 'velocity', 'stiffness'"),
    (lambda: msd.at(1.0, pin="hand", mass=1.0), "pin is given beside other changes of a group"),
    (lambda: msd.at(1.0, set_rest_shape=True, rest_length=1.0), "set_rest_shape sets rest_length"),
]
PICTURES = [
    (lambda: msd.Look(path=[msd.Viewpoint(time=1.0), msd.Viewpoint(time=1.0)]), "path has the times [1.0, 1.0]"),
    (lambda: msd.Look(path=[msd.Viewpoint(time=np.nan)]), "path[0] is nan; it must be finite"),
    (lambda: msd.Look(path=[0.0]), "path[0] is 0.0; it must be a Viewpoint"),
    (lambda: msd.Look(path=[msd.Viewpoint(time=0.0, azimuth=400.0)]), "azimuth is 400.0; it must be from -360 to"),
    (lambda: msd.Look(follow="a", path=[msd.Viewpoint(time=0, target=(0, 0, 1))]), "it must be None where the"),
    (lambda: msd.Look(field_of_view=0.5), "field_of_view is 0.5; it must be from 1 to 120"),
    (lambda: msd.Look(color="red"), "color is 'red'"),
    (lambda: msd.Look(texture=np.zeros((4, 4), np.uint8)), "texture has shape (4, 4)"),
    (lambda: msd.Look(full_strain=0), "full_strain is 0"),
    (lambda: msd.Look(obstacle="blue"), "obstacle is 'blue'"),
    (
        lambda: msd.Look(obstacle_texture=np.zeros((4, 4, 3))),
        "obstacle_texture has shape (4, 4, 3) and type float64",
    ),
    (lambda: msd.Look(strain="yes"), "strain is 'yes'"),
    (lambda: msd.Look(target=(1, 2)), "target is (1.0, 2.0); it must have 3 coordinates"),
    (lambda: msd.Look(distance=0), "distance is 0; it must be a number above 0"),
    (lambda: msd.Look(target=(1, 2, 3), follow="b"), "it must be None where the camera follows 'b'"),
    (lambda: scene(look=msd.Look(follow="d")), "look.follow is 'd'; it must be one of those that exist"),
    (lambda: msd.Look(gloss="1"), "gloss is '1'; it must be a number from 0 to 1"),
    (lambda: msd.Look(obstacle_gloss=-1), "obstacle_gloss is -1.0; it must be from 0 to 1"),
    (lambda: msd.Look(finish="wood"), "finish is 'wood'; it must be one of 'matt', 'rubber', 'metal', 'glass'"),
    (lambda: msd.Look(smooth="yes"), "smooth is 'yes'; it must be one of False, True"),
    (lambda: msd.Look(particles=np.array([1, 2])), "particles is array([1, 2]); it must be one of None, False"),
    (lambda: scene(looks=3), "looks is 3; it must be a mapping"),
    (lambda: msd.Renderer(3, BODY.position), "scene is 3; it must be a Scene"),
    (lambda: renderer(resolution=3), "resolution is 3; it must be two whole numbers, width and height"),
    (lambda: renderer(resolution=("64", 64)), "resolution is '64'; it must be a whole number"),
    (lambda: msd.Renderer(scene(), "here"), "positions must be an array of numbers, not 'here'"),
    (lambda: msd.Renderer(scene(), BODY.position[:, :2]), "positions has shape (3, 2); it must be (..., 3), wit"),
    (
        lambda: msd.Renderer(scene(), [msd.Frame(0.0, BODY.position, BODY.position)]),
        "positions must be an array of numbers, not [Frame(",
    ),
    (lambda: renderer().image("here"), "position must be an array of numbers, not 'here'"),
    (lambda: renderer().image(BODY.position, "1"), "time is '1'; it must be a number"),
]


@pytest.mark.parametrize(
    ("call", "message"),
    [*TEXT, *HUGE_NUMBERS, *TYPES, *ARRAYS, *SELECTIONS, *WORLD, *PICTURES],
    ids=lambda one: one[:40] if isinstance(one, str) else "",
)
def test_what_is_no_argument_is_named_at_the_call(call, message):
    with pytest.raises(ValueError, match=re.escape(message)) as told:
        call()
    assert len(str(told.value)) < 400  # of what is long only its ends are shown


def test_numbers_of_all_kinds_are_numbers():
    from decimal import Decimal
    from fractions import Fraction

    for one in (1, 1.0, Fraction(1), Decimal(1), np.float32(1), np.int8(1), np.array(1.0)):
        assert msd.chain(3, mass=one).mass[0] == 1.0
        assert msd.at(one, mass=2.0).time == 1.0
        assert msd.EnclosedGas(2.0, outside=one).outside == 1.0
        np.testing.assert_allclose(np.linalg.norm(msd.icosphere(one, 0)[0], axis=1), 1.0)
    assert msd.chain(3, mass=10**17).mass[0] == 1e17


@pytest.mark.parametrize(
    "selection", [[0, 1], (0, 1), [-3, 1], slice(2), [True, True, False], np.array([[0], [1]])]
)
def test_particles_are_selected(selection):
    np.testing.assert_array_equal(BODY.pin(selection).pinned, [True, True, False])


def test_indices_that_are_no_mask_stay_indices():
    pair = msd.chain(2)
    np.testing.assert_array_equal(pair.pin([0, 1]).pinned, [True, True])  # both, each once
    np.testing.assert_array_equal(BODY.pin(0).pinned, [True, False, False])
    np.testing.assert_array_equal(BODY.pin([2, 2, 1]).pinned, [False, True, True])


def test_a_scene_keeps_what_it_was_given_once():
    made = scene(colliders=(one for one in [msd.Plane()]), schedule=[msd.at(1.0, mass=2.0)])
    assert len(made.colliders) == len(made.schedule) == 1
    assert made.ground is made.colliders[0]


def test_arrays_may_be_used_again_for_other_numbers():
    """What was given stays as it was, also for changes that are made later."""
    gravity, mass, group = np.array([0.0, 0.0, -1.0]), np.full(2, 3.0), [0, 1]
    made = scene(gravity=gravity, schedule=[msd.at(0.1, mass=mass, group=group, gravity=gravity)])
    run = simulate(gravity=gravity)
    gravity[:], mass[:], group[1] = 7.0, -1.0, 2
    for kept in (made.gravity, made.schedule[0].gravity, run.gravity):
        np.testing.assert_array_equal(kept, [0.0, 0.0, -1.0])
    np.testing.assert_array_equal(made.schedule[0].applied_to(BODY).mass, [3.0, 3.0, 1.0])
    with pytest.raises(ValueError, match="read-only"):
        run.gravity[2] = 5.0


POSITIVE = (lambda values: values > 0, "above 0")


@pytest.mark.parametrize(
    ("given", "shape", "message"),
    [
        (-3.0, (4,), r"^k is -3; it must be above 0$"),
        (-3, (1,), r"^k is -3; it must be above 0$"),
        (-0.25, (4,), r"^k is -0.25; it"),
        (1e300 * -1e10, (4,), r"^k is -inf; it"),
        ([1.0, -3.0, 1.0], (3,), r"^k\[1\] is -3.0; it"),
        ([-3.0] * 3, (3,), r"^k\[0\] is -3.0; it"),  # an array was given, though of one number
        ([1.0, 2.0, -3.0], (5, 3), r"^k\[2\] is -3.0; it"),  # a row for all
        ([[1.0, 1.0, 1.0], [1.0, 1.0, -3.0]], (2, 3), r"^k\[1, 2\] is -3.0; it"),
        ([[1.0], [-2.0]], (2, 3), r"^k\[1\] is -2.0; it"),
    ],
)
def test_what_was_given_is_named(given, shape, message):
    with pytest.raises(ValueError, match=message):
        checks.within("k", checks.broadcast("k", given, shape), POSITIVE)


def test_an_entry_is_named_where_it_alone_may_not_be_what_all_are():
    # The same velocity for all, and the second particle may not have it.
    values = np.broadcast_to([0.0, 3.0], (3, 2))
    holds = np.array([[True, True], [True, False], [True, True]])
    with pytest.raises(ValueError, match=r"^velocity\[1, 1\] is 3.0; it must be 0: it is pinned$"):
        checks.every("velocity", values, holds, "0: it is pinned")


def test_bodies_name_their_numbers():
    with pytest.raises(ValueError, match=r"^stiffness is -3; it must be at least 0$"):
        msd.box((2, 2, 2), stiffness=-3.0)
    with pytest.raises(ValueError, match=r"^mass\[1\] is -1.0; it must be above 0"):
        msd.chain(3, mass=[1.0, -1.0, 1.0])
