"""History of a trajectory: against the simulation's own measures, closed forms, and sums by NumPy."""

import math

import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image
from problems import EPS32, EPS64

from msdwarp import Simulation, System, TensionOnlySpring, Trajectory, at
from msdwarp.engine.diagnostics.energies import Measures
from msdwarp.files.writer import TrajectoryWriter
from msdwarp.simulation.readback import Readback
from msdwarp.studies import history
from msdwarp.studies.history import particle_energies, recovered_rest_length
from msdwarp.studies.table import COLUMNS

G = 9.82


def net(dim: int, **fields) -> System:
    """Return particles of many masses, two of them pinned, with random springs and dampers."""
    random = np.random.default_rng(dim)
    ends = np.array([random.choice(12, 2, replace=False) for _ in range(30)])
    position = random.normal(size=(12, dim))
    length = np.linalg.norm(position[ends[:, 0]] - position[ends[:, 1]], axis=1)
    fields = {
        "velocity": random.normal(size=(12, dim)),
        "mass": random.uniform(0.5, 3.0, 12),
        "rest_length": length * random.uniform(0.6, 1.4, 30),
        "stiffness": random.uniform(5.0, 40.0, 30),
        "damping": random.uniform(0.0, 1.0, 30),
    } | fields
    return System(position=position, connections=ends, **fields).pin([2, 7])


def run(system: System, gravity=G, **options) -> Simulation:
    options = {"fps": 60, "device": "cpu", "precision": "float64"} | options
    return Simulation(system, gravity=gravity, **options)


def record(path, simulation: Simulation, count: int, *, strain: bool = True) -> list[tuple[Measures, System]]:
    """Write a trajectory of frames, and return what the simulation says about each."""
    said = []
    with TrajectoryWriter(path, simulation.system, fps=simulation.fps, strain=strain, force=True) as writer:
        for _ in range(count):
            now = simulation.snapshot()
            said.append((simulation.measure(), now))
            writer.write(simulation.frame(), now.strain if strain else None)
            simulation.step()
    return said


@pytest.fixture(params=[1, 2, 3])
def net_run(tmp_path, request):
    """A trajectory of a net in each number of dimensions, open, and what its simulation said."""
    said = record(tmp_path / "net.vtkhdf", run(net(request.param)), 5)
    with Trajectory(tmp_path / "net.vtkhdf") as trajectory:
        yield trajectory, said


def test_the_history_is_what_the_simulation_measured(net_run):
    trajectory, said = net_run
    moments = list(history.history(trajectory, gravity=G))
    assert [moment.time for moment in moments] == list(trajectory.times)
    for moment, (measures, now) in zip(moments, said, strict=True):
        # Bit for bit: the same kernels, on the CPU, add the same numbers in the same order.
        for name in Measures._fields:
            np.testing.assert_array_equal(getattr(moment.measures, name), getattr(measures, name), err_msg=name)
        height, free = now.position[:, -1], ~now.pinned
        assert (moment.lowest, moment.highest) == (height.min(), height.max())
        mean = (now.mass[free] * height[free]).sum() / now.mass[free].sum()
        assert moment.mean == pytest.approx(mean, rel=0, abs=12 * EPS64 * np.abs(height).max())  # a sum of ten


def test_gravity_may_be_a_vector(tmp_path):
    gravity = (1.5, -2.0)
    said = record(tmp_path / "a.vtkhdf", run(net(2), gravity), 2)
    with Trajectory(tmp_path / "a.vtkhdf") as trajectory:
        for moment, (measures, _) in zip(history.history(trajectory, gravity=gravity), said, strict=True):
            assert moment.measures.gravitational_energy == measures.gravitational_energy  # the same kernels again


def test_float32_frames_are_measured_to_rounding_of_constants(tmp_path):
    said = record(tmp_path / "a.vtkhdf", run(net(3), precision="float32"), 3)
    with Trajectory(tmp_path / "a.vtkhdf") as trajectory:
        for moment, (measures, _) in zip(history.history(trajectory, gravity=G), said, strict=True):
            # Only the simulation's constants are rounded: a rounding or two of terms of below 3000 (J, W).
            for name in Measures._fields:
                expected = getattr(measures, name)
                got = getattr(moment.measures, name)
                np.testing.assert_allclose(got, expected, rtol=0, atol=3000 * 2 * EPS32, err_msg=name)


