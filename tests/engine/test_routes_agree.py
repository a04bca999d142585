"""Algorithms: all give the same motion, and what is gathered repeats bit for bit."""

import numpy as np
import problems
import pytest
import warp as wp
from courses import SCENES, assert_alike, assert_course_is_plain, assert_same, course, half_the_limit, moment
from modes import METHODS
from tangles import PRECISIONS, every_route, lattices, moving

from msdwarp import Plane, Scene, Simulation, SymplecticEuler, box

# Algorithms are compared from wherever bodies start, in the floor too.
pytestmark = pytest.mark.filterwarnings("ignore::msdwarp.StartWarning")

every_method = pytest.mark.parametrize("method", METHODS.values(), ids=METHODS.keys())
gathering = pytest.mark.parametrize("force_algorithm", ["gather", "stencil"])


# Motion.


@pytest.mark.slow
@every_route
@every_method
@pytest.mark.parametrize("name", SCENES)
@pytest.mark.each_value
def test_routes_move_a_scene_alike(plain_device, name, method, force_algorithm):
    # How an algorithm sums forces depends neither on the method nor on the scene.
    found = course(moment(name), method, plain_device, force_algorithm=force_algorithm)
    # A substep rounds positions, of up to twice the body's size, by ε/2 of them: 2e-14 of the size if all 100 are
    # of one sign. Springs at half of the stable step, and contact, may stretch that, by far less than fifty.
    assert_course_is_plain(name, method, found, 1e-12)


GROUND = Plane(offset=-2.6, restitution=0.5, friction=0.3)
IRREGULAR = {
    name: Scene(system=moving(lattices(2.0)[name]).replace(mass=0.5), colliders=[GROUND])
    for name in ("ball", "two unlike boxes", "two kinds of one shape")
}


@every_route
@pytest.mark.parametrize("name", IRREGULAR)
def test_routes_move_cut_and_unlike_lattices_alike(plain_device, name, force_algorithm):
    scene = IRREGULAR[name]
    plain, _ = course(scene, SymplecticEuler(), "cpu", force_algorithm="scatter")
    found, _ = course(scene, SymplecticEuler(), plain_device, force_algorithm=force_algorithm)
    # As above, of bodies of some 8 m.
    np.testing.assert_allclose(found, plain, rtol=0, atol=8e-12)
    assert np.abs(plain[-1] - scene.system.position).max() > 0.1
    assert name != "ball" or (plain[..., 2] == GROUND.offset).any()


@pytest.mark.slow
@every_route
@pytest.mark.parametrize(("precision", "roundings"), [("float32", 10), ("float32-compensated", 4)])
def test_routes_move_a_cube_alike_in_single_precision(plain_device, precision, roundings, force_algorithm):
    method = SymplecticEuler()
    found = course(moment("cube"), method, plain_device, precision=precision, force_algorithm=force_algorithm)
    # As above, ε of the size a substep: a walk of 100 steps leads 10 away. Compensated, it is only where contact
    # puts a particle that a rounding is lost.
    assert_course_is_plain("cube", method, found, roundings * problems.EPS32)


@every_route
def test_what_positions_lose_is_seen_by_every_route(plain_device, force_algorithm):
    # In free flight, a kilometre out: positions are rounded by 3e-5 m there, and the springs do not notice.
    cube = moment("cube").system.translate((0, 0, 9.0))
    near, far = (
        Scene(system=system, colliders=moment("cube").colliders) for system in (cube, cube.translate((1e3, 0, 0)))
    )
    plain, _ = course(near, SymplecticEuler(), "cpu", force_algorithm="scatter")
    how = {"precision": "float32-compensated", "force_algorithm": force_algorithm}
    found, _ = course(far, SymplecticEuler(), plain_device, **how)
    # Forces err by a few ε of k times the spacing of ⅓ m, and h² of that on m is a share of the spacing of
    # (h ω)²/16 < 1/16: for 100 substeps of one sign 100 · 4 ε/16 · ⅓ m.
    np.testing.assert_allclose(found - (1000.0, 0, 0), plain, rtol=0, atol=100 * 4 * problems.EPS32 / 48)


# Repeatability.


@pytest.mark.slow
@gathering
@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.each_value
def test_what_is_gathered_is_repeatable(plain_device, precision, force_algorithm):
    for scene in (moment("cube"), *IRREGULAR.values()):
        first, second = (
            course(scene, SymplecticEuler(), plain_device, precision=precision, force_algorithm=force_algorithm)
            for _ in range(2)
        )
        assert_same(first, second)


@pytest.mark.slow
@every_route
@pytest.mark.parametrize("substeps", [1, 2, 5, 8])
@every_method
@pytest.mark.each_value
def test_a_launch_for_a_frame_equals_one_for_each_stage(method, substeps, force_algorithm):
    scene = moment("cube")
    fps = 1 / (substeps * half_the_limit(scene, method))
    options = {"force_algorithm": force_algorithm, "substeps": substeps, "fps": fps}
    stayed = course(scene, method, "cpu", **options)
    assert_alike(course(scene, method, "cpu", **options, blocks=None), stayed, scene, method)


@gathering
@pytest.mark.parametrize("method", [METHODS[name] for name in ("symplectic euler", "rk4", "rkc2")], ids=str)
@pytest.mark.each_value
def test_frames_may_divide_substeps_in_any_way(plain_device, method, force_algorithm):
    # After a frame the state lies where it lay before, though each substep writes it elsewhere.
    cube = moment("cube")
    ends = []
    for frames, substeps in ((1, 12), (12, 1), (4, 3), (3, 4)):
        options = {"fps": 8192 / substeps, "substeps": substeps, "precision": "float64", "device": plain_device}
        options |= {"colliders": cube.colliders, "integrator": method, "force_algorithm": force_algorithm}
        simulation = Simulation(cube.system, **options)
        assert simulation.dt == 1 / 8192
        simulation.step(frames)
        ends.append(simulation.frame()[1:])
    for other in ends[1:]:
        assert_same(other, ends[0])


def clusters() -> list[tuple[int, int]]:
    """Return clusters of blocks, where the GPU has them."""
    return [(2, 128), (8, 64)] if wp.get_device("cuda:0").arch >= 90 else []


@pytest.mark.gpu
@gathering
@every_method
def test_blocks_that_stay_equal_launches(method, force_algorithm):
    body = box((8, 8, 8), 0.1, mass=0.02, stiffness=600.0, damping=5.0).with_velocity((0.3, 0, -2.0))
    scene = Scene(system=body.rotate(0.3, (1, 2, 0)).translate((0, 0, 0.6)), colliders=moment("cube").colliders)
    courses = []
    for blocks in (None, (1, 128), (1, 512), *clusters()):
        courses.append(course(scene, method, "cuda:0", force_algorithm=force_algorithm, blocks=blocks))
    for other in courses[1:]:
        assert_same(other, courses[0])


@pytest.mark.gpu
def test_blocks_that_stay_scatter_as_launches_do():
    # Atomics add in any order: equal to roundings, as above.
    for blocks in (None, (1, 128), *clusters()):
        found = course(moment("cube"), SymplecticEuler(), "cuda:0", force_algorithm="scatter", blocks=blocks)
        assert_course_is_plain("cube", SymplecticEuler(), found, 1e-12)
