"""Studies of scenes: errors against cost (`tune`), energies over time, sweeps and fits."""

from .accuracy import as_fast, cheapest, tune
from .fit import fit
from .fit_field import FieldFit, fit_field
from .fit_result import FitResult
from .grid import as_scalar, check_size, points, values_of
from .history import particle_energies, system_in, write_history
from .measured import TrackedPoints
from .plots import output_path, plot_pictures, plot_readings
from .sweep import complete, sweep
from .sweep_ensembles import ENSEMBLE, ensemble_summary
from .sweep_plot import plot_sweep
from .sweep_points import RESULTS, Point, Setup, final_numbers
from .table import EnergyLog, GrowingTable
from .tensor_functions import simulate_jax, simulate_torch
from .units import units_of
