"""Trajectories and restart files on disk, and exports. The only importer of h5py."""

from .export import export
from .restart import read_restart, write_restart
from .trajectory import FrameArray, Trajectory
from .validation import probe
from .writer import TrajectoryWriter

__all__ = ["FrameArray", "Trajectory", "TrajectoryWriter", "export", "probe", "read_restart", "write_restart"]
