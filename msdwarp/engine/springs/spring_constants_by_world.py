"""The forces of an ensemble: the algorithm of a single world, with constants of springs for each world.

Springs with equal constants within every world form a class. The algorithm is first set up for an auxiliary system
(the stand-in), whose stiffnesses are class indices. Where the algorithm stores an index, in a table, an array or
by direction, each world's constants of that class replace it.
"""

from math import lcm
from typing import Any, NamedTuple

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ...kernels.integrators.differences import EACH, SHARED, UNIFORM
from ..device.device import view_of
from ..model.model import CONSTANTS, Model
from .force_algorithms import CLASSES, records_of_three
from .fracture import Fracture


class EnsembleForces(NamedTuple):
    """The force algorithm of an ensemble, and how spring constants differ between worlds."""

    force_algorithm: Any
    """The algorithm, as for a single world."""
    data: Any
    """The struct that the algorithm's kernels read, shared by all worlds."""
    storage: str = ""
    """See `kernels.integrators.Differences`."""
    how: dict[str, str] = {}  # noqa: RUF012 (a default that is never changed)
    """How each constant differs between worlds, by name: SHARED, UNIFORM or EACH."""
    fields: dict[str, wp.array] = {}  # noqa: RUF012
    """The arrays that kernels index by world."""


def ensemble_forces(model: Model, fracture: Fracture | None, rest_length: wp.array | None) -> EnsembleForces:
    """Return an ensemble's forces by its model's algorithm; `rest_length` has a row per world if springs yield.

    Raises ValueError if the algorithm is a stencil, and constants vary among a direction's springs.
    """
    forces = _algorithm_of_worlds(model, fracture, rest_length)
    if fracture is not None:
        fracture.repeat_for_worlds(forces.data)
    return forces


def _algorithm_of_worlds(model: Model, fracture: Fracture | None, rest_length: wp.array | None) -> EnsembleForces:
    """Return the algorithm, and spring constants by world where they differ."""
    if rest_length is not None:
        return _yielding(model, CLASSES[model.force_algorithm](model, fracture), rest_length)
    if not model.rows.keys() & set(CONSTANTS):
        forces = CLASSES[model.force_algorithm](model, fracture)
        return EnsembleForces(forces.force_algorithm, forces.data)
    classes = Classes(model)
    forces = CLASSES[model.force_algorithm](_stand_in(model, classes), fracture)
    if model.force_algorithm == "scatter":  # the stand-in has one world, the array of forces has all
        forces.data.f = model.vectors()
    if model.force_algorithm == "stencil":
        return _by_direction(model, forces, classes)
    constants = forces.data.constants
    if hasattr(constants, "all"):
        rows = classes.together()[:, 0]
        one = wp.array(rows, dtype=wp.types.vector(rows.shape[1], model.scalar), device=model.device)
        return EnsembleForces(forces.force_algorithm, forces.data, "one", {}, {"constants": one})
    if hasattr(constants, "table"):
        kinds = classes.named(constants.table.numpy()[:, 1])
        return EnsembleForces(
            forces.force_algorithm, forces.data, "table", {}, {"constants": _tables(model, classes, kinds)}
        )
    chosen = classes.named(constants.stiffness.numpy())
    how, fields = {}, {}
    for name in CONSTANTS:
        values = classes.values(name)[:, chosen]
        how[name] = EACH if name in model.rows else SHARED
        if name in model.rows:
            fields[name] = model.upload_rows(values)
        else:
            setattr(constants, name, wp.array(values[0], dtype=model.scalar, device=model.device))
    return EnsembleForces(forces.force_algorithm, forces.data, "own", how, fields)


def _yielding(model: Model, forces: Any, rest_length: wp.array) -> EnsembleForces:
    """Return forces with constants stored for each spring, because yielding changes rest lengths."""
    fields = {"rest_length": rest_length.reshape((model.worlds, model.connection_count))}
    how = {"rest_length": EACH}
    for name in ("stiffness", "damping"):
        if name in model.rows:
            values = np.ascontiguousarray(model.ordered(model.rows[name].T).T)
            how[name], fields[name] = EACH, model.upload_rows(values)
    return EnsembleForces(forces.force_algorithm, forces.data, "own", how, fields)


