"""Contact's lists: against all pairs, and a matter of speed alone. What touches repeats to the last bit."""

import numpy as np
import pytest
from listing import search_always
from surfaces import nearest_distances

from msdwarp import (
    RK4,
    Contact,
    Plane,
    Probe,
    Simulation,
    StepWarning,
    System,
    box,
    chain,
    checks,
    icosphere,
    join,
    sheet,
    shell,
)
from msdwarp.engine.collision import neighbor_list as nearby, room as lists, skin as skin_module
from msdwarp.engine.collision.body_contact import BodyContact
from msdwarp.engine.stepping import pace
from msdwarp.simulation import stepping


def contact_of(simulation: Simulation) -> BodyContact:
    return next(effect for effect in simulation.assembly.all if isinstance(effect, BodyContact))


def rows_of(simulation: Simulation) -> list[list[int]]:
    """Return the facets that are listed for each point after a search, by their numbers."""
    effect, state = contact_of(simulation), simulation.state
    effect.hold(0.0)
    effect.search(state.x, state.v, state.compensation, 0.0, False, True)
    rows, lengths = effect.neighbors.data.candidates.numpy(), effect.neighbors.data.candidate_count.numpy()
    assert lengths.max() < rows.shape[1]  # all had room
    return [sorted(rows[p, :n, 3].tolist()) for p, n in enumerate(lengths)]


def grains(count: int, size: float) -> System:
    position = np.random.default_rng(1).uniform(0, size, (count, 3))
    return System(position=position, connections=np.zeros((0, 2), int), mass=0.01)


def crowd() -> System:
    """Return a block, a ball, sheets and a rope, turned and close together, some of them in each other."""
    constants = {"mass": 0.02, "stiffness": 500.0, "damping": 0.5}
    parts = [
        box((3, 3, 4), 0.1, **constants).rotate(0.5, axis=(1, 2, 3)),
        shell(icosphere(0.2, 1), stiffness=100.0).translate((0.3, 0.1, 0.2)),
        sheet((5, 4), 0.1, **constants).rotate(0.4, axis=(1, 0, 0)).translate((0.1, 0, 0.25)),
        sheet((4, 4), 0.1, **constants).translate((0.1, 0.0, 0.27)),
        chain(6, 0.1, **constants).rotate(1.0, axis=(0, 1, 1)).translate((0.1, 0.2, 0.0)),
        box((3, 3, 2), 0.1, **constants).translate((0.1, 0.22, 0.1)),
        box((2, 2, 2), 0.1, **constants).translate((0.1, 0.35, 0.1)),
    ]
    folded = sheet((6, 3), 0.1, **constants)
    x = folded.position - folded.position.mean(axis=0)
    over = np.where(x[:, :1] > 0, x * [-1.0, 1.0, 1.0] + [0.0, 0.0, 0.06], x)
    return sum(parts[1:], parts[0]) + folded.replace(position=over).translate((0.9, 0, 0))


