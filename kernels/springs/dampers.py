"""Laws of damping: forces against the lengthening or shortening of a spring (see `msdwarp.bodies.dampers`)."""

import functools

import warp as wp

Law = tuple[str, float]
"""Name of a law, and the speed at which it becomes linear [m/s], 0 where it has none."""
LINEAR: Law = ("linear", 0.0)


@functools.cache
def damper_force(scalar: type, law: Law):
    """Compose the force [N] that shortens a spring which lengthens at `rate` [m/s].

    Linear: b l'. Quadratic: b min(|l'|, s) l'. Coulomb: b l'/s, at most b. The last two have a speed s.
    """
    name, speed = law

    @wp.func
    def force(rate: scalar, damping: scalar) -> scalar:
        if wp.static(name == "quadratic"):
            return damping * wp.min(wp.abs(rate), scalar(speed)) * rate
        if wp.static(name == "coulomb"):
            return damping * wp.clamp(rate / scalar(speed), scalar(-1.0), scalar(1.0))
        return damping * rate

    return force
