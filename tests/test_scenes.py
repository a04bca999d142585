"""The scenes that come with msdwarp: each is short, does what it says, and can be seen."""

import ast
import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
from played import build, simulate

import msdwarp as msd
from msdwarp.engine.stepping.start_checks import start_inside

FOLDER = Path(__file__).parents[1] / "scenes"
NAMES = sorted(path.stem for path in FOLDER.glob("[!_]*.py"))


@pytest.mark.parametrize("name", NAMES)
def test_a_scene_is_a_short_file_that_says_what_it_shows(name):
    source = (FOLDER / f"{name}.py").read_text(encoding="utf-8")
    assert source.count("\n") <= 60
    tree = ast.parse(source)
    assert ast.get_docstring(tree).endswith(".")
    assert "scene_main(build)" in source


@pytest.mark.parametrize(
    "name", [n if n in ("chain", "cloth", "worm") else pytest.param(n, marks=pytest.mark.slow) for n in NAMES]
)
def test_a_scene_is_seen(name):
    scene = build(name)
    position = scene.system.position
    image = msd.Renderer(scene, position, resolution=(320, 180)).image(position)
    corner = image[0, 0].astype(int)
    seen = np.abs(image.astype(int) - corner).max(axis=2) > 30
    assert 0.01 < seen.mean() < 0.9  # neither a blank picture nor one that is filled


@pytest.mark.slow
def test_the_cube_bounces_and_comes_to_rest():
    scene = build("cube")
    frames = simulate(scene, scene.duration)
    height = np.array([frame.position[:, 2].mean() for frame in frames])
    lowest = np.array([frame.position[:, 2].min() for frame in frames])
    contact = int(np.argmax(lowest <= 0.0))
    assert 0 < contact < len(frames)
    assert height[contact:].max() > height[contact] + 0.05  # it leaves the floor again, by centimetres
    assert lowest.min() >= -1e-6  # a particle is put back on the plane, to float32 rounding
    speed = np.sqrt((frames[-1].velocity ** 2).sum(axis=1).mean())
    assert speed < 0.05 * 5.0  # it was thrown on the floor at about 5 m/s
    # On a face it stands half a metre high and sags; on an edge it would be at 0.7.
    assert 0.4 < height[-1] < 0.55


def test_the_cloth_hangs_by_three_points_and_swings():
    scene = build("cloth")
    system = scene.system
    (pins,) = np.nonzero(system.pinned)
    assert len(pins) == 3
    frames = simulate(scene, scene.duration)
    np.testing.assert_array_equal(frames[-1].position[pins], system.position[pins].astype(np.float32))
    y = np.array([frame.position[:31, 1].mean() for frame in frames])  # of the free edge
    swings = np.count_nonzero(np.diff(np.sign(y - system.position[pins, 1].mean())))
    assert swings >= 3
    strain = [system.replace(position=frame.position, velocity=0.0).strain for frame in frames[::20]]
    # Cloth, not rubber: only at the pins, which carry all of it on a few threads, does it stretch further.
    assert np.quantile(np.array(strain)[:, system.between_neighbors], 0.99) < 0.15


def test_the_worm_buckles_and_falls():
    scene = build("worm")
    frames = simulate(scene, scene.duration)
    bend = []
    for frame in frames:
        middle = frame.position.reshape(-1, 4, 3).mean(axis=1)
        chord = middle[-1] - middle[0]
        arm = middle - middle[0]
        off = arm - np.outer(arm @ chord / (chord @ chord), chord)
        bend.append(np.linalg.norm(off, axis=1).max())
    standing = [frame.position[:, 2].max() > 1.5 for frame in frames]
    assert max(b for b, s in zip(bend, standing, strict=True) if s) > 0.2  # bent while it stands
    assert frames[-1].position[:, 2].max() < 0.5  # lies


@pytest.mark.slow
def test_the_worm_crawls_by_its_own_length_if_it_finds_hold():
    scene = build("crawl")
    path = np.array([frame.position.mean(axis=0) for frame in simulate(scene, 9.0)])
    assert path[-1, 0] - path[0, 0] > 2.4
    assert np.ptp(path[:, 1]) < 0.01  # straight on
    assert (np.diff(path[120::60, 0]) > 0.2).all()  # by each wave
    ice = dataclasses.replace(scene, colliders=[msd.Plane(friction=0.0)])
    path = np.array([frame.position.mean(axis=0) for frame in simulate(ice, 3.0)])
    assert np.ptp(path[:, 0]) < 1e-4  # nothing outside pushes it: 5000 sums in float32