@pytest.mark.parametrize("dim", [1, 2, 3])
def test_free_fall(tmp_path, dim):
    random = np.random.default_rng(0)
    mass = random.uniform(0.5, 2.0, 5)
    system = System(position=random.uniform(9.0, 11.0, (5, dim)), mass=mass)
    simulation = run(system, fps=50, substeps=4)
    record(tmp_path / "a.vtkhdf", simulation, 26)
    start, h = np.average(system.position[:, -1], weights=mass), 1 / 200
    with Trajectory(tmp_path / "a.vtkhdf") as trajectory:
        moments = list(history.history(trajectory, gravity=G))
    for moment in moments:
        t = moment.time
        # 100 substeps each round velocities below 5 m/s and heights below 16 m, momenta below 50 kg m/s.
        momentum = np.zeros(dim)
        momentum[-1] = -mass.sum() * G * t
        np.testing.assert_allclose(moment.measures.momentum, momentum, rtol=0, atol=100 * 50 * EPS64)
        # Symplectic Euler moves with the velocity of the step's end: g t h/2 further than g t²/2, exactly.
        fallen = G * t**2 / 2 + G * t * h / 2
        assert moment.mean == pytest.approx(start - fallen, rel=0, abs=100 * 16 * EPS64)
    assert moments[-1].time == 0.5


def test_what_is_pinned_counts_only_where_it_stands(tmp_path):
    system = System(position=[[0.0, 0, 5], [0, 0, 3], [0, 0, 1]], mass=[math.inf, 1.0, 3.0])
    moment = first_moment(tmp_path / "a.vtkhdf", system)
    assert (moment.lowest, moment.mean, moment.highest) == (1.0, 1.5, 5.0)  # all sums are of whole numbers
    moment = first_moment(tmp_path / "b.vtkhdf", system.pin([0, 1, 2]))
    assert (moment.lowest, moment.mean, moment.highest) == (1.0, 3.0, 5.0)
    assert moment.measures.gravitational_energy == moment.measures.kinetic_energy == 0.0


def first_moment(path, system: System) -> history.Moment:
    with TrajectoryWriter(path, system, fps=60) as writer:
        writer.write((0.0, np.array(system.position), np.array(system.velocity)))
    with Trajectory(path) as trajectory:
        return next(history.history(trajectory, gravity=G))


# What yields


@pytest.mark.slow
@pytest.mark.parametrize(("dim", "precision"), [(2, "float64"), (3, "float32")])
def test_rest_lengths_of_what_yields_are_recovered(tmp_path, dim, precision):
    system = net(dim, yield_strain=0.02, relaxation_time=0.05)
    said = record(tmp_path / "a.vtkhdf", run(system, precision=precision), 6)
    # Per length: positions, a length, a strain and its reverse are rounded, a few times each.
    eps = {"float32": EPS32, "float64": EPS64}[precision]
    with Trajectory(tmp_path / "a.vtkhdf") as trajectory:
        moments = list(history.history(trajectory, gravity=G))
        for k, (moment, (measures, now)) in enumerate(zip(moments, said, strict=True)):
            present = history.system_in(trajectory, k)
            rest = present.rest_length
            np.testing.assert_allclose(rest, now.rest_length, rtol=8 * eps / (1 + now.strain.min()))
            slack = 8 * eps * (now.stiffness * (now.length + now.rest_length) ** 2).sum()
            assert moment.measures.elastic_energy == pytest.approx(measures.elastic_energy, rel=0, abs=slack)
            energies = particle_energies(present)
            whole = measures.kinetic_energy + measures.elastic_energy
            assert energies.sum() == pytest.approx(whole, rel=8 * eps, abs=slack)
        stale = particle_energies(present.replace(rest_length=system.rest_length)).sum()
    assert stale > 1.2 * whole  # it did yield


def test_what_yields_needs_its_strains(tmp_path):
    record(tmp_path / "a.vtkhdf", run(net(2, yield_strain=0.02)), 2, strain=False)
    with (
        Trajectory(tmp_path / "a.vtkhdf") as trajectory,
        pytest.raises(ValueError, match="written without strain"),
    ):
        history.history(trajectory, gravity=G)


def test_what_does_not_yield_needs_no_strains(tmp_path):
    said = record(tmp_path / "a.vtkhdf", run(net(2)), 2, strain=False)
    with Trajectory(tmp_path / "a.vtkhdf") as trajectory:
        elastic = [moment.measures.elastic_energy for moment in history.history(trajectory, gravity=G)]
    assert elastic == [measures.elastic_energy for measures, _ in said]  # the same kernels again


def test_where_particles_coincide_the_rest_length_is_the_systems():
    system = System(position=[[0.0], [1.0]], connections=[[0, 1]], rest_length=0.7)
    system = system.replace(position=np.zeros((2, 1)))
    assert recovered_rest_length(system, np.array([-1.0])) == [0.7]


# Energies of particles


