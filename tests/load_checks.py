"""What holds for every load that is a sum over elements."""

import numpy as np
import pytest
from alone import assert_each_is_as_alone
from differences import FRAMES, check, loss, simulation

from msdwarp import RK4, Ensemble, Load, Simulation, System
from msdwarp.engine.diagnostics.rate_bounds import rate_bounds
from msdwarp.engine.stepping.assemble import assemble
from msdwarp.world import ElementLoad, Problem


def check_load(load: Load, body: System, device: str) -> None:
    """Check energy and work, gradients, the bound of the step, and worlds of an ensemble, without dampers."""
    assert isinstance(load, ElementLoad)
    how = {"loads": [load], "device": device}
    options = {"gravity": 0.0, "precision": "float64", "integrator": RK4(), **how}
    run = Simulation(body, substeps=16 * Simulation(body, **options).substeps, **options)
    first = run.measure()
    run.step(10)
    last = run.measure()
    assert load.stores == (first.effect_energy != 0.0)
    # RK4 loses (hω)⁶/72 in a substep: a ten-millionth for a sixteenth of the longest step, and in all a millionth.
    gained = last.energy - first.energy - last.external_work
    assert gained == pytest.approx(0.0, abs=1e-4 * max(last.kinetic_energy, abs(last.external_work)))
    found = simulation(body, **how).gradient(loss, FRAMES, by=["position", "velocity"])
    for name in ("position", "velocity"):
        check(body, name, found[name], **how)
    bound = rate_bounds(body, assemble(Problem(system=body, loads=[load]), device=device, precision="float64"))
    assert bound.effect_stiffness > 0.0
    alike = Ensemble(body, 2, mass=np.array([[1.0], [2.0]]) * body.mass, gravity=0.0, **how)
    assert_each_is_as_alone(alike, frames=5)