def crossing_vertices(x: np.ndarray, corner: np.ndarray, body: np.ndarray, itself: np.ndarray) -> np.ndarray:
    """Return a mask of the vertices at x of edges that go through triangles, and of these triangles.

    Of one body they count only if it touches itself, shape [body_count].
    An edge goes through a triangle if its ends are on both sides and the tetrahedra between it and the three sides
    are turned alike.
    """
    triangles = corner[corner[:, 1] != corner[:, 2]]
    edges = np.unique(np.sort(np.concatenate([corner[:, [k, k - 1]] for k in range(3)]), axis=1), axis=0)
    e, t = (k.ravel() for k in np.meshgrid(range(len(edges)), range(len(triangles)), indexing="ij"))
    may = ~(edges[e][:, :, None] == triangles[t][:, None]).any(axis=(1, 2))
    may &= (body[edges[e, 0]] != body[triangles[t, 0]]) | itself[body[triangles[t, 0]]]
    e, t = e[may], t[may]
    (a, b), (p, q, r) = x[edges[e]].transpose(1, 0, 2), x[triangles[t]].transpose(1, 0, 2)

    def volume(one: np.ndarray, *three: np.ndarray) -> np.ndarray:
        return np.linalg.det(np.stack(three, axis=1) - one[:, None])

    turns = np.stack([volume(a, b, p, q), volume(a, b, q, r), volume(a, b, r, p)])
    through = (volume(p, q, r, a) * volume(p, q, r, b) < 0) & ((turns > 0).all(axis=0) | (turns < 0).all(axis=0))
    return np.isin(np.arange(len(x)), np.concatenate([edges[e[through]].ravel(), triangles[t[through]].ravel()]))


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::msdwarp.checks.StartWarning")  # some start in each other
@pytest.mark.parametrize("contact", [Contact(), Contact(self_contact=True, thickness=0.05)], ids=["bodies", "all"])
def test_surfaces_list_all_that_is_near(plain_device, monkeypatch, contact):
    monkeypatch.setattr(nearby, "ROOM", 256)
    system = crowd()
    simulation = Simulation(system, contact=contact, gravity=0.0, device=plain_device, precision="float64")
    rng, count = np.random.default_rng(2), len(system.mass)
    simulation.state.x.assign(system.position + 0.02 * rng.normal(size=(count, 3)))
    velocity = 4.0 * rng.normal(size=(count, 3)) * (np.arange(count) % 5 == 0)[:, None]  # a few are fast [m/s]
    simulation.state.v.assign(velocity)
    effect = contact_of(simulation)
    effect.neighbors.dt = 1e-3
    found = rows_of(simulation)
    s, x = effect.surfaces.on_host, simulation.frame().position
    now = np.einsum("vk,vkd->vd", s.weight, x[s.particle])
    points = now[s.ends[:, 0]] * (1 - s.fraction[:, None]) + now[s.ends[:, 1]] * s.fraction[:, None]
    mine, other = s.body[s.ends[:, 0]], s.body[s.corner[:, 0]]
    own = mine[:, None] == other
    thickness = (
        np.full(own.shape, contact.thickness) if contact.thickness else s.radius[mine][:, None] + s.radius[other]
    )
    skin = skin_module.LEAST_SKIN * (contact.thickness or 2 * s.radius.max())
    speed = np.linalg.norm(np.einsum("vk,vkd->vd", s.weight, velocity[s.particle]), axis=1)
    soon = (skin_module.CHECK_EVERY + skin_module.ALLOWANCE) * 1e-3
    slack = np.maximum(0.5 * skin, soon * speed)  # of each vertex
    assert 0.1 < (slack > 0.5 * skin).mean() < 0.5
    assert slack.max() < effect.neighbors.overruns.most
    slack = slack[s.ends].max(axis=1)[:, None] + slack[s.corner].max(axis=1)  # of points and facets together

    def distances(points, at):
        a, b = (index.ravel() for index in np.meshgrid(range(len(points)), range(len(s.corner)), indexing="ij"))
        return nearest_distances(points[a], at[s.corner[b]]).reshape(len(points), -1)

    away = distances(points, now)
    # Less than 2/3 of a spacing thick, a body touches all of itself but the facets that a point is a part of.
    assert (1.5 * thickness[own.any(axis=1)].min() if contact.thickness else 0.0) < s.spacing.min()
    apart = ~(s.ends[:, None, :, None] == s.corner[None, :, None, :]).any(axis=(2, 3))
    itself = contact.self_contact & ~s.solid
    expected = (away - slack < thickness) & (~own | (apart & itself[other]))
    # Vertices of what has crossed since the start are left out until it is apart.
    tangled = crossing_vertices(now, s.corner, s.body, itself)
    assert 0 < tangled.sum() < len(tangled)
    expected &= ~tangled[s.ends].any(axis=1)[:, None] & ~tangled[s.corner].any(axis=1)
    # Of each body those are left out that cannot come to be the nearest, by 1 %.
    for body in range(len(s.solid)):
        nearest = np.where(expected & (other == body), away + slack, np.inf).min(axis=1)
        expected &= (other != body) | (away - slack <= 1.01 * nearest[:, None])
    for both_solid in (False, True):
        assert (expected & ~own & ((s.solid[mine][:, None] & s.solid[other]) == both_solid)).any()
    assert found == [np.flatnonzero(row).tolist() for row in expected]
    assert (expected & own).any() == (contact.self_contact)


