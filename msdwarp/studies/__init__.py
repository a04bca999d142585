"""What is asked of runs: errors against cost (`tune`), energies over time, whether two differ; sweeps; fits."""

from .accuracy import cheapest, tune
from .fit import fit
from .fit_result import FitResult
from .frames import particle_energies, system_in
from .grid import check_size, plain, points, values_of
from .history import plot_history, write_history
from .measured import TrackedPoints
from .sweep import complete, sweep
from .sweep_ensembles import ENSEMBLE, in_words
from .sweep_plot import plot_sweep
from .sweep_points import RESULTS, Asked, Point, final_numbers, import_xarray
from .table import EnergyLog, GrowingTable

__all__ = [
    "ENSEMBLE",
    "RESULTS",
    "Asked",
    "EnergyLog",
    "FitResult",
    "GrowingTable",
    "Point",
    "TrackedPoints",
    "cheapest",
    "check_size",
    "complete",
    "final_numbers",
    "fit",
    "import_xarray",
    "in_words",
    "particle_energies",
    "plain",
    "plot_history",
    "plot_sweep",
    "points",
    "sweep",
    "system_in",
    "tune",
    "values_of",
    "write_history",
]
