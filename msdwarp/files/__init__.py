"""Trajectories and restart files on disk, and exports. Only this room imports h5py."""

from .checkpoint_file import read_restart as read_restart, write_restart as write_restart
from .drawn import DrawnFrame as DrawnFrame, DrawnMesh as DrawnMesh, free_name as free_name
from .export import export as export, finite_values as finite_values
from .trajectory import FrameArray as FrameArray, Trajectory as Trajectory
from .validation import probe as probe
from .writer import TrajectoryWriter as TrajectoryWriter