def scene(device: str, **options) -> Simulation:
    """Return a simulation of bodies that soon fall on one another, and keep sliding and sticking."""
    constants = {"mass": 0.02, "stiffness": 1000.0, "damping": 0.5}
    low = box((4, 4, 2), 0.1, **constants)
    die = box((2, 3, 2), 0.1, **constants).rotate(0.4, axis=(1, 2, 0)).translate((0.08, 0.02, 0.18))
    cloth = sheet((5, 5), 0.1, mass=0.01, stiffness=300.0, damping=0.3).translate((0, 0, 0.32))
    die, cloth = die.replace(velocity=(0.2, 0.1, -1.0)), cloth.replace(velocity=(0.0, 0.0, -2.0))
    given = {"contact": Contact(), "precision": "float32", "device": device, "fps": 100.0} | options
    return Simulation(low + die + cloth, colliders=[Plane(offset=-0.06)], **given)


def ran(simulation: Simulation, frames: int = 25) -> np.ndarray:
    simulation.step(frames)
    assert contact_of(simulation).deepest > 0  # they are in touch
    return np.concatenate(simulation.frame()[1:])


def repeats(device: str) -> str:
    """Return the device if what runs on it repeats to the last bit."""
    if device.startswith("cuda") and scene(device).model.force_algorithm == "scatter":
        pytest.skip("scattered sums of springs on the GPU are not repeatable")
    return device


@pytest.fixture
def device_that_repeats(device) -> str:
    return repeats(device)


def test_runs_repeat_to_the_last_bit(device_that_repeats):
    once, again = (ran(scene(device_that_repeats)) for _ in range(2))
    np.testing.assert_array_equal(once, again)


@pytest.mark.parametrize("buffer", [0.02, 1.0])
def test_the_skin_changes_nothing(device_that_repeats, monkeypatch, buffer):
    expected = ran(scene(device_that_repeats))
    monkeypatch.setattr(skin_module, "LEAST_SKIN", buffer)
    np.testing.assert_array_equal(ran(scene(device_that_repeats)), expected)


def test_how_often_lists_are_made_changes_nothing(device_that_repeats, monkeypatch):
    expected = ran(scene(device_that_repeats))
    search_always(monkeypatch)
    np.testing.assert_array_equal(ran(scene(device_that_repeats)), expected)


STIFF = {"mass": 0.1, "stiffness": 3000.0, "damping": 0.5}
ROPE = chain(2, 1.0, **STIFF)
TILE = sheet((2, 2), 1.0, **STIFF)  # its corners are far from what touches its middle
FLYING = {
    "ropes": (ROPE, ROPE.rotate(1.5, axis=(0, 0, 1))),
    "grains": (grains(1, 0.0), grains(1, 0.0)),
    "grain and tile": (grains(1, 0.0), TILE),
    "rope and tile": (ROPE, TILE),
    "boxes": (box((2, 2, 2), 0.5, **STIFF), box((3, 3, 3), 0.1, **STIFF).rotate(0.5, axis=(1, 2, 3))),
}


@pytest.mark.slow
@pytest.mark.parametrize("names", FLYING)
def test_what_comes_from_afar_is_listed_in_time(monkeypatch, names):
    # Where nothing is near, searches are rare. They meet after a dozen frames, in each case at another time.
    one, other = (body.translate(tuple(-body.position.mean(axis=0))) for body in FLYING[names])

    def thrown(gap: float) -> np.ndarray:
        system = one.with_velocity((0, 0, 1.5)) + other.with_velocity((0, 0, -1.5)).translate((0.004, 0.002, gap))
        contact = Contact(thickness=0.02, restitution=0.9, stiffness=3000.0)
        how = {"gravity": 0.0, "substeps": 150, "precision": "float64", "device": "cpu"}
        simulation = Simulation(system, contact=contact, **how)
        simulation.step(24)
        frame = simulation.frame()
        assert frame.velocity[: len(one.position), 2].mean() < 1.0  # it has been stopped, or thrown back
        return np.concatenate(frame[1:])

    gaps = 0.7 + 0.0063 * np.arange(3)
    rare = [thrown(gap) for gap in gaps]
    search_always(monkeypatch)
    for gap, found in zip(gaps, rare, strict=True):
        np.testing.assert_array_equal(found, thrown(gap))


