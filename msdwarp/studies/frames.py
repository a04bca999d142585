"""Frames of trajectories: the system in a frame, and the energies of its particles."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..bodies import System, broken_before
from ..files import Trajectory
from ..world import Change


def changes_made(trajectory: Trajectory, k: int, schedule: Sequence[Change]) -> list[Change]:
    """Return the changes made before frame k was simulated, in order."""
    fps = trajectory.attributes.get("options", {}).get("fps", trajectory.fps)  # a file may hold every n-th frame
    before = round(trajectory.times[k] * fps) - 1
    ordered = sorted(schedule, key=lambda change: change.time)
    return [change for change in ordered if change.is_due(before, fps)]


def system_in(trajectory: Trajectory, k: int, schedule: Sequence[Change] = ()) -> System:
    """Return the system in frame k of a trajectory.

    It includes the changes of the schedule. If rest lengths change, they are computed from the strains; ValueError
    is raised if these are not in the file.
    """
    system = start = trajectory.system
    frame = trajectory.frame(k)
    for change in changes_made(trajectory, k, schedule):
        system = change.applied_to(system)
    system = system.replace(position=frame.position, velocity=frame.velocity)
    if start.tears:
        broken_at = trajectory.broken_at
        system = system.replace(broken_at=np.where(broken_before(broken_at, frame.time), broken_at, np.inf))
    if not (start.yields or schedule):
        return system
    rest_length = recovered_rest_length(system, trajectory.strains[k])
    return system.replace(rest_length=rest_length, original_length=start.original_length)


def recovered_rest_length(system: System, strain: NDArray) -> NDArray[np.float64]:
    """Return rest lengths [m], shape [connection_count], from the strains of the springs.

    A spring between coincident particles keeps the system's rest length, which its strain does not determine.
    """
    ratio = 1.0 + strain.astype(np.float64)
    return np.divide(system.length, ratio, out=np.array(system.rest_length), where=ratio > 0)


def particle_energies(system: System) -> NDArray[np.float64]:
    """Return the energy of each particle [J], shape [particle_count]: kinetic, and half that of its springs.

    Pinned particles have no kinetic energy.
    """
    mass = np.where(system.pinned, 0.0, system.mass)
    energy = 0.5 * mass * (system.velocity**2).sum(axis=1)
    half = 0.25 * np.where(system.broken, 0.0, system.stiffness) * (system.length - system.rest_length) ** 2
    for end in system.connections.T:
        energy += np.bincount(end, weights=half, minlength=system.particle_count)
    return energy