class Classes:
    """Classes of springs; within every world the springs of a class have equal constants."""

    def __init__(self, model: Model) -> None:
        self._model, count = model, model.connection_count
        given, law = [model.row_of(name) for name in CONSTANTS], model.law_number
        given += [] if law is None else [law[None]]
        apart = [values for values in given if values.strides[1] != 0]
        self.of = np.zeros(count, dtype=np.int64)
        """The class of each spring, shape [connection_count]."""
        if apart and count:
            _, self.of = np.unique(np.concatenate(apart), axis=1, return_inverse=True)
            self.of = self.of.ravel()
        self._member = np.unique(self.of, return_index=True)[1]
        """One spring of each class."""

    def values(self, name: str) -> NDArray[np.float64]:
        """Return one constant, by name, of each class, shape [rows, class_count]."""
        return self._model.row_of(name)[:, self._member]

    def together(self) -> NDArray[np.float64]:
        """Return all constants by row and class, shape [rows, class_count, 3], in the order of CONSTANTS.

        Where springs follow several laws, the number of the law is a fourth.
        """
        each, law = [self.values(name) for name in CONSTANTS], self._model.law_number
        each += [] if law is None else [law[None, self._member]]
        rows = lcm(*map(len, each))
        return np.stack([values[np.arange(rows) % len(values)] for values in each], axis=-1)

    @staticmethod
    def named(numbers: NDArray) -> NDArray[np.int64]:
        """Return the class indices for stiffnesses of the stand-in; 0, for no spring, gives class 0."""
        return np.maximum(np.rint(numbers).astype(np.int64) - 1, 0)


def _stand_in(model: Model, classes: Classes) -> Model:
    """Return the stand-in: a model whose spring stiffnesses are class indices, counted from 1."""
    numbers: Any = classes.of + 1.0
    if model.dtype is np.float32 and numbers.max(initial=0.0) > 2**24:
        raise ValueError("connections differ in more ways than float32 can count; precision must be 'float64'")
    if numbers.max(initial=1.0) == 1.0:
        numbers = 1.0
    damping = 1.0 if model.laws.damper else 0.0
    system = model.system.replace(stiffness=numbers, damping=damping, rest_length=1.0)
    return Model(
        system,
        gravity=0.0,
        device=model.device.alias,
        precision=model.precision,
        force_algorithm=model.force_algorithm,
    )


def _tables(model: Model, classes: Classes, kinds: NDArray[np.int64]) -> wp.array:
    """Upload a table with the constants of each kind, one row of the table per row of parameters, in records."""
    values = classes.together()[:, kinds]
    records: Any = records_of_three(model, values.reshape(-1, values.shape[-1]))
    (size,) = records.strides
    return view_of(records, values.shape[:2], (size * len(kinds), size))


def _by_direction(model: Model, forces: Any, classes: Classes) -> EnsembleForces:
    """Return a stencil's forces, with constants by direction, or by kind of lattice and direction."""
    data, how, fields = forces.data, {}, {}
    uniform = not isinstance(data.stiffness, wp.array)
    numbers = np.array([float(one) for one in data.stiffness]) if uniform else data.stiffness.numpy()
    chosen = classes.named(numbers)
    for name in CONSTANTS:
        # Directions without a spring have no constants.
        values = np.where(numbers > 0, classes.values(name)[:, chosen], 0.0)
        how[name] = SHARED if name not in model.rows else EACH
        if uniform and name in model.rows and (values == values[:, :1]).all():
            how[name] = UNIFORM
        Each = wp.types.vector(chosen.shape[-1], model.scalar) if uniform else model.scalar
        if how[name] == UNIFORM:
            fields[name] = wp.array(values[:, 0], dtype=model.scalar, device=model.device)
        elif how[name] == EACH:
            fields[name] = wp.array(values, dtype=Each, device=model.device)
        elif uniform:
            setattr(data, name, Each(*map(float, values[0])))
        else:
            setattr(data, name, wp.array(values[0], dtype=model.scalar, device=model.device))
    return EnsembleForces(forces.force_algorithm, data, "lattice" if uniform else "lattices", how, fields)
