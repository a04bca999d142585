"""Bodies that start inside others, deeper than contact pushes out: they are named."""

import warnings

import numpy as np
import pytest

from msdwarp import Contact, Simulation, SimulationDiverged, StartWarning, ball, box, chain, sheet

SMALL = box((4, 4, 4), 0.1, mass=0.01, stiffness=1000.0, damping=1.0)
LARGE = box((9, 9, 9), 0.1, mass=0.01, stiffness=1000.0, damping=1.0)
CLOTH = sheet((9, 9), 0.1, mass=0.01, stiffness=500.0, damping=0.5)
ROPE = chain(5, spacing=0.1, mass=0.01, stiffness=500.0, damping=0.5)
OPTIONS = {"gravity": 0.0, "device": "cpu"}


@pytest.mark.parametrize("turn", [0.0, 0.7])
def test_a_body_inside_another_is_named_with_its_depth(turn):
    # The innermost particles of the small one are 0.05 m from the centre along each axis, where the large one's
    # faces are 0.4 m away: turned with it, 0.35 m deep.
    both = (SMALL + LARGE).rotate(turn, axis=(1, 2, 3)).translate((3, 0, 1))
    told = r"particle 0 starts inside the body of particle 64: .* 0\.35 m deep"
    with pytest.warns(StartWarning, match=told):
        Simulation(both, contact=Contact(), **OPTIONS)


@pytest.mark.parametrize(
    ("body", "other"),
    [(SMALL, SMALL), (ball(0.2, 0.1), ball(0.5, 0.1)), (ROPE.rotate(1.57, axis=(0, 1, 0)), LARGE), (CLOTH, LARGE)],
    ids=["in the same place", "ball", "rope", "sheet"],
)
def test_all_kinds_of_bodies_are_found_in_closed_ones(body, other):
    body, other = (one.translate(tuple(-one.position.mean(axis=0))) for one in (body, other))
    with pytest.warns(StartWarning, match="starts inside the body of particle"):
        Simulation(body + other.replace(stiffness=1000.0), contact=Contact(), **OPTIONS)


def test_what_touches_or_surrounds_a_body_is_not_inside():
    half = LARGE.position[:, 2].max() - SMALL.position[:, 2].min()
    on_top = SMALL.translate((0.03, 0.02, half + 0.001))
    shell = ball(0.2, 0.1)
    around = CLOTH.position - CLOTH.position.mean(axis=0)
    around[:, 2] = 0.3 - 2.0 * (around[:, :2] ** 2).sum(axis=1)  # hangs over the ball: its middle is in it
    others = {"at rest": LARGE + on_top, "hung over": shell + CLOTH.replace(position=around)}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for system in others.values():
            Simulation(system.replace(stiffness=1000.0), contact=Contact(), **OPTIONS)


def test_a_run_that_diverges_at_its_start_says_so():
    with pytest.warns(StartWarning, match="inside"):
        simulation = Simulation(SMALL + LARGE, contact=Contact(), **OPTIONS)
    simulation.state.v.fill_(np.nan)
    with pytest.raises(SimulationDiverged, match="the body of particle 0 starts inside the body of particle 64"):
        simulation.step()
