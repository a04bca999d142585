"""The scenes that come with msdwarp: each is short, does what it says, and can be seen."""

import ast
import dataclasses
import importlib
from pathlib import Path

import numpy as np
import pytest
from statics import equilibrium

import msdwarp as msd

FOLDER = Path(__file__).parents[1] / "scenes"
NAMES = sorted(path.stem for path in FOLDER.glob("[!_]*.py"))


def build(name, **parameters):
    return importlib.import_module(f"msdwarp.scenes.{name}").build(**parameters)


def simulate(scene, duration, **options):
    return list(msd.Simulation.of(scene, **{"device": "cpu", **options}).frames(duration))


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
    position = simulate(scene, 0.1)[-1].position
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
    touch = int(np.argmax(lowest <= 0.0))
    assert 0 < touch < len(frames)
    assert height[touch:].max() > height[touch] + 0.05  # it leaves the floor again, by centimetres
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
    assert np.quantile(np.array(strain)[:, system.between_neighbours], 0.99) < 0.15


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
    path = np.array([frame.position.mean(axis=0) for frame in simulate(scene, scene.duration)])
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
    hit = frames[int(np.argmax(np.array(lowest) <= 0.0))].position
    assert np.argmin(hit[:, 1]) in (0, 3, 12, 15)
    assert np.count_nonzero(hit[:, 1] < 0.3) == 1
    assert max(np.abs(scene.system.replace(position=f.position, velocity=0.0).strain).max() for f in frames) > 0.05


@pytest.mark.slow
def test_the_dice_come_to_rest_on_their_faces():
    scene = build("dice")
    frames = simulate(scene, scene.duration)
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
    simulation = msd.Simulation.of(scene, device="cpu")
    simulation.step(240)
    assert simulation.frame().position[:, 2].min() < -0.03  # below the rim
    kept = left_alone(simulation)
    flatness = np.ptp(kept[:, 2]) / np.ptp(kept[:, 0])
    assert flatness < 0.85 * 1.0  # it was a ball


@pytest.mark.slow
def test_the_jelly_wobbles_and_sags_when_it_is_warm():
    scene = build("jelly")
    frames = simulate(scene, scene.duration)
    position = np.array([frame.position for frame in frames])
    start = position[0]
    top, bottom = start[:, 2] > start[:, 2].max() - 0.1, start[:, 2] < start[:, 2].min() + 0.1
    sway = position[:, top, 0].mean(axis=1) - position[:, bottom, 0].mean(axis=1)
    assert np.ptp(sway[:180]) > 0.03
    assert np.ptp(position[-1, :, 2]) < 0.8 * np.ptp(position[235, :, 2])


@pytest.mark.slow
def test_the_spinner_turns_over_and_over():
    scene = build("spinner")
    simulation = msd.Simulation.of(scene, device="cpu", precision="float64")
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


def test_the_soft_cube_flattens_at_the_wall():
    scene = build("soft_cube")
    frames = simulate(scene, scene.duration)
    deep = np.array([np.ptp(frame.position[:, 0]) for frame in frames])
    assert deep.min() < 0.75 * deep[0]
    assert max(frame.position[:, 0].max() for frame in frames) < 0.501  # the wall's face


def test_the_waffle_keeps_its_bend():
    scene = build("waffle")
    simulation = msd.Simulation.of(scene, device="cpu")
    simulation.step(round(scene.duration * simulation.fps))
    kept = left_alone(simulation).reshape(2, 8, 10, 3).mean(axis=(0, 1))  # along its length
    first, last = kept[3] - kept[0], kept[-1] - kept[-4]
    angle = np.arccos(first @ last / np.linalg.norm(first) / np.linalg.norm(last))
    assert angle > 0.1


@pytest.mark.slow
def test_the_ball_leaves_a_dent_in_the_mattress():
    scene = build("mattress")
    simulation = msd.Simulation.of(scene, device="cpu")
    simulation.step(round(scene.duration * simulation.fps))
    top = left_alone(simulation).reshape(5, 13, 25, 3)[-1, :, :, 2]
    deepest = np.unravel_index(np.argmin(top), top.shape)
    assert deepest[0] in (5, 6, 7)
    assert 15 < deepest[1] < 21  # 0.3 m from the middle
    assert top.min() < np.median(top) - 0.05


@pytest.mark.slow
def test_the_wire_springs_back_but_not_all_the_way():
    scene = build("wire")
    frames = simulate(scene, scene.duration)
    lowest = np.array([frame.position[:, 2].min() for frame in frames])
    pressed, left = lowest.min(), lowest[-1]
    assert pressed + 0.01 < left < lowest[0] - 0.2


