"""A scene is changed by making another one of it."""

import dataclasses

import pytest

from msdwarp import Contact, Plane, Scene, Simulation, Wind, at, box, chain
from msdwarp.world import scene_as_stored, scene_from_stored

SCENE = Scene(system=box((2, 2, 2)), colliders=[Plane()], loads=[Wind((1, 0, 0))], contact=Contact(friction=0.3))


@pytest.mark.parametrize("replaced", [lambda **k: SCENE.replace(**k), lambda **k: dataclasses.replace(SCENE, **k)])
def test_a_scene_can_be_replaced_in_part(replaced):
    longer = replaced(duration=9.0)
    assert (longer.duration, longer.system, longer.loads, longer.contact) == (
        *(9.0, SCENE.system, SCENE.loads, SCENE.contact),
    )
    without = replaced(contact=None)
    assert without.contact is None
    assert without.loads == SCENE.loads[:1]
    rougher = Contact(friction=0.9)
    assert replaced(contact=rougher).loads == (SCENE.loads[0], rougher)
    assert replaced(loads=()).loads == (SCENE.contact,)
    assert replaced(contact=None).replace(contact=rougher).loads == (SCENE.loads[0], rougher)
    with pytest.raises(ValueError, match="duration is -1"):
        replaced(duration=-1)
    with pytest.raises(ValueError, match=r"loads\[1\] is a Contact"):
        replaced(contact=None, loads=list(SCENE.loads))


def test_a_field_that_a_scene_lacks_is_named():
    with pytest.raises(TypeError, match=r"Scene.replace\(\) got an unexpected keyword argument 'seconds'"):
        SCENE.replace(seconds=3)


def test_files_whose_gravity_is_a_number_below_0_still_open():
    scene = Scene(system=chain(3), gravity=1.0, schedule=[at(0.5, gravity=2.0)])
    described, arrays = scene_as_stored(scene, [0.0])
    described["gravity"], described["schedule"][0]["gravity"] = -1.5, -2.5
    found = scene_from_stored(scene.system, described, arrays)
    assert found.gravity == (0.0, 0.0, 1.5)
    assert found.schedule[0].gravity == (0.0, 0.0, 2.5)
    simulation = Simulation(scene.system, gravity=1.0, device="cpu")
    numbers = simulation.checkpoint()[1] | {"gravity": -1.5}
    simulation.restore(simulation.checkpoint()[0], numbers)
    assert simulation.gravity == (0.0, 0.0, 1.5)
