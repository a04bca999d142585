"""Observations of an ensemble, frame by frame: means over groups, energies, whole frames."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from .. import checks
from ..bodies import check_types
from ..engine import GroupMeans, Sensors, measure
from ..runtime import in_turn
from ..world import (
    BODY_CONTACT_FORCE,
    CONTACT_FORCE,
    FORCE,
    FRAME,
    POSITION,
    QUANTITIES,
    UNITS,
    VELOCITY,
    Probe,
    observed_values,
)

ENERGIES = ("kinetic energy", "elastic energy", "gravitational energy")
WHOLE = {"positions": ("position", "m"), "velocities": ("velocity", "m/s")}
"""Observations of all particles: the field of `Frame`, and the unit."""
OBSERVED = [one for one in QUANTITIES if one not in (CONTACT_FORCE, BODY_CONTACT_FORCE)]
"""Quantities that probes of an ensemble may measure."""
WORDS = ("energy", *ENERGIES, *WHOLE)
AXES = ("x", "y", "z")
COORDINATES = ("world", "frame", "axis", "particle", "time", "status", "diverged_at")
"""What every result has beside the observed quantities."""


@dataclass(frozen=True, eq=False)
class GroupMean:
    """The mean of a function over a group of particles, computed on the device.

    Parameters
    ----------
    function
        A `wp.func` (x, v, i) of a particle's position [m] and velocity [m/s], vectors of float64 such as
        `wp.vec3d`, and the particle's index. It returns a `wp.float64`, or a vector of several.
    on
        The group: a name, indices, or a mask; None for all particles. All have equal weight.
    width
        Length of the vector that the function returns; 0 if it returns one number.

    Raises
    ------
    ValueError
        If the function is not a `wp.func`, or the width is not a whole number.
    """

    function: Any
    on: Any = None
    width: int = 0

    def __post_init__(self) -> None:
        """Check the arguments."""
        checks.instance("function", self.function, wp.Function, "a wp.func (x, v, i)")
        checks.count("width", self.width, 0)


class Observation:
    """An observed quantity: its name, the names of its axes, its unit, and a function that measures it."""

    def __init__(self, name: str, axes: tuple[str, ...], unit: str, measure: Callable[[], NDArray]) -> None:
        self.name, self.unit, self._axes, self._measure = name, unit, axes, measure
        self.values: list[NDArray] = []
        """One value per call of `look`, shape [worlds, ...]."""

    @in_turn
    def look(self) -> None:
        """Append the current value."""
        value = np.array(self._measure())  # a copy: a function may return the same array again
        if self.values and value.shape != self.values[0].shape:
            raise ValueError(
                f"observe[{self.name!r}] returned shape {value.shape}, and {self.values[0].shape} before; it must "
                "always be the same"
            )
        self.values.append(value)

    def variable(self) -> tuple[tuple[str, ...], NDArray, dict[str, str]]:
        """Return (dimensions, values, attributes) as xarray takes them."""
        values = np.stack(self.values, axis=1)
        named = self._axes or tuple(f"{self.name}_{k}" for k in range(values.ndim - 2))
        return ("world", "frame", *named[: values.ndim - 2]), values, {"units": self.unit} if self.unit else {}


@in_turn
def observations(ensemble: Any, observe: Mapping[str, Any]) -> list[Observation]:
    """Return the requested observations of an `Ensemble`; raise ValueError naming an invalid one."""
    found = []
    for name, what in checks.mapping("observe", observe).items():
        checks.instance("a name in observe", name, str, "'top'")
        if name in COORDINATES:
            raise ValueError(f"a name in observe is {name!r}; the result has {', '.join(COORDINATES)} anyway")
        try:
            found.append(_observation(ensemble, name, what))
        except ValueError as error:
            raise ValueError(f"observe[{name!r}]: {error}") from error
    return found


def _observation(ensemble: Any, name: str, what: Any) -> Observation:
    """Return one requested observation."""
    model, state = ensemble.model, ensemble.state
    if isinstance(what, Probe):
        checks.one_of("what", what.what, OBSERVED)
        checks.one_of("every", what.every, (FRAME,))
        what.check(model.system, (), False)
        sensors = Sensors(ensemble.stepping.dynamics, state, {name: what}, 1, 1 / ensemble.fps, None)

        def measured() -> NDArray:
            sensors.launch(ensemble.velocity())
            return sensors.read()[name][0]

        axes = ("axis",) if what.what in (POSITION, VELOCITY, FORCE) else ()
        return Observation(name, axes, UNITS[what.what], measured)
    if isinstance(what, GroupMean):
        wide = wp.types.vector(model.dim, wp.float64)
        result: Any = wp.types.vector(what.width, wp.float64) if what.width else wp.float64
        check_types("function", what.function, {"x": wide, "v": wide, "i": wp.int32}, result)
        chosen = Probe(slice(None) if what.on is None else what.on, POSITION).particles(model.system)
        means = GroupMeans(model, what.function, chosen, what.width)

        def mean() -> NDArray:
            found = means.read(state, ensemble.velocity())
            return found if what.width else found.ravel()

        return Observation(name, (), "", mean)
    if callable(what):

        def of_frame() -> NDArray:
            _, position, velocity = ensemble.frame()
            return observed_values(name, what, position, velocity)

        return Observation(name, (), "", of_frame)
    checks.one_of("it", what, WORDS)
    if what in WHOLE:
        field, unit = WHOLE[what]
        return Observation(name, ("particle", "axis"), unit, lambda: getattr(ensemble.frame(), field))

    def energy() -> NDArray:
        measures = measure(ensemble.assembly, state, ensemble.velocity(), state.compensation.x)
        return np.asarray(getattr(measures, what.replace(" ", "_")))

    return Observation(name, (), "J", energy)


def dataset(ensemble: Any, observed: list[Observation], times: list[float]) -> Any:
    """Return observations of an `Ensemble` at some times [s], and its parameters, as an `xarray.Dataset`."""
    xarray = import_xarray()
    variables = {one.name: one.variable() for one in observed}
    coordinates: dict[str, Any] = {
        "world": np.arange(ensemble.worlds),
        "time": ("frame", np.array(times), {"units": "s"}),
        "status": ("world", ensemble.status),
        "diverged_at": ("world", ensemble.diverged_at, {"units": "s"}),
    }
    for name, values in ensemble.numbers.items():
        if name not in variables:
            coordinates[name] = ("world", values)
    if any("axis" in dimensions for dimensions, *_ in variables.values()):
        coordinates["axis"] = list(AXES[: ensemble.model.dim])
    attributes = {"fps": ensemble.fps, "substeps": ensemble.substeps, "precision": ensemble.model.precision}
    attributes |= {"integrator": repr(ensemble.integrator), "force_algorithm": ensemble.model.force_algorithm}
    return xarray.Dataset(variables, coordinates, attributes)


def import_xarray() -> Any:
    """Return xarray; raise ValueError if it is not installed."""
    return checks.imported("xarray", "results of an ensemble need xarray: pip install 'msdwarp[ensemble]'")


def single_numbers(parameters: Mapping[str, Any], worlds: int) -> dict[str, NDArray[np.float64]]:
    """Return those of an ensemble's rows of parameters that are one number per world, shape [worlds]."""
    each, found = np.arange(worlds), {}
    for name, rows in parameters.items():
        if name == "gravity":
            rows = -rows[:, -1:] if not rows[:, :-1].any() else rows  # downward gravity is one number
        if name == "strain":
            rows = rows.first[:, :0] if rows.varies else rows.first
        elif name == "delay" and (rows == rows[..., :1]).all():
            rows = rows[..., 0]
        if rows.ndim == 2 and rows.shape[1] and (rows == rows[:, :1]).all():
            found[name] = rows[each % len(rows), 0]
    return found
