"""Restarts in the middle of contact, and of tearing: what goes on is the same to the last bit."""

import copy
import pickle

import numpy as np
import pytest
import warp as wp

from msdwarp import Contact, Ensemble, Plane, Scene, Simulation, System, ball, box, sheet
from msdwarp.engine.collision.neighbor_list import NeighborList


def thrown(break_strain: float = np.inf) -> System:
    """Return a ball that is thrown into a sheet, which is held at its rim and resists bending."""
    cloth = sheet((10, 10), 0.05, mass=0.002, stiffness=150.0, damping=0.1, bending=1e-3)
    rim = [k for k in range(100) if k % 10 in (0, 9) or k < 10 or k >= 90]
    weight = ball(0.1, 0.05, mass=0.01, stiffness=300.0, damping=0.2).translate((0, 0, 0.14))
    return cloth.replace(break_strain=break_strain).pin(rim) + weight.with_velocity((0, 0, -8))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("break_strain", "frames"), [pytest.param(np.inf, 8, id="whole"), pytest.param(0.1, 40, id="torn")]
)
def test_a_restart_in_contact_goes_on_to_the_last_bit(plain_device, break_strain, frames):
    # Hundreds of facets are near a point of the sheet by then; where the run starts there are none.
    run, restored = (
        Simulation(thrown(break_strain), contact=Contact(), device=plain_device, fps=240.0) for _ in range(2)
    )
    run.step(frames)
    restored.restore(*run.checkpoint())
    one, other = run.measure(), restored.measure()
    assert other.effect_energy == one.effect_energy
    assert one.effect_energy > 0 or run.snapshot().broken.any()
    assert other.dissipated_power == one.dissipated_power
    for _ in range(6):
        run.step()
        restored.step()
    assert restored.substeps == run.substeps
    np.testing.assert_array_equal(restored.frame().position, run.frame().position)
    np.testing.assert_array_equal(restored.frame().velocity, run.frame().velocity)
    # The largest strain is that of what is whole.
    now = run.snapshot()
    assert now.broken.any() == np.isfinite(break_strain)
    along = np.diff(now.position[now.connections], axis=1)[:, 0]
    strain = np.abs(np.linalg.norm(along, axis=1) / now.rest_length - 1)
    counts = ~now.broken & now.between_neighbors
    # float32 positions of half a metre: 3e-8 m of lengths of 5 cm, and as much again in a difference.
    assert run.stepping.balance().strain == pytest.approx(strain[counts].max(), abs=1e-5)


def test_a_simulation_says_that_it_has_no_copy():
    for made in (Simulation(box((2, 2, 2)), device="cpu"), Ensemble(box((2, 2, 2)), 2, device="cpu")):
        for refused in (copy.copy, copy.deepcopy, pickle.dumps):
            with pytest.raises(TypeError, match="use checkpoint and restore"):
                refused(made)


def sheets(apart: float) -> Scene:
    """Return two sheets so far over each other [m], above a floor: they touch at 0.14 m."""
    sheet_of_cloth = sheet((12, 12), spacing=0.05, mass=0.001, stiffness=50.0, damping=0.02)
    two = sheet_of_cloth + sheet_of_cloth.translate((0.01, 0.0, apart))
    return Scene(system=two, colliders=[Plane()], contact=Contact(thickness=0.14, self_contact=False))


def nearby_in(run) -> NeighborList:
    return run.assembly.body_contact.neighbors


def marked(nearby: NeighborList) -> list[wp.array]:
    """Return the lists of what is near what, each filled with what no list holds."""
    data = nearby.data
    rows = [data.candidates, data.candidate_pair, data.candidate_distance, data.body_pairs]
    for one in rows:
        one.fill_(-777)
    return rows


def untouched(rows: list[wp.array]) -> bool:
    return all((one.numpy() == -777).all() for one in rows)


@pytest.mark.slow
@pytest.mark.parametrize("made", [1, 2, "worlds"])
def test_nothing_recorded_writes_into_lists_that_were_replaced(plain_device, made):
    # On a GPU that memory may be another's by then.
    if made == 2 and plain_device != "cpu":
        pytest.skip("a GPU has threads of its own")
    if made == "worlds":
        run = Ensemble(sheets(0.15), 2, device=plain_device)
    else:
        run = Simulation.from_scene(sheets(0.15), device=plain_device, threads=made)
    run.step(2)
    nearby = nearby_in(run)
    old = marked(nearby)
    nearby._give_room(256, 4)
    if made != "worlds":
        run.stepping.balance()
        assert untouched(old)
    run.step()
    assert nearby.data.candidate_count.numpy().any(), "nothing is listed: the test is of nothing"
    assert untouched(old)


@pytest.mark.slow
def test_a_change_behind_a_restart_does_not_write_into_lists_that_were_replaced(plain_device, monkeypatch):
    run = Simulation.from_scene(sheets(0.2), device=plain_device)
    run.step(20)
    restored = Simulation.from_scene(sheets(0.2), device=plain_device)
    old, give_room = list[list[wp.array]](), NeighborList._give_room

    def give_room_and_note(nearby, room, body_pairs):
        if nearby.data.candidates is not None and nearby.data.candidates.size:
            old.append(marked(nearby))
        give_room(nearby, room, body_pairs)

    monkeypatch.setattr(NeighborList, "_give_room", give_room_and_note)
    restored.restore(*run.checkpoint())
    assert old, "nothing was replaced: the test is of nothing"
    restored.change(stiffness=60.0)
    assert all(map(untouched, old))