def test_energies_of_particles_add_up(net_run):
    trajectory, said = net_run
    for k, (measures, now) in enumerate(said):
        energies = particle_energies(history.system_in(trajectory, k))
        # Sums of some 70 terms that are not negative, in another order.
        whole = measures.kinetic_energy + measures.elastic_energy
        assert energies.sum() == pytest.approx(whole, rel=70 * EPS64)
        expected = np.where(now.pinned, 0.0, now.mass) * (now.velocity**2).sum(axis=1) / 2
        expected = np.nan_to_num(expected, nan=0.0)
        for (i, j), k, stretch in zip(now.connections, now.stiffness, now.length - now.rest_length, strict=True):
            expected[[i, j]] += k * stretch**2 / 4
        np.testing.assert_allclose(energies, expected, rtol=70 * EPS64)


def test_without_connections_energies_are_kinetic():
    system = System(position=[[0.0, 0], [1, 0]], velocity=[[3.0, 4], [0, 0]], mass=[2.0, math.inf])
    np.testing.assert_array_equal(particle_energies(system), [25.0, 0.0])


def test_energies_of_particles_are_refused_where_springs_are_not_linear():
    system = System(position=[[0.0, 0], [1, 0]], connections=[[0, 1]], stiffness=1.0, spring=TensionOnlySpring())
    with pytest.raises(ValueError, match="must be linear"):
        particle_energies(system)


# What is changed on the way


def test_a_schedule_is_followed(tmp_path):
    # The end of the frame after which each change is made is the first that knows it.
    schedule = [
        at(1.5 / 60, stiffness=lambda k: 2 * k),
        at(4 / 60, rest_length=lambda length: 0.9 * length, mass=lambda m: 2 * m),
        at(6 / 60, set_rest_shape=True),
    ]
    for every in (1, 2):
        path = tmp_path / f"{every}.vtkhdf"
        simulation = run(net(2), precision="float64", schedule=schedule)
        about, said = {"options": {"fps": 60.0}}, []
        with TrajectoryWriter(path, simulation.system, fps=60, every=every, attributes=about) as writer:
            for frame in simulation.frames(9 / 60):
                now = simulation.snapshot()
                writer.write(frame, now.length / now.rest_length - 1)
                said.append(simulation.measure())
        with Trajectory(path) as trajectory:
            moments = history.history(trajectory, gravity=G, schedule=schedule)
            for moment, measures in zip(moments, said[::every], strict=True):
                for name in ("kinetic_energy", "gravitational_energy"):
                    assert getattr(moment.measures, name) == pytest.approx(getattr(measures, name), rel=70 * EPS64)
                # Rest lengths are known to a few roundings, stretches are as large as that times the length.
                slack = 8 * EPS64 * (2 * now.stiffness * (2 * now.length) ** 2).sum()
                assert moment.measures.elastic_energy == pytest.approx(measures.elastic_energy, rel=0, abs=slack)
            unchanged = list(history.history(trajectory, gravity=G))[-1].measures.kinetic_energy
            assert unchanged < 0.9 * said[-1 if every == 1 else -2].kinetic_energy


# What is written


