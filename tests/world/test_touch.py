"""What is said of bodies that touch: restitution against an integrator of its own, refusals, which rule holds."""

import itertools

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from msdwarp import Contact, Force, Plane, Scene, Simulation, box, sheet
from msdwarp.world.contact import restitution_of
from msdwarp.world.loads import Load


def bounce(ratio: float) -> float:
    """Return the speed at which a contact x'' + 2 ζ x' + x = 0 lets go that begins at x = 0 and x' = 1."""

    def let_go(t, y):
        return y[0] + 2 * ratio * y[1]  # the force, which is above 0 while they touch

    let_go.terminal, let_go.direction = True, -1
    # A heavily damped one creeps out at the slower rate 1 / 2ζ.
    options = {"events": let_go, "rtol": 1e-11, "atol": 1e-13}
    end = solve_ivp(lambda t, y: [y[1], -y[0] - 2 * ratio * y[1]], (0, 200 * (1 + ratio)), [0.0, 1.0], **options)
    return -float(end.y_events[0][0, 1])


@pytest.mark.parametrize("ratio", [0.0, 0.01, 0.2, 0.5, 0.7071, 0.9, 0.999, 1.0, 1.001, 1.5, 4.0])
def test_restitution_of_a_damped_contact(ratio):
    # solve_ivp errs by 1e-11 of a speed of 1 a step, in some hundred steps; near ζ = 1 the closed form takes the
    # difference of two numbers that agree to 1e-3, and at 1 is that of 1 + 1e-9: 1e-8 in all.
    assert restitution_of(ratio) == pytest.approx(bounce(ratio), abs=1e-8)


@pytest.mark.parametrize("restitution", [0.05, 0.2, 0.5, 0.9, 0.999, 1.0])
def test_a_damping_ratio_gives_its_restitution(restitution):
    # Bisection halves an interval of 10 until float64 has no numbers between: ε of 10, times a slope of at most 2.
    assert restitution_of(Contact(restitution=restitution).damping_ratio) == pytest.approx(restitution, abs=1e-13)


def test_restitution_falls_with_damping():
    found = [restitution_of(ratio) for ratio in np.linspace(0, 10, 400)]
    assert found[0] == 1
    assert all(a > b for a, b in itertools.pairwise(found))


DICE = box((2, 2, 2)).named("low") + box((2, 2, 2)).translate((0, 0, 3)).named("high")


@pytest.mark.parametrize(
    ("system", "contact", "message"),
    [
        (DICE, Contact(groups=("low", "hihg")), "^a name in contact.groups is 'hihg'; it must be one of 'low'"),
        (sheet((3, 3), dim=2), Contact(), "^contact is requested in 2 dimensions; it exists in three only"),
        (DICE, "all", "contact"),
        (DICE, [Contact(), 0.5], "contact"),
    ],
    ids=["a name", "flat", "a word", "a number"],
)
def test_what_cannot_touch_is_refused(system, contact, message):
    for refusing in (
        lambda: Scene(system=system, contact=contact),
        lambda: Simulation(system, contact=contact, device="cpu"),
    ):
        with pytest.raises(ValueError, match=message):
            refusing()


def test_a_scene_hands_on_how_its_bodies_touch():
    contact, force = Contact(friction=0.2), Force((0, 0, 1))
    scene = Scene(system=DICE, loads=[force], contact=contact)
    assert list(scene.loads) == [force, contact]
    # What is said anew takes the place of what was said before.
    again = Contact(groups=("low", "high"), friction=0.1), Contact(groups=("low", "low"))
    assert scene.replace(contact=again).loads == (force, *again)
    assert scene.replace(contact=()).loads == (force,)


@pytest.mark.parametrize(
    ("loads", "message"),
    [
        ([Force((0, 0, 1)), Contact()], r"loads\[1\] is a Contact; rules of contact are given by contact"),
        ([Load()], r"loads\[0\] is a Load, which does nothing; it must be one such as Force"),
        ([Plane()], r"loads\[0\] is Plane\(\); it must be a Load"),
        ([None], r"loads\[0\] is None; it must be a Load"),
    ],
    ids=["a touch", "a bare load", "a plane", "nothing"],
)
def test_what_loads_cannot_hold_is_refused(loads, message):
    for refusing in (lambda: Scene(system=DICE, loads=loads), lambda: Simulation(DICE, loads=loads, device="cpu")):
        with pytest.raises(ValueError, match=message):
            refusing()
