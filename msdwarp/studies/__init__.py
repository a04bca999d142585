"""What is asked of runs: errors against cost (`tune`), energies over time, whether two trajectories differ.

And which parameters have a scene move as was measured: `fit`.
"""

from .accuracy import cheapest, tune
from .comparison import compare
from .energy_log import EnergyLog
from .fit import fit
from .fitted import Fitted
from .frames import particle_energies, system_in
from .history import plot_history, write_history
from .measured import Tracked
from .table import GrowingTable

__all__ = [
    "EnergyLog",
    "Fitted",
    "GrowingTable",
    "Tracked",
    "cheapest",
    "compare",
    "fit",
    "particle_energies",
    "plot_history",
    "system_in",
    "tune",
    "write_history",
]
