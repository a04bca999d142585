"""What is asked of runs: errors against cost (`tune`), energies over time, whether two trajectories differ."""

from .accuracy import cheapest, tune
from .comparison import compare
from .energy_log import EnergyLog
from .frames import particle_energies, system_in
from .history import plot_history, write_history
from .table import GrowingTable

__all__ = [
    "EnergyLog",
    "GrowingTable",
    "cheapest",
    "compare",
    "particle_energies",
    "plot_history",
    "system_in",
    "tune",
    "write_history",
]