@pytest.mark.gpu
@pytest.mark.parametrize("name", NAMES)
def test_the_gpu_in_float32_agrees_with_the_cpu_in_float64(name):
    scene = build(name)
    size = np.ptp(scene.system.position, axis=0).max()
    substeps = msd.Simulation.of(scene, device="cpu").substeps
    duration = 0.3 if scene.system.tears else 0.5  # when something breaks, rounding decides on what follows
    exact = simulate(scene, duration, precision="float64", substeps=substeps)
    rounded = simulate(scene, duration, device="cuda:0", substeps=substeps)
    for a, b in zip(exact, rounded, strict=True):
        # float32 rounding of 6e-8 a substep, over some 400 of them, grown by the motion
        assert np.abs(a.position - b.position).max() < 1e-4 * size


def test_the_chain_snaps_where_and_when_its_weak_link_bears_no_more():
    # Let go at the pin's height, a pendulum of 1 kg pulls with 3 m g cos(angle): with 2.4 m g at 37 degrees.
    scene = build("snap")
    simulation = msd.Simulation.of(scene, device="cpu", fps=240)
    while not simulation.snapshot().broken.any():
        simulation.step()
        assert simulation.time < 1.0
    assert np.flatnonzero(simulation.snapshot().broken).tolist() == [3]
    across, _, down = simulation.frame().position[-1] - simulation.frame().position[0]
    # Waves on a chain that weighs 1.4 % of the weight change the pull by some of the root of that, 12 %.
    assert -down / np.hypot(across, down) == pytest.approx(0.8, rel=2 * 0.12)


@pytest.mark.slow
def test_the_cookie_breaks_in_two():
    scene = build("cookie")
    simulation = msd.Simulation.of(scene, device="cpu")
    simulation.step(120)
    now = simulation.snapshot()
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    whole, n = now.connections[~now.broken], now.particle_count
    _, piece = connected_components(coo_array((np.ones(len(whole)), whole.T), shape=(n, n)))
    sizes = np.sort(np.bincount(piece))
    assert sizes[-2] > 0.3 * n  # crumbs apart
    assert now.position[:, 2].max() < 0.3
    assert np.linalg.norm(now.velocity, axis=1).mean() < 0.05


@pytest.mark.slow
def test_the_ball_tears_the_cloth_on_from_its_cut():
    scene = build("tear")
    simulation = msd.Simulation.of(scene, device="cpu")
    simulation.step(80)
    now, system = simulation.snapshot(), scene.system
    torn = now.broken & ~system.broken
    order = np.argsort(np.where(torn, now.broken_at, np.inf))[:20]
    middle = system.position[system.connections[order]].mean(axis=1)
    tip = (0.0, 1.5 * 0.4 - 0.75, 1.0)
    assert np.linalg.norm(middle - tip, axis=1).max() < 0.2  # it goes on at the end of the cut
    assert torn.sum() > 50


@pytest.mark.slow
def test_the_flag_flutters_on_to_the_end():
    scene = build("flag")
    frames = simulate(scene, scene.duration)
    position = np.array([frame.position for frame in frames]).reshape(len(frames), 25, 37, 3)  # time, up, along
    np.testing.assert_array_equal(position[:, :, 0], np.broadcast_to(position[0, :, 0], position[:, :, 0].shape))
    settled = position[120:]
    each_second = settled[:240].reshape(4, 60, 25, 37, 3)
    assert np.ptp(each_second[:, :, :, -1, 1], axis=1).min() > 0.2  # all of its free edge, in every second
    assert settled[:, :, -1, 0].mean() > 1.2  # of 1.5 m: it streams, and is not crumpled
    across = settled[:, 12, :, 1] - settled[:, 12, :, 1].mean(axis=0)  # of the middle thread
    swings = np.count_nonzero(np.diff(np.sign(across[:, -1])))
    assert 1 < swings / (2 * 4.0) < 10  # a second: faster than the wind veers, and no trembling
    # What grows are waves that run along with the wind and slower than it: then it pushes where they give way.
    likeness = [np.corrcoef(across[:-30, 18], across[lag : len(across) - 30 + lag, -1])[0, 1] for lag in range(30)]
    speed = 0.75 * 60 / np.argmax(likeness)
    assert 0.4 * 6.0 < speed < 6.0
    strain = scene.system.replace(position=frames[-1].position, velocity=0.0).strain
    assert np.quantile(np.abs(strain[scene.system.between_neighbours]), 0.99) < 0.1  # cloth, not rubber


