"""A scene is changed by making another one of it."""

import dataclasses

import pytest

from msdwarp import Plane, Scene, Touch, Wind, box

SCENE = Scene(system=box((2, 2, 2)), colliders=[Plane()], loads=[Wind((1, 0, 0))], touch=Touch(friction=0.3))


@pytest.mark.parametrize("replaced", [lambda **k: SCENE.replace(**k), lambda **k: dataclasses.replace(SCENE, **k)])
def test_a_scene_can_be_replaced_in_part(replaced):
    longer = replaced(duration=9.0)
    assert (longer.duration, longer.system, longer.loads, longer.touch) == (
        *(9.0, SCENE.system, SCENE.loads, SCENE.touch),
    )
    without = replaced(touch=None)
    assert without.touch is None
    assert without.loads == SCENE.loads[:1]
    rougher = Touch(friction=0.9)
    assert replaced(touch=rougher).loads == (SCENE.loads[0], rougher)
    assert replaced(loads=()).loads == (SCENE.touch,)
    assert replaced(touch=None).replace(touch=rougher).loads == (SCENE.loads[0], rougher)
    with pytest.raises(ValueError, match="duration is -1"):
        replaced(duration=-1)
    with pytest.raises(ValueError, match=r"loads\[1\] is a Touch"):
        replaced(touch=None, loads=list(SCENE.loads))


def test_a_field_that_a_scene_lacks_is_named():
    with pytest.raises(TypeError, match=r"Scene.replace\(\) got an unexpected keyword argument 'seconds'"):
        SCENE.replace(seconds=3)