@pytest.mark.slow
def test_the_cube_walks_on_its_legs():
    scene = build("walker")
    start = scene.system.position
    top, sole = start[:, 2] > 0.5, start[:, 2] < 0.05
    feet = [sole & (x * start[:, 0] > 0) & (y * start[:, 1] > 0) for x in (-1, 1) for y in (-1, 1)]
    position = np.array([frame.position for frame in simulate(scene, scene.duration)])
    path = position[:, top].mean(axis=1)
    assert path[-1, 0] - path[0, 0] > 1.6  # twice its width
    assert (np.diff(path[120::40, 0]) > 0.15).all()  # by each step
    assert np.abs(path[:, 1]).max() < 0.4  # about straight on
    assert np.ptp(path[120:, 2]) < 0.1  # it neither hops nor falls
    height = np.array([position[120:, foot, 2].mean(axis=1) for foot in feet])
    assert (height.max(axis=1) > 0.02).all()  # every foot leaves the ground
    together = np.corrcoef(height)
    assert min(together[0, 3], together[1, 2]) > 0.5 > together[0, 1]  # as a horse trots


@pytest.mark.slow
def test_the_robot_walks_as_it_has_learned():
    scene = build("robot")
    position = np.array([frame.position for frame in simulate(scene, scene.duration)])
    stride = round(60 * 2 * math.pi / 10)  # frames of a period of its muscles
    path = position[..., 0].mean(axis=1)
    assert path[-1] - path[0] > 0.8  # four times its length
    assert (np.diff(path[::stride]) > 0.05).all()  # by each stride
    # It learned in substeps of 2 ms and walks in those of 3.3, a fifth less far than in the limit of short ones.
    # A gait that used their length, learned on a floor that sticks at once, lost two fifths.
    finer = simulate(scene, scene.duration, substeps=40)[-1].position[:, 0].mean() - path[0]
    assert finer == pytest.approx(path[-1] - path[0], rel=0.25)
    edges = position[:, [(0, 1, 3), (1, 4, 3), (1, 5, 4), (1, 2, 5)]]
    (x, y), (u, v) = (np.moveaxis(edges[:, :, k] - edges[:, :, 0], -1, 0) for k in (1, 2))
    area = x * v - y * u
    assert (area / area[0]).min() > 0.3  # nothing is inside out: strains of 0.1 bend it as far as to a half
    assert position[..., 1].min() > 0.1 - 0.02  # it presses a soft ground by some millimetres


def left_alone(simulation):
    """Return positions after a second without gravity or obstacles, all motion stopped: the shape that is kept."""
    free = simulation.snapshot().replace(velocity=0.0, yield_strain=np.inf)
    rested = msd.Simulation(free, gravity=0.0, device="cpu")
    rested.step(60)
    return rested.frame().position


def test_the_chain_comes_to_rest_where_the_report_says():
    scene = build("chain")
    assert scene.system.dim == 1
    frames = simulate(scene, 40.0)  # the slowest mode decays as exp(−0.19 t): to 5e-4
    np.testing.assert_allclose(frames[-1].position[:, 0], [0.7, 1.7, 2.7, 3.7, 4.7], atol=2e-3)


def test_the_block_in_two_dimensions_falls_on_its_corner():
    scene = build("block2d")
    assert scene.system.dim == 2
    frames = simulate(scene, scene.duration)
    lowest = [frame.position[:, 1].min() for frame in frames]
    hit = frames[int(np.argmax(np.array(lowest) <= 0.05))].position  # a bounce begins up to a substep early
    assert np.argmin(hit[:, 1]) in (0, 3, 12, 15)
    assert np.count_nonzero(hit[:, 1] < 0.3) == 1
    assert max(np.abs(scene.system.replace(position=f.position, velocity=0.0).strain).max() for f in frames) > 0.05


@pytest.mark.slow
def test_the_dice_come_to_rest_on_their_faces():
    scene = build("dice")
    # The throw is chaotic: rounding decides how long the last one rolls. Of six throws the longest took 7 s.
    frames = simulate(scene, 12.0)
    assert np.abs(frames[-1].velocity).max() < 0.05
    height = np.sort(frames[-1].position[:, 2].reshape(-1, 27))
    # They sag by their weight, 0.5 kg on springs of 4e4 N/m: hundredths of a millimetre.
    np.testing.assert_allclose(height, np.broadcast_to(np.repeat([0.0, 0.15, 0.3], 9), height.shape), atol=1e-3)
    path = np.array([frame.position.reshape(-1, 27, 3).mean(axis=1) for frame in frames])
    assert path[..., 0].max() < 0.85  # the walls' inner sides
    assert path[..., 1].max() < 1.5


