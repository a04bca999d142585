"""A substep as physics reads it."""

from collections.abc import Callable, Sequence

import warp as wp

from ..model.state import State
from .dynamics import Dynamics
from .stages import Solve, Stage


def take_substep(
    dynamics: Dynamics,
    state: State,
    stages: Sequence[Stage | Solve],
    substep: int,
    look: Callable[[int, wp.array, wp.array], None] | None = None,
) -> None:
    """Launch substep number `substep` of a frame, from `state.state_in` to `state.state_out`.

    `stages` are those of the method, such as one kick and drift. Before stage n, `look` is called with n and with
    the positions and velocities at which it evaluates forces.

    What a scene lacks is not launched. One kernel fuses what `advance` does, for all springs, loads and obstacles
    of the scene (`take_stage` in `kernels/integrators/stages.py`); if forces are scattered, a kernel of a thread
    per spring comes before it. Where `advance` is all, one kernel fuses the substeps of a frame (`persistent.py`,
    `shared_memory.py`, `cpu_partition.py`). For small bodies in contact one kernel fuses all of this but
    `keep_apart`, which they do not need (`contact_launch.py`). `Stepper` chooses.
    """
    dynamics.begin_substep(state.state_in, substep)  # springs yield, relax and break
    for n, stage in enumerate(stages):
        if look is not None and isinstance(stage, Stage):
            look(n, stage.fields["x"], stage.fields["v"])
        take_stage(dynamics, stage)
    dynamics.keep_apart(state.state_in, state.state_out)  # near surfaces, so that none crosses another


def take_stage(dynamics: Dynamics, stage: Stage | Solve) -> None:
    """Launch a stage of a substep; between frames, or to measure, the forces of a moment."""
    if isinstance(stage, Solve):
        stage.launch(dynamics)
        return
    step = stage.step(dynamics.composition)
    if dynamics.has_parts_before(stage):
        dynamics.find_neighbors(step)  # of each point on a surface, if the list may be outdated
        dynamics.evaluate_contact(step)  # of bodies; also cells, pressure and other sums over several particles
    dynamics.advance(stage, step)  # forces of springs, loads and gravity; kick and drift; obstacles; drives
