"""Examples of the docs: each builds a scene that starts without a warning."""

import runpy
from pathlib import Path

import numpy as np
import pytest

import msdwarp as msd

EXAMPLES = sorted((Path(__file__).parents[1] / "docs" / "examples").glob("*.py"))


@pytest.mark.slow
@pytest.mark.parametrize("path", EXAMPLES, ids=[path.stem for path in EXAMPLES])
def test_an_example_starts(path):
    simulation = msd.Simulation(runpy.run_path(str(path))["build"](), device="cpu")
    simulation.step(2)
    assert np.isfinite(simulation.frame().position).all()