def _counted(is_void, found: list):
    """Return a method that notes what it returns."""

    def counted(self) -> bool:
        found.append(is_void(self))
        return found[-1]

    return counted


def test_a_frame_whose_lists_overflow_is_repeated(device_that_repeats, monkeypatch):
    expected = ran(scene(device_that_repeats))
    monkeypatch.setattr(nearby, "ROOM", 1)
    simulation = scene(device_that_repeats)
    room = contact_of(simulation).neighbors.data.candidates.shape[1]
    voids = []
    monkeypatch.setattr(BodyContact, "is_void", _counted(BodyContact.is_void, voids))
    np.testing.assert_array_equal(ran(simulation), expected)
    assert contact_of(simulation).neighbors.data.candidates.shape[1] > room
    assert any(voids)


def seam() -> Simulation:
    """Return two sheets that a seam, stretched 40-fold, throws at each other: by 2 spacings in a substep."""
    panel = sheet((6, 5), 0.05, mass=2e-4, stiffness=100.0, damping=0.02)
    on = np.flatnonzero(np.arange(30) % 6 == 0)
    sewn = join(panel, panel.translate((0, 0, 0.4)), pairs=np.c_[on, on], stiffness=400.0, rest_length=0.01)
    contact = Contact(self_contact=True)
    return Simulation(sewn, contact=contact, gravity=0.0, device="cpu", fps=600.0, substeps=8, allow_unstable=True)


@pytest.mark.filterwarnings("ignore::msdwarp.checks.StepWarning")  # it is repeated on purpose
def test_what_starts_at_once_gives_more_slack_to_few_alone(monkeypatch):
    # Else everything were near everything: frames would take minutes.
    simulation = seam()
    neighbors = contact_of(simulation).neighbors
    simulation.step()
    assert neighbors.path > 0.05  # more than a spacing
    assert neighbors.skin.width <= neighbors.skin.widest
    slack = neighbors.data.overrun.numpy()
    assert slack.max() > 4 * neighbors.skin.widest
    assert 0.1 < (slack[1] > neighbors.skin.widest).mean() < 0.5  # of what starts, the seam alone
    monkeypatch.setattr(skin_module, "LEAST_SKIN", 40.0)  # so wide that lists hold
    wide = seam()
    wide.step()
    np.testing.assert_array_equal(np.concatenate(simulation.frame()[1:]), np.concatenate(wide.frame()[1:]))


@pytest.mark.filterwarnings("ignore::msdwarp.checks.StepWarning")  # it is repeated on purpose
def test_a_frame_ends_early_whose_lists_have_no_room(monkeypatch):
    expected = seam()
    expected.step()
    found, usual = [], pace.stop_if_asked
    monkeypatch.setattr(pace.Pace, "part", lambda self, first, last: range(first, min(first + 2, last)))
    monkeypatch.setattr(pace, "stop_if_asked", lambda: (found.append(True), usual()))
    judged = []
    monkeypatch.setattr(BodyContact, "will_be_void", _counted(BodyContact.will_be_void, judged))
    simulation = seam()
    simulation.step()
    assert any(judged)
    assert not any(judged[-3:])  # the last repetition, of four launches
    assert len(judged) == len(found) < 4 * (1 + sum(judged))  # no other was whole
    np.testing.assert_array_equal(*(np.concatenate(one.frame()[1:]) for one in (simulation, expected)))


def test_that_a_frame_is_repeated_is_told(monkeypatch):
    monkeypatch.setattr(stepping, "LONG", 0.0)
    simulation = seam()
    with pytest.warns(StepWarning, match=r"from 0 s on .* begun 2 times.* spacings in a substep .*Actuator"):
        simulation.step()


def test_lists_too_long_for_any_room_are_an_error(monkeypatch):
    monkeypatch.setattr(nearby, "ROOM", 1)
    simulation = scene("cpu")
    monkeypatch.setattr(lists, "MOST_ROOM", 1)
    with pytest.raises(MemoryError, match=r"\d+ facets are near one point.*Contact\(thickness"):
        simulation.step(25)


