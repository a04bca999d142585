"""Contact forces in files: with each frame where asked for, and nowhere else."""

import h5py
import numpy as np
import pytest
from trajectories import SYSTEMS, frames, vtk_frames

from msdwarp import Contact, Plane, Simulation, Trajectory, TrajectoryWriter, ball, box
from msdwarp.simulation import Readback


def meeting(**options) -> Simulation:
    """Return a cube that falls on another one, on the floor."""
    die = box((3, 3, 3), 0.1, mass=0.02, stiffness=2e3, damping=2.0)
    system = die.translate((0, 0, 0.1)) + die.translate((0.02, 0, 0.31)).with_velocity((0, 0, -1.0))
    return Simulation(system, colliders=[Plane()], contact=Contact(), device="cpu", fps=600, **options)


@pytest.mark.slow
@pytest.mark.parametrize(("compress", "precision"), [(False, "float32"), (True, "float32-compensated")])
def test_a_file_has_them_with_each_frame(tmp_path, compress, precision):
    simulation = meeting(contact_forces=True, precision=precision)
    readback, found = Readback(simulation, contact_forces=True), []
    path, options = tmp_path / "a.vtkhdf", {"fps": 60, "compress": compress, "contact_forces": True}
    with TrajectoryWriter(path, simulation.system, **options) as writer:
        for k in range(6):
            if k:
                simulation.step(10)  # short frames: each launch of one is recorded
            found.append(simulation.contact_force())
            writer.write_pending(readback.take())
    assert not found[0].any()
    assert np.abs(found).max() > 1.0
    with Trajectory(path) as trajectory:
        # Compensated positions are stored in float64, and forces beside them: exactly, being wider.
        np.testing.assert_array_equal(trajectory.contact_forces[:], found)
    # ParaView has them as vectors of points.
    for k, (_, mesh) in enumerate(vtk_frames(path)):
        np.testing.assert_array_equal(mesh.point_data["contact_force"], found[k])


def test_a_file_goes_on_with_them(tmp_path):
    system, path, options = SYSTEMS["box"], tmp_path / "a.vtkhdf", {"fps": 60, "contact_forces": True}
    forces = np.random.default_rng(3).normal(size=(4, *system.position.shape)).astype(np.float32)
    for behind in (0, 2):
        with TrajectoryWriter(path, system, behind=behind, **options) as writer:
            for k, frame in enumerate(frames(system, behind + 2)):
                if k >= behind:
                    writer.write(frame, contact_force=forces[k])
    with Trajectory(path) as trajectory:
        np.testing.assert_array_equal(trajectory.contact_forces[:], forces)


def test_points_of_a_skin_have_the_mixture_of_their_particles(tmp_path):
    system = ball(0.1, 0.05)
    assert system.surface is not None
    force = np.random.default_rng(3).normal(size=system.position.shape).astype(np.float32)
    path = tmp_path / "a.vtkhdf"
    with TrajectoryWriter(path, system, fps=60, contact_forces=True) as writer:
        x = system.position.astype(np.float32)
        writer.write((0.0, x, np.zeros_like(x)), contact_force=force)
    ((_, mesh),) = vtk_frames(path)
    n = len(force)
    np.testing.assert_array_equal(mesh.point_data["contact_force"][:n], force)
    if system.surface.weights is not None:
        shown = mesh.point_data["contact_force"][n:]
        np.testing.assert_allclose(shown, system.surface.points(force), rtol=0, atol=1e-6)  # rounding of float32


def test_what_was_not_asked_for_is_nowhere(tmp_path):
    simulation = meeting()
    with pytest.raises(ValueError, match="contact_forces is True; the simulation must be made with"):
        Readback(simulation, contact_forces=True)
    taken = Readback(simulation).take()
    assert taken.contact_force() is None
    path = tmp_path / "a.vtkhdf"
    with TrajectoryWriter(path, simulation.system, fps=60) as writer:
        writer.write_pending(taken)
    with h5py.File(path) as file:
        assert list(file["VTKHDF/PointData"]) == ["velocity"]
    with Trajectory(path) as trajectory, pytest.raises(ValueError, match="was written without contact forces"):
        _ = trajectory.contact_forces


def test_missing_and_misshapen_forces_are_refused(tmp_path):
    (frame,) = frames(SYSTEMS["box"], 1)
    with TrajectoryWriter(tmp_path / "a.vtkhdf", SYSTEMS["box"], fps=60, contact_forces=True) as writer:
        with pytest.raises(ValueError, match=r"contact_force has shape \(3, 3\); it must be \(36, 3\)"):
            writer.write(frame, contact_force=np.zeros((3, 3)))
        with pytest.raises(ValueError, match="contact_force is None; the file is laid out for"):
            writer.write(frame)
        writer.write(frame, contact_force=np.zeros((36, 3)))
