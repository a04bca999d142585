"""Damping laws: forces against a spring's rate of lengthening (see `msdwarp.bodies.dampers`)."""

import functools
from typing import Any

import warp as wp

from ..basis import fully_hashed

Law = tuple[str, float]
"""Name of a law, and the speed at which it becomes linear [m/s], or 0."""
LINEAR: Law = ("linear", 0.0)


@functools.cache
def damper_force(scalar: type, law: Any):
    """Compose the damping force [N] along a spring, positive in tension, from the rate of lengthening l' [m/s].

    Linear: b l'. Quadratic: b min(|l'|, s) l'. Coulomb: b l'/s, at most b. The speed s belongs to the law. A law
    that is a `wp.func` also depends on strain, and is called elsewhere.
    """
    name, speed = law if isinstance(law, tuple) else LINEAR

    @functools.partial(fully_hashed, constants=law)
    def force(rate: scalar, damping: scalar) -> scalar:
        if wp.static(name == "quadratic"):
            return damping * wp.min(wp.abs(rate), scalar(speed)) * rate
        if wp.static(name == "coulomb"):
            return damping * wp.clamp(rate / scalar(speed), scalar(-1.0), scalar(1.0))
        return damping * rate

    return force
