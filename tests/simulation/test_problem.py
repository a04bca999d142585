"""What is simulated of a scene: what users give is taken once, and stays what it was."""

import numpy as np
import pytest

from msdwarp import Contact, Ensemble, Scene, Simulation, box, chain
from msdwarp.cli.provenance import digest


@pytest.mark.parametrize("given", [list, iter], ids=["list", "iterator"])
def test_contact_stays_after_a_change(given):
    rules = [Contact()]
    simulation = Simulation(chain(5), contact=given(rules), device="cpu")
    rules.clear()
    simulation.change(mass=0.5)
    assert [type(one) for one in simulation.loads] == [Contact]


@pytest.mark.parametrize("contact", [0, ""], ids=repr)
def test_what_is_no_contact_is_refused(contact):
    with pytest.raises(ValueError, match="contact"):
        Simulation(chain(5), contact=contact, device="cpu")


def test_a_checkpoint_leaves_gravity_that_nobody_changed():
    earth, moon = (Simulation(chain(6), gravity=[0, 0, -g], device="cpu") for g in (9.82, 1.62))
    earth.change(mass=0.5)
    moon.restore(*earth.checkpoint())
    np.testing.assert_array_equal(moon.gravity, (0, 0, -1.62))


def test_nothing_may_be_given_beside_a_scene():
    assert Ensemble(Scene(system=chain(5)), 2, colliders=[], loads=[], device="cpu").simulation_of(0, probes=None)
    with pytest.raises(ValueError, match=r"system is a list; .*a \+ b, or sum"):
        Scene([chain(2), chain(2)])  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="contact is given beside a Scene"):
        Simulation(Scene(system=chain(5)), contact=Contact(), device="cpu")


def test_the_digest_tells_the_shape():
    body = box((3, 3, 3))
    scene = Scene(system=body, contact=Contact())
    assert digest(scene) != digest(scene.replace(shape=1.2 * body.position))


def test_a_scene_takes_its_bodies_first():
    body = chain(3)
    assert Scene(body).system is body