@pytest.mark.slow
def test_the_balloons_stay_blown_up_and_lean_in_a_steady_wind_as_statics_say():
    scene = build("balloon")
    drag, density, speed = 0.235, 1.225, 2.0
    steady = msd.Wind((speed, 0.0, 0.0), drag=drag, lift=0.0)
    loads = [steady, *(one for one in scene.loads if not isinstance(one, msd.Wind))]
    frames = simulate(dataclasses.replace(scene, loads=loads), 3.0)
    system, corner = scene.system, scene.system.surface.particle[scene.system.surface.triangles]
    position = np.array([frame.position for frame in frames], dtype=np.float64)
    start, settled = position[0], position[-1]
    gases = [one for one in scene.loads if isinstance(one, msd.Gas)]
    for gas, mooring in zip(gases, np.flatnonzero(system.pinned), strict=True):
        mine = system.group(gas.on)
        a, b, c = np.moveaxis(settled[corner[mine[corner].all(axis=1)]] - settled[mine].mean(axis=0), 1, 0)
        a0, b0, c0 = np.moveaxis(start[corner[mine[corner].all(axis=1)]] - start[mine].mean(axis=0), 1, 0)
        now, before = (np.einsum("td,td->", p, np.cross(q, r)) / 6 for p, q, r in ((a, b, c), (a0, b0, c0)))
        assert now == pytest.approx(before, rel=0.01)
        # The virial of the springs, Σ f l, balances that of the pressure, 3 p V, some 5 J, and the string's, 0.3 N
        # at 0.27 m: 2 % of it. What is left is the gas law; in it 1e-5 of the volume is 1 Pa, 2 % of the pressure.
        own = mine[system.connections].all(axis=1)
        length = np.linalg.norm(np.subtract(*np.moveaxis(settled[system.connections[own]], 1, 0)), axis=1)
        virial = (system.stiffness[own] * (length - system.rest_length[own]) * length).sum()
        assert virial / (3 * now) == pytest.approx((101_325 + gas.pressure) * before / now - 101_325, rel=0.04)
        # The string points where the force at its foot does: the drag on what is seen along the wind, from both
        # sides, to what is left of the lift there, less the string's weight. It still swings by 0.05 m/s, which
        # changes the drag by 5 % to and fro; in the mean over a second by less.
        area = 0.5 * np.abs(np.cross(b - a, c - a)[:, 0]).sum()
        across, _, up = (position[-60:, mooring + 1] - position[-60:, mooring]).mean(axis=0)  # it sings a little
        string = system.mass[mooring + 1] * 9.82 * (np.flatnonzero(mine)[0] - mooring - 1)
        assert across / up == pytest.approx(0.5 * density * drag * area * speed**2 / (0.25 - string), rel=0.03)


@pytest.mark.slow
def test_the_bridge_sags_as_statics_say():
    scene = build("bridge")
    system = scene.system
    frames = simulate(scene, scene.duration)
    lowest = np.array([frame.position[system.group("ropes"), 2].min() for frame in frames])
    weight = np.zeros_like(system.position)
    weight[~system.pinned, 2] = -9.82 * system.mass[~system.pinned]
    before = equilibrium(system, weight)
    for name in ("first", "second", "third"):
        water = system.group(name)
        weight[water, 2] -= 9.82 * 70.0 / np.count_nonzero(water)
    full = equilibrium(system, weight)
    ropes = system.group("ropes")
    assert full[ropes, 2].min() < before[ropes, 2].min() - 0.1  # they are heavy
    sag = -full[ropes, 2].min()
    assert np.ptp(lowest[-30:]) < 1e-3 * sag  # it has come to rest, but for so much: hence the tolerances below
    assert -lowest[-1] == pytest.approx(sag, rel=1e-3)
    assert np.abs(frames[-1].position - full).max() < 1e-3 * sag  # and so has the whole shape
    # And by the textbook, which knows of the springs only how hard they pull: ropes sag by the bending moment of a
    # beam under these weights, over their horizontal pull. Ropes alone cross this cut: no planks, and no tubs.
    x, z = frames[-1].position.astype(np.float64)[:, [0, 2]].T
    pull, deep = [], []
    for end in range(0, 4 * 36, 36):
        a, b = end + 14, end + 15
        link = np.flatnonzero((system.connections == (a, b)).all(axis=1))[0]
        length = np.linalg.norm(frames[-1].position[b] - frames[-1].position[a])
        pull.append(system.stiffness[link] * (length - system.rest_length[link]) * (x[b] - x[a]) / length)
        deep.append(z[end] - (z[a] + z[b]) / 2)
    down, cut = -weight[:, 2], (x[a] + x[b]) / 2
    moment = (down * (7.0 - x)).sum() / 7.0 * cut - (down * np.clip(cut - x, 0.0, None)).sum()
    assert np.dot(pull, deep) == pytest.approx(moment, rel=1e-3)  # as much as it still swings