@pytest.mark.slow
def test_the_scoop_sags_over_the_rim_and_keeps_its_shape():
    scene = build("ice_cream")
    simulation = msd.Simulation.from_scene(scene, device="cpu")
    simulation.step(240)
    assert simulation.frame().position[:, 2].min() < -0.03  # below the rim
    kept = left_alone(simulation)
    flatness = np.ptp(kept[:, 2]) / np.ptp(kept[:, 0])
    assert flatness < 0.85 * 1.0  # it was a ball


@pytest.mark.slow
def test_rubber_bulges_in_the_press_and_foam_does_not():
    scene = build("press", across=6)
    frames = simulate(scene, scene.duration)
    groups, cells = scene.system.groups, scene.system.cells
    size = {
        name: np.array([np.ptp(frame.position[one], axis=0) for frame in frames]) for name, one in groups.items()
    }
    ratios = np.array([cells.volumes(frame.position) / cells.rest_volume for frame in frames])
    of_rubber = cells.corners[:, 0] < len(groups["rubber"])
    squeezed = 60 * 2 - 1
    for name in groups:
        assert size[name][squeezed, 2] == pytest.approx(0.3, rel=0.02)
    # A ball that kept its volume as an ellipsoid would be 1.41 times as wide; pressed flat it is nearer a
    # cylinder, of the same volume, 1.15 times as wide.
    assert 1.15 < size["rubber"][squeezed, 1] / 0.6 < 1.41
    assert size["foam"][squeezed, 1] < size["rubber"][squeezed, 1] - 0.02
    volume = cells.rest_volume
    kept = [np.average(ratios[squeezed, one], weights=volume[one]) for one in (of_rubber, ~of_rubber)]
    assert 0.85 < kept[0] < 1.0
    assert kept[1] < kept[0] - 0.1
    assert ratios.min() > 0.0  # nothing is inside out
    # Afterwards both are balls again, at rest.
    for name in groups:
        np.testing.assert_allclose(size[name][-1], size[name][0], atol=0.025)
    assert np.abs(frames[-1].velocity).max() < 0.05


@pytest.mark.slow
def test_the_tyre_climbs_the_kerb_and_stays_a_tyre():
    scene = build("tyre", across=11)
    frames = simulate(scene, scene.duration)
    shape = np.array([np.ptp(frame.position, axis=0) for frame in frames])
    assert shape[:, 2].min() < 0.9 * shape[0, 2]  # flat for a moment
    cells = scene.system.cells
    ratio = np.array([(cells.volumes(frame.position) / cells.rest_volume) for frame in frames])
    assert ratio.min() > 0.3  # nothing is inside out
    np.testing.assert_allclose(ratio.mean(axis=1), 1.0, atol=0.05)  # its rubber keeps its volume
    last = scene.system.surface.points(frames[-1].position)
    assert last[:, 0].min() > 0.0  # it is on the pavement, upright
    assert last[:, 2].min() > 0.08 - 0.01  # contact is soft
    assert abs(last[:, 1].mean()) < 0.02


@pytest.mark.slow
def test_the_jelly_wobbles_and_sags_when_it_is_warm():
    scene = build("jelly")
    frames = simulate(scene, scene.duration)
    position = np.array([frame.position for frame in frames])
    start = position[0]
    top, bottom = start[:, 2] > start[:, 2].max() - 0.1, start[:, 2] < start[:, 2].min() + 0.1
    sway = position[:, top, 0].mean(axis=1) - position[:, bottom, 0].mean(axis=1)
    assert np.ptp(sway[:180]) > 0.03
    assert np.ptp(position[-1, :, 2]) < 0.9 * np.ptp(position[235, :, 2])
    # Nothing starts inside its tray, or so far above it that it falls: no energy comes from the start.
    how = ~scene.system.pinned, np.zeros(scene.system.particle_count)
    assert start_inside(scene.system, scene.colliders, *how, depenetrates=True) is None
    assert 0 <= start[:, 2].min() - 0.12 < 1e-9
    # Where connections are shorter than half of what they are at rest, cells are turned inside out.
    ends = position[-1][scene.system.connections]
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    assert (length / scene.system.rest_length).min() > 0.5


@pytest.mark.slow
def test_the_spinner_turns_over_and_over():
    scene = build("spinner")
    simulation = msd.Simulation.from_scene(scene, device="cpu", precision="float64")
    start = simulation.measure()
    grid = np.arange(90).reshape(2, 5, 9)
    upright = []
    for frame in simulation.frames(scene.duration):
        axis = frame.position[grid[:, -1]].mean(axis=(0, 1)) - frame.position[grid[:, 0]].mean(axis=(0, 1))
        upright.append(axis[2] / np.linalg.norm(axis))
    turns = np.count_nonzero(np.diff(np.sign(upright)))
    assert turns >= 3
    end = simulation.measure()
    # Central forces between pairs change no angular momentum: rounding only.
    np.testing.assert_allclose(end.angular_momentum, start.angular_momentum, atol=1e-9)


