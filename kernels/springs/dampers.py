"""Damping laws: forces against a spring's rate of lengthening (see `msdwarp.bodies.dampers`)."""

import functools
from typing import Any

import warp as wp

from ..basis import vector

LINEAR = ("linear",)
"""The form of the linear law."""
SPEED = 5
"""Place of a damping law's number among the `LAW_NUMBERS`: the speed at which it becomes linear [m/s]."""
LAW_NUMBERS = 6
"""Length of the vector of a law's numbers: at most five of the spring, and the damper's speed."""


def law_numbers(scalar: type) -> Any:
    """Return the vector type of the numbers of a law."""
    return vector(LAW_NUMBERS, scalar)


@functools.cache
def damper_force(scalar: type, form: Any):
    """Compose the damping force [N] along a spring, positive in tension, from the rate of lengthening l' [m/s].

    Linear: b l'. Quadratic: b min(|l'|, s) l'. Coulomb: b l'/s, at most b. The speed s is a number of the law. A
    law that is a `wp.func` depends on strain, rate and b.
    """
    Numbers = law_numbers(scalar)
    name, own = (form[0], None) if isinstance(form, tuple) else ("own", form)

    @wp.func
    def force(strain: scalar, rate: scalar, damping: scalar, law: Numbers) -> scalar:
        if wp.static(own is not None):
            return own(strain, rate, damping)
        if wp.static(name == "quadratic"):
            return damping * wp.min(wp.abs(rate), law[SPEED]) * rate
        if wp.static(name == "coulomb"):
            return damping * wp.clamp(rate / law[SPEED], scalar(-1.0), scalar(1.0))
        return damping * rate

    return force
