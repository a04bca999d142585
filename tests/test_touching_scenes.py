"""Scenes whose bodies touch, or a cloth itself: what is in the way of something stays in its way."""

import numpy as np
import pytest
from played import build, simulate

import msdwarp as msd
from benchmarks.accuracy.crossings import Oracle, crossings


@pytest.mark.slow
def test_a_ball_knocks_a_cube_out_of_the_tower_and_the_others_stay():
    scene = build("tower")
    frames = simulate(scene, scene.duration)
    groups = scene.system.groups
    way = {
        name: np.ptp([frames[k].position[which].mean(axis=0) for k in (0, -1)], axis=0)
        for name, which in groups.items()
    }
    assert np.hypot(*way["cube 2"][:2]) > 1.5  # it was struck
    assert np.hypot(*way["cube 1"][:2]) < 0.1  # it stood below
    assert np.sqrt((frames[-1].velocity ** 2).sum(axis=1).mean()) < 0.01 * 6.0  # of the speed of the ball
    # At rest all lie on the floor beside each other: a cube's middle is half its width above, and it sags.
    for name in list(groups)[1:]:
        assert frames[-1].position[groups[name], 2].mean() == pytest.approx(0.2, abs=0.01)


@pytest.mark.slow
def test_the_trampoline_throws_the_ball_up_again_without_letting_it_through():
    scene = build("trampoline")
    ball = scene.system.group("ball")
    frames = simulate(scene, 2.4)
    height = np.array([frame.position[ball, 2].mean() for frame in frames])
    bed = np.array([frame.position[~ball, 2].min() for frame in frames])
    assert (height - bed > 0.15).all()  # its radius is 0.25; it is soft
    first = int(np.argmin(height[:60]))
    assert height[:60].min() < height[0] - 1.2
    again = height[first : first + 60].max()
    # Bed and ball are hardly damped; what it loses goes to waves of the bed, and to dampers.
    assert 0.6 < (again - 0.8) / (height[0] - 0.8) < 1.0


@pytest.mark.slow
def test_momentum_goes_through_the_cradle():
    scene = build("cradle")
    frames = simulate(scene, 1.5)
    centre = np.array(
        [f.position.reshape(5, -1, 3)[:, 2:].mean(axis=1) for f in frames]
    )  # each has two pins first
    lifted = centre[0, 0, 2] - centre[0, 1, 2]
    assert lifted == pytest.approx(1 - np.cos(np.radians(40)), abs=1e-4)  # on strings of 1 m up to the pins' plane
    risen = centre[:, :, 2].max(axis=0) - centre[0, 1:, 2].min()
    # Linear springs in a row leave some of the momentum behind, less the wider the gaps are.
    assert risen[4] > 0.85 * lifted
    assert (centre[40:, 1:4, 2].max(axis=0) - centre[0, 1:4, 2] < 0.02 * lifted).all()
    assert (centre[40:75, 0, 2] - centre[0, 1, 2] < 0.02 * lifted).all()  # the one that fell has stopped


@pytest.mark.slow
def test_the_curtain_hides_the_ball_and_comes_to_lie_on_the_floor():
    pytest.importorskip("ipctk")
    # Of half as many particles, each twice as heavy: the same cloth.
    scene = build("curtain", size=19, mass=0.0018)
    system = scene.system
    ball = system.group("ball")
    last = simulate(scene, scene.duration + 0.5)[-1]  # folds that are held apart come to rest a little later
    cloth = last.position[~ball].astype(np.float64)
    drawn = system.surface.particle[system.surface.triangles]
    drawn = drawn[~ball[drawn].any(axis=1)]
    middles = last.position[drawn].mean(axis=1)
    centre = system.position[ball].mean(axis=0)
    # Facets of a ball whose corners lie on a sphere are up to 1 % of its radius inside it.
    assert np.linalg.norm(np.concatenate([cloth, middles]) - centre, axis=1).min() > 0.99 * 0.26
    above = cloth[:, 2] > centre[2]
    assert np.abs(cloth[above, :2] - centre[:2]).max() < 0.6  # of 0.99: it hangs down all around ...
    assert np.count_nonzero(cloth[:, 2] < 0.02) > 0.1 * len(cloth)  # ... and lies on the floor with its rim
    assert np.sqrt((last.velocity**2).sum(axis=1).mean()) < 0.03 * 3.0  # of the speed at which it fell
    assert not Oracle(system).crosses(last.position)  # nor does it cut through itself