@pytest.mark.slow
def test_the_soft_cube_flattens_at_the_wall():
    scene = build("soft_cube")
    frames = simulate(scene, scene.duration)
    wall = scene.colliders[1]
    out = np.array([-math.cos(wall.turn[1]), 0.0, math.sin(wall.turn[1])])
    deep = np.array([np.ptp(frame.position @ out) for frame in frames])
    assert deep.min() < 0.75 * deep[0]
    away = np.array([((frame.position - wall.position) @ out).min() for frame in frames]) - wall.size[0] / 2
    assert away.min() > -1e-3
    # It slides: from the hit on it stays at the wall till it is down.
    down = next(k for k, frame in enumerate(frames) if frame.position[:, 2].min() < 1e-3)
    hit = int(np.argmax(away < 1e-3))
    assert (away[hit:down] < 0.03).all()
    assert frames[hit].position[:, 2].mean() - frames[down].position[:, 2].mean() > 0.4


@pytest.mark.slow
def test_the_waffle_keeps_its_bend():
    scene = build("waffle")
    simulation = msd.Simulation.from_scene(scene, device="cpu")
    simulation.step(round(scene.duration * simulation.fps))
    kept = left_alone(simulation).reshape(2, 8, 10, 3).mean(axis=(0, 1))  # along its length
    first, last = kept[3] - kept[0], kept[-1] - kept[-4]
    angle = np.arccos(first @ last / np.linalg.norm(first) / np.linalg.norm(last))
    assert angle > 0.1


@pytest.mark.slow
def test_the_ball_leaves_a_dent_in_the_mattress():
    scene = build("mattress")
    # With fixed substeps, a third more than small motions need, as it is pressed deep: that raises no alarm.
    few = msd.Simulation.from_scene(scene, device="cpu").substeps
    simulation = msd.Simulation.from_scene(scene, device="cpu", substeps=math.ceil(1.33 * few))
    simulation.step(round(3.9 * simulation.fps))  # it rolls off after 3.0 s
    foam = scene.system.group("mattress")
    left = left_alone(simulation)[foam].reshape(5, 13, 25, 3)
    top = left[-1, 2:-2, 2:-2, 2]  # without the edges: the ball presses one as it rolls off
    deepest = np.unravel_index(np.argmin(top), top.shape)
    assert deepest[0] in (3, 4, 5)
    assert 13 < deepest[1] < 21  # 0.3 to 0.8 m from the middle
    edges = [np.diff(left, axis=k)[tuple(slice(None if j == k else -1) for j in range(3))] for k in (2, 1, 0)]
    cells = np.linalg.det(np.stack(edges, axis=-1))
    assert cells.min() > 0.2 * 0.08**3  # none is inside out
    # Half of a layer. A stiff contact of drawn surfaces dents it by 47 mm. Here the load enters a quarter of a
    # layer below the top: these 20 mm, which yield by a third, are pressed less.
    assert top.min() < np.median(top) - 0.04
    ball = simulation.frame().position[~foam].mean(axis=0)
    assert ball[0] > 1.0 + 0.28  # it has rolled off: half of the mattress's length, and its own radius


@pytest.mark.slow
def test_the_wire_springs_back_but_not_all_the_way():
    scene = build("wire", size=3)
    frames = simulate(scene, scene.duration)
    lowest = np.array([frame.position[:, 2].min() for frame in frames])
    pressed, left = lowest.min(), lowest[-1]
    assert pressed + 0.01 < left < lowest[0] - 0.2


@pytest.mark.gpu
@pytest.mark.parametrize("name", NAMES)
def test_the_gpu_in_float32_agrees_with_the_cpu_in_float64(name):
    scene = build(name)
    size = np.ptp(scene.system.position, axis=0).max()
    substeps = msd.Simulation.from_scene(scene, device="cpu").substeps
    # When something breaks, rounding decides on what follows; where bodies touch, on which side of an edge.
    duration = 0.1 if scene.contact else 0.25 if scene.system.tears else 0.5
    exact = simulate(scene, duration, precision="float64", substeps=substeps)
    rounded = simulate(scene, duration, device="cuda:0", substeps=substeps)
    for a, b in zip(exact, rounded, strict=True):
        # float32 rounding of 6e-8 a substep, over some 400 of them, grown by the motion
        assert np.abs(a.position - b.position).max() < 1e-4 * size
