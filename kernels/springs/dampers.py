"""Damping laws: forces against a spring's rate of lengthening (see `msdwarp.bodies.dampers`)."""

import functools
from typing import Any

import warp as wp

from ..basis import fully_hashed, vector

LINEAR = ("linear",)
"""The form of the linear law."""
SPEED, SPRING_FORM, DAMPER_FORM = 5, 6, 7
"""Places in the vector of a law's numbers: the speed at which a damper becomes linear [m/s], and which of
the forms in `Laws` spring and damper have. At most five numbers of the spring are before these."""
LAW_NUMBERS = 8


def law_numbers(scalar: type) -> Any:
    """Return the vector type of the numbers of a law."""
    return vector(LAW_NUMBERS, scalar)


def law_data(scalar: type, laws: Any) -> Any:
    """Return the type of the numbers of the law in a kernel's data; of several laws it has an array."""
    return wp.array(dtype=law_numbers(scalar)) if laws.several else law_numbers(scalar)


@functools.cache
def damper_force(scalar: type, laws: Any):
    """Compose the damping force [N] along a spring, positive in tension, from the rate of lengthening l' [m/s].

    Linear: b l'. Quadratic: b min(|l'|, s) l'. Coulomb: b l'/s, at most b. The speed s is a number of the law. A
    law that is a `wp.func` depends on strain, rate and b. Beside a spring that only pulls, a damper's force is at
    most the spring's, `pull`.
    """
    Numbers, form = law_numbers(scalar), laws.damper or LINEAR
    names, own = (form, None) if isinstance(form, tuple) else (("own",), form)
    count, alone = len(names), len(names) == 1
    slack = laws.spring.index("tension") if laws.slackens else 0

    @fully_hashed
    def force(strain: scalar, rate: scalar, damping: scalar, pull: scalar, law: Numbers) -> scalar:
        result = damping * rate
        for n in range(wp.static(count)):
            if wp.static(alone) or law[DAMPER_FORM] == scalar(wp.static(n)):
                if wp.static(names[n] == "own"):
                    result = own(strain, rate, damping)
                if wp.static(names[n] == "quadratic"):
                    result = damping * wp.min(wp.abs(rate), law[SPEED]) * rate
                if wp.static(names[n] == "coulomb"):
                    result = damping * wp.clamp(rate / law[SPEED], scalar(-1.0), scalar(1.0))
        if wp.static(laws.slackens):  # not `clamp`, whose derivative by `result` is 1 where all three are 0
            if wp.static(not laws.several) or law[SPRING_FORM] == scalar(wp.static(slack)):
                result = wp.max(wp.min(result, pull), -pull)
        return result

    return force
