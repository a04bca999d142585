"""A scene is changed by making another one of it, and a file keeps it, with the looks of its bodies."""

import dataclasses
import json
import re

import numpy as np
import pytest

import msdwarp as msd
from msdwarp import Contact, Plane, Scene, Simulation, Wind, at, box, chain
from msdwarp.world import radii, scene_as_stored, scene_from_stored

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


def test_bodies_that_start_deformed_touch_by_the_shape_that_is_given():
    scene = SCENE.replace(colliders=())
    flat = scene.system.replace(position=scene.system.position * (1.0, 1.0, 0.5))
    several = scene, scene.replace(system=flat, shape=scene.system.position), scene.replace(system=flat)
    found = [Simulation.from_scene(one, device="cpu").assembly.body_contact.surfaces for one in several]
    as_given, flattened = ((found[0].on_host.weight != one.on_host.weight).any() for one in found[1:])
    assert (as_given, flattened) == (False, True)
    with pytest.raises(ValueError, match="shape"):
        SCENE.replace(shape=np.zeros((2, 3)))


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


BODIES = msd.ball(0.2, 0.1).named("ball") + msd.chain(4).translate((0, 0, 3)).named("rope")
IMAGE = np.arange(48, dtype=np.uint8).reshape(4, 4, 3)


@pytest.mark.parametrize(
    ("looks", "message"),
    [
        ({"bal": msd.Look()}, "a name in looks is 'bal'; it must be one of 'ball', 'rope'"),
        ({"ball": "red"}, "looks['ball'] is 'red'; it must be a Look, such as Look(color='#d9603b')"),
        (
            {"rope": msd.Look(azimuth=10, obstacle="#000000", obstacle_texture=IMAGE)},
            "looks['rope'] sets azimuth and obstacle and obstacle_texture, which is of the whole picture; it must "
            "be set by the scene's look",
        ),
        ({"ball": msd.Look(strain=True)}, "looks['ball'] sets strain, which is of the whole picture"),
    ],
)
def test_what_is_no_look_of_a_body_is_named(looks, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        msd.Scene(system=BODIES, looks=looks)


def stored_and_back(scene, forget=()):
    """Return a scene as a file gives it back, which was written before there were some of its entries."""
    described, arrays = scene_as_stored(scene, [0.0])
    described = json.loads(json.dumps(described))
    for name in forget:
        described.pop(name)
    return scene_from_stored(scene.system, described, arrays)


def test_a_file_keeps_looks_in_their_order():
    own = {
        "rope": msd.Look(color="#2050b0", tube=0.02, particles=True),
        "ball": msd.Look(texture=IMAGE, smooth=False, gloss=0.5, finish="glass"),
    }
    scene = msd.Scene(system=BODIES, look=msd.Look(texture=255 - IMAGE, azimuth=10), looks=own)
    found = stored_and_back(scene)
    assert list(found.looks) == ["rope", "ball"]
    for one, other in [(found.look, scene.look), *((found.looks[name], own[name]) for name in own)]:
        for name, value in vars(other).items():
            np.testing.assert_array_equal(getattr(one, name), value)


def test_a_file_keeps_where_the_camera_is_aimed_and_says_nothing_of_what_earlier_versions_lack():
    for look in (msd.Look(target=(1, 2, 3), distance=4.0), msd.Look(follow="ball")):
        found = stored_and_back(msd.Scene(system=BODIES, look=look)).look
        assert (found.target, found.distance, found.follow) == (look.target, look.distance, look.follow)
    described, _ = scene_as_stored(msd.Scene(system=BODIES), [0.0])
    assert not {"target", "distance", "follow", "finish"} & described["look"].keys()


def test_a_file_keeps_the_size_of_grains():
    sand = msd.System(position=[[0, 0, 3.0], [0, 0, 4.0]]).named("sand")
    rule = msd.Contact(groups=("sand", "sand"), thickness=0.04, stiffness=100.0)
    found = stored_and_back(msd.Scene(system=BODIES + sand, contact=[msd.Contact(exclude=True), rule]))
    assert radii(found.contact_rules, found.system).tolist() == [0.0] * BODIES.particle_count + [0.02] * 2
    described, _ = scene_as_stored(msd.Scene(system=BODIES, contact=msd.Contact()), [0.0])
    assert "thickness" not in described


def test_a_file_from_before_there_were_looks_of_bodies_opens():
    scene = msd.Scene(system=BODIES, look=msd.Look(color="#2050b0"))
    found = stored_and_back(scene, forget=("looks",))
    assert (found.looks, found.look.color) == ({}, "#2050b0")
