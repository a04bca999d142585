"""Simulations by each algorithm that sums forces, where other code creates the simulation."""

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from msdwarp import System
from msdwarp.engine.model import algorithm_choice as routes, model
from msdwarp.engine.model.algorithm_choice import ensemble_force_algorithm, find_lattice
from msdwarp.engine.model.lattice import Lattice, NotALattice


@contextmanager
def preferring(force_algorithm: str) -> Iterator[None]:
    """Within this context "auto" means the given algorithm, or gather if a stencil is not possible."""

    def chosen(system: System, *, on_gpu: bool) -> tuple[str, Lattice | None]:
        if force_algorithm != "stencil":
            return force_algorithm, None
        try:
            return "stencil", find_lattice(system)
        except NotALattice:
            return "gather", None

    def of_ensemble(system: System, *, on_gpu: bool) -> str:
        return ensemble_force_algorithm(system, on_gpu=True) if force_algorithm == "stencil" else force_algorithm

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(routes, "automatic_force_algorithm", chosen)
        patch.setattr(model, "ensemble_force_algorithm", of_ensemble)
        yield
