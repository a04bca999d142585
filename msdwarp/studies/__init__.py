"""Studies of scenes: errors against cost (`tune`), energies over time, sweeps and fits."""

from .accuracy import as_fast as as_fast, cheapest as cheapest, tune as tune
from .fit import fit as fit
from .fit_field import FieldFit as FieldFit, fit_field as fit_field
from .fit_result import FitResult as FitResult
from .grid import as_scalar as as_scalar, check_size as check_size, points as points, values_of as values_of
from .history import particle_energies as particle_energies, system_in as system_in, write_history as write_history
from .measured import TrackedPoints as TrackedPoints
from .plots import output_path as output_path
from .sweep import complete as complete, sweep as sweep
from .sweep_ensembles import ENSEMBLE as ENSEMBLE, ensemble_summary as ensemble_summary
from .sweep_plot import plot_sweep as plot_sweep
from .sweep_points import RESULTS as RESULTS, Point as Point, Setup as Setup, final_numbers as final_numbers
from .table import EnergyLog as EnergyLog, GrowingTable as GrowingTable
from .tensor_functions import simulate_jax as simulate_jax, simulate_torch as simulate_torch