@pytest.mark.slow
def test_what_is_poured_stays_in_the_box_and_lies_on_each_other():
    scene = build("pile", count=14)
    frames = simulate(scene, 1.5)
    bodies = scene.system.groups.values()
    centre = np.array([[frame.position[which].mean(axis=0) for which in bodies] for frame in frames])
    assert np.abs(centre[..., :2]).max() < 0.62 - 0.05  # the walls' inner sides, and half of the thinnest body
    assert centre[..., 2].min() > 0.03
    # On the floor the highest would have its middle at most 0.2 m up, being 40 cm wide at most.
    assert centre[-1, :, 2].max() > 0.2
    assert np.sqrt((frames[-1].velocity ** 2).sum(axis=1).mean()) < 0.1 * 3.0  # it fell at 3 m/s


@pytest.mark.slow
def test_the_bowl_holds_its_scoops():
    scene = build("bowl")
    last = simulate(scene, scene.duration)[-1]
    groups = scene.system.groups
    start, end = scene.system.position, last.position
    for k in range(4):
        middle = end[groups[f"scoop {k + 1}"]].mean(axis=0)
        # Inside the rim, which is 0.39 m from the axis. The upper one lies on the others, 0.45 m up at the most.
        assert np.hypot(*middle[:2]) < (0.3 if k < 3 else 0.1)
        assert (0.2 < middle[2] < 0.45) == (k < 3)
    # It is pressed wide, by millimetres, and stands on its base still.
    rim = scene.system.group("bowl") & (start[:, 2] > 0.35)
    assert np.hypot(*end[rim, :2].T).mean() > np.hypot(*start[rim, :2].T).mean() + 0.001
    assert np.abs(end[groups["bowl"], :2].mean(axis=0)).max() < 0.02
    # Ice cream keeps the shape that it was pressed into.
    scoop = end[groups["scoop 1"]]
    assert np.linalg.svd(scoop - scoop.mean(axis=0), compute_uv=False)[[0, 2]] @ (1, -1.2) > 0
    assert np.sqrt((last.velocity**2).sum(axis=1).mean()) < 0.03 * 2.0  # of the speed at which they fell


PERIOD = 1.5
"""How long it takes to squeeze the cloth once, and to let go again [s]."""


def crossing_frames(times: int, contact: msd.Contact | None, bending: float = 4e-3) -> list[int]:
    """Squeeze a cloth so many times; return the frames in which triangles of it go through each other."""
    pytest.importorskip("ipctk")
    spacing = 0.05
    cloth = msd.sheet((13, 7), spacing, mass=0.002, stiffness=60.0, damping=0.05, bending=bending)
    cloth = cloth.translate(tuple(np.array([0, 0, 0.01]) - cloth.position.min(axis=0)))
    along = cloth.position[:, 0]
    length = np.ptp(along)

    def squeeze(t):
        """Bring one end to within a third of the length of the other, and back."""
        return 0.7 * length * (np.cos(2 * np.pi * np.asarray(t)[..., None] / PERIOD) - 1) / 2 * np.array([1, 0, 0])

    scene = msd.Scene(
        system=cloth.pin(along < 0.5 * spacing),
        colliders=[msd.Plane(restitution=0.0, friction=0.5)],
        loads=[msd.PrescribedMotion(np.flatnonzero(along > length - 0.5 * spacing), squeeze)],
        contact=contact,
    )
    simulation = msd.Simulation.from_scene(scene, device="cpu")
    return crossings(simulation, round(times * PERIOD * simulation.fps))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("times", "bending", "thickness"),
    [(4, 4e-3, 0.02), (2, 1e-3, None)],
    ids=["four times", "softer, and of its own thickness"],
)
def test_a_cloth_folded_on_itself_again_and_again_does_not_cross_itself(times, bending, thickness):
    # Its end moves at 0.9 m/s at most. At 1.3 m/s it collapses into creases sharper than its triangles, which
    # cross (docs/contact.md). More often, and at other speeds, benchmarks/accuracy/folding.py folds it.
    contact = msd.Contact(friction=0.3, restitution=0.1, self_contact=True, thickness=thickness)
    assert crossing_frames(times, contact, bending) == []


@pytest.mark.slow
def test_without_contact_the_same_folds_go_through_each_other():
    assert crossing_frames(1, None)