def test_the_table_holds_the_history(net_run, tmp_path):
    trajectory, _ = net_run
    path = history.write_history(trajectory, tmp_path / "new" / "net.csv", gravity=G)
    table = np.genfromtxt(path, delimiter=",", names=True)
    names = {1: "x", 2: "xz", 3: "xyz"}[trajectory.system.dim]
    momenta = [f"momentum_{name}_kg_m_s" for name in names]
    assert list(table.dtype.names) == ["time_s", *COLUMNS, *momenta, "lowest_m", "mean_m", "highest_m"]
    nine_digits = {"rtol": 1e-8, "atol": 0}
    for row, moment in zip(table, history.history(trajectory, gravity=G), strict=True):
        for name, of in COLUMNS.items():
            np.testing.assert_allclose(row[name], of(moment.measures), **nine_digits)
        np.testing.assert_allclose([row[name] for name in momenta], moment.measures.momentum, **nine_digits)
        expected = [moment.time, moment.lowest, moment.mean, moment.highest]
        np.testing.assert_allclose([row[n] for n in ("time_s", "lowest_m", "mean_m", "highest_m")], expected, 1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("net_run", [1, 3], indirect=True)
def test_the_plot_shows_the_history_and_its_legends_hide_nothing(net_run, tmp_path, monkeypatch):
    trajectory, _ = net_run
    figures, save = [], Figure.savefig
    monkeypatch.setattr(Figure, "savefig", lambda self, *a, **kw: (figures.append(self), save(self, *a, **kw)))
    path = history.write_history(trajectory, tmp_path / "net.png", gravity=G)
    with Image.open(path) as picture:
        assert np.asarray(picture.convert("L")).std() > 5  # not blank
    (figure,) = figures
    panels = figure.axes
    upwards = "x [m]" if trajectory.system.dim == 1 else "height [m]"
    assert [axes.get_ylabel() for axes in panels] == ["energy [J]", "momentum [kg m/s]", upwards]
    assert panels[-1].get_xlabel() == "time [s]"
    curves = [{line.get_label(): line.get_ydata() for line in axes.lines} for axes in panels]
    moments = list(history.history(trajectory, gravity=G))
    momentum = np.array([moment.measures.momentum for moment in moments]).T
    names = {1: "x", 2: "xz", 3: "xyz"}[trajectory.system.dim]
    assert list(curves[1]) == ["size", *names]
    # BLAS may add the squares in another order, or round a product and a sum at once. Three roundings by ε/2, of
    # which the root leaves half, and its own: 1.25 ε on either side.
    np.testing.assert_allclose(curves[1]["size"], np.linalg.norm(momentum, axis=0), rtol=4 * EPS64)
    for name, values in zip(names, momentum, strict=True):
        np.testing.assert_array_equal(curves[1][name], values)
    np.testing.assert_array_equal(curves[0]["kinetic"], [moment.measures.kinetic_energy for moment in moments])
    np.testing.assert_array_equal(curves[2]["lowest"], [moment.lowest for moment in moments])
    for axes in panels:
        legend = axes.get_legend().get_window_extent()
        assert legend.y0 >= axes.get_window_extent().y1
        assert figure.bbox.x0 <= legend.x0 < legend.x1 <= figure.bbox.x1
        assert not legend.overlaps(axes.yaxis.get_offset_text().get_window_extent())


@pytest.fixture
def two_frames(tmp_path):
    record(tmp_path / "a.vtkhdf", run(net(2)), 2)
    with Trajectory(tmp_path / "a.vtkhdf") as trajectory:
        yield trajectory


def test_a_file_that_is_there_is_left_alone(two_frames, tmp_path, monkeypatch):
    path = tmp_path / "old.csv"
    path.write_bytes(b"old")
    with monkeypatch.context() as patch:
        patch.setattr(history, "history", None)  # nothing is computed
        with pytest.raises(FileExistsError, match="--force"):
            history.write_history(two_frames, path, gravity=G)
    with pytest.raises(ValueError, match=r"gravity has shape \(3,\)"):
        history.write_history(two_frames, path, gravity=(0, 0, -G), force=True)
    assert path.read_bytes() == b"old"
    assert history.write_history(two_frames, path, gravity=G, force=True) == path
    assert path.stat().st_size > 100


def test_other_endings_are_refused(two_frames, tmp_path):
    with pytest.raises(ValueError, match=r"a\.txt; its name must end in \.csv"):
        history.write_history(two_frames, tmp_path / "a.txt", gravity=G)


def test_one_frame_is_no_plot(tmp_path):
    record(tmp_path / "a.vtkhdf", run(net(2)), 1)
    with (
        Trajectory(tmp_path / "a.vtkhdf") as trajectory,
        pytest.raises(ValueError, match="has 1 frame; a plot over time takes at least 2"),
    ):
        history.write_history(trajectory, tmp_path / "a.png", gravity=G)
    assert not (tmp_path / "a.png").exists()


def test_gravity_is_checked_at_once(two_frames):
    with pytest.raises(ValueError, match=r"gravity has shape \(3,\)"):
        history.history(two_frames, gravity=(0, 0, -G))
    with pytest.raises(ValueError, match="gravity is nan; it must be finite"):
        history.history(two_frames, gravity=math.nan)


def test_frames_are_read_one_at_a_time(two_frames, monkeypatch):
    read, frame = [], Trajectory.frame
    monkeypatch.setattr(Trajectory, "frame", lambda self, k: (read.append(k), frame(self, k))[1])
    moments = history.history(two_frames, gravity=G)
    assert read == []
    next(moments)
    assert read == [0]


@pytest.mark.slow
def test_what_is_broken_stores_no_energy(tmp_path):
    body = net(2, break_strain=0.7)
    body = body.with_velocity(3.0 * (body.position - body.center_of_mass))
    simulation = run(body, gravity=0.0)
    readback, expected = Readback(simulation), []
    with TrajectoryWriter(tmp_path / "a.vtkhdf", simulation.system, fps=60) as writer:
        for _ in range(12):
            writer.write_pending(readback.take())
            expected.append(simulation.measure().elastic_energy)
            simulation.step()
    with Trajectory(tmp_path / "a.vtkhdf") as found:
        assert 0 < np.isfinite(found.broken_at).sum() < body.connection_count
        moments = list(history.history(found, gravity=0.0))
    # Bit for bit, as above.
    assert [moment.measures.elastic_energy for moment in moments] == expected