@pytest.mark.parametrize(
    ("pairs", "facets", "said"),
    [
        (2**30, 0, "near others: 2147483648 entries .* at most 1073741824 entries"),  # beyond the int32 of kernels
        (0, 2**30, "near each other: 2147483648 entries .* at most 1073741824 entries"),
        (10**7, 0, "near others: 20000000 entries .* 1.76 GB of 1 GB that are free"),  # 88 bytes in float32
        (0, 10**8, "near each other: 200000000 entries .* 6.4 GB of 1 GB that are free"),
    ],
)
def test_pairs_beyond_all_memory_are_an_error_before_any_is_allocated(monkeypatch, pairs, facets, said):
    planes = contact_of(scene("cpu")).planes
    monkeypatch.setattr(checks, "free_memory", lambda: 10**9)
    before = planes.pairs.vertices.ptr, planes.pairs.near_facets.ptr
    with pytest.raises(MemoryError, match=said):
        planes.extend(pairs, facets)
    assert before == (planes.pairs.vertices.ptr, planes.pairs.near_facets.ptr)


def test_a_method_of_stages_moves_within_a_substep(plain_device):
    # Lists that are made before every substep hold for its later stages only with a skin: without one the frame
    # would be repeated for ever. 2 mm a stage, where half of the least skin is 1.25 mm.
    position, velocity = [[0, 0, 0], [0.02, 0, 0]], [[0.5, 0, 0], [-0.5, 0, 0]]
    fast = System(position=position, velocity=velocity, mass=0.01, connections=np.zeros((0, 2), int))
    contact = Contact(thickness=0.01, stiffness=200.0, restitution=0.9)
    options = {"gravity": 0.0, "substeps": 4, "integrator": RK4(), "device": plain_device, "allow_unstable": True}
    simulation = Simulation(fast, contact=contact, **options)
    simulation.step(5)
    v = simulation.frame().velocity[:, 0]
    assert v[0] < 0 < v[1]  # they have met


@pytest.mark.slow
def test_scenes_that_share_a_kernel_run_beside_each_other():
    # Of kernels that are alike to the letter Warp keeps one, which has the types of the scene that was first. What
    # begins a run does not see obstacles: with other obstacles it is the same.
    body = box((2, 2, 2), 0.1, mass=0.01, stiffness=50.0, damping=0.01)
    both = (body + body.translate((0.0, 0.0, 0.12))).translate((0.0, 0.0, 0.1))
    probes = {"foot": Probe([0, 1], "contact force")}
    walls = [Plane(), Plane((1, 0, 0), offset=-3.0)]
    for around in ({"colliders": walls[:1]}, {"colliders": walls}, {"colliders": walls, "probes": probes}):
        simulation = Simulation(both, contact=Contact(), device="cpu", **around)
        simulation.step(2)
        assert np.isfinite(simulation.frame().position).all()


def test_ropes_that_pass_each_other_fast_find_the_nearest_segments(monkeypatch):
    # In a substep one moves by six segments. How far both may go before lists are made depends on their speed.
    def flown() -> np.ndarray:
        long, short = (chain(n, 0.01, mass=1.0, stiffness=100.0, damping=0.0) for n in (400, 4))
        short = short.translate((-1.7, 0.003, 0.051)).with_velocity((10.0, 0.0, -0.5))
        how = {"gravity": 0.0, "integrator": RK4(), "fps": 1 / 0.048, "substeps": 8, "allow_unstable": True}
        contact, deepest = Contact(restitution=1.0, friction=0.0, thickness=0.05, stiffness=5.0), 0.0
        simulation = Simulation(long + short, contact=contact, precision="float64", device="cpu", **how)
        for _ in range(4):
            simulation.step()
            deepest = max(deepest, contact_of(simulation).deepest)
        assert deepest > 0
        return np.concatenate(simulation.frame()[1:])

    expected = flown()
    search_always(monkeypatch)
    np.testing.assert_array_equal(flown(), expected)
