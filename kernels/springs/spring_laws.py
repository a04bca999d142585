"""Laws of springs: s(ε) = force / (k l0) as a function of strain (see `msdwarp.bodies.springs`)."""

import functools
from typing import Any, NamedTuple

import warp as wp

from ..basis import fully_hashed
from .dampers import LINEAR

AHEAD, INTERVALS = 0.1, 8
"""Half width of the strain interval in which the steepest slope is sought; number of differences in it."""
PANELS = 4
"""Parts of the strain interval; on each, a five-point Gauss rule integrates."""
POINTS = (0.0, 0.5384693101056831, 0.9061798459386640)
WEIGHTS = (0.5688888888888889, 0.4786286704993665, 0.2369268850561891)


class Laws(NamedTuple):
    """The laws of all connections."""

    damper: Any = LINEAR
    """The law of dampers: name and speed, or a `wp.func`; None without dampers."""
    spring: Any = None
    """The law of springs: name and parameters, or a `wp.func`; None for the linear law."""

    @property
    def own_damper(self) -> Any:
        """The law of dampers if it is a `wp.func` of strain, rate and constant; None for a law with a name."""
        return None if isinstance(self.damper, tuple) else self.damper

    @property
    def slacken(self) -> bool:
        """Whether springs exert no force while shorter than their rest length, nor dampers more than springs."""
        return self.spring == ("tension",)


@functools.cache
def spring_stress(scalar: type, law: Any):
    """Compose s(ε), a spring's force divided by k l0, positive in tension."""
    if not isinstance(law, tuple):
        return law
    name, *numbers = law
    first, second = (*numbers, 0.0, 0.0)[:2]
    count = len(numbers)
    c = (*numbers, *(0.0,) * (5 - count)) if name == "polynomial" else (0.0,) * 5

    @functools.partial(fully_hashed, constants=law)
    def stress(strain: scalar) -> scalar:
        result = strain
        if wp.static(name == "tension"):
            result = wp.max(strain, scalar(0.0))
        if wp.static(name == "limited"):
            beyond = wp.max(strain - scalar(wp.static(first)), scalar(0.0))
            result = strain + scalar(wp.static(second - 1.0)) * beyond
        if wp.static(name == "exponential"):
            result = (wp.exp(scalar(wp.static(first)) * strain) - scalar(1.0)) / scalar(wp.static(first))
        if wp.static(name == "polynomial"):
            result = scalar(0.0)
            for k in range(wp.static(count)):
                result = (result + scalar(wp.static(c[count - 1 - k]))) * strain
        return result

    return stress


@functools.cache
def spring_energy(law: Any):
    """Compose ∫ s dε from 0 to ε, a spring's energy divided by k l0², in float64."""
    stress = spring_stress(wp.float64, law)
    name, *numbers = law if isinstance(law, tuple) else ("own",)
    first, second = (*numbers, 0.0, 0.0)[:2]

    @functools.partial(fully_hashed, constants=law)
    def energy(strain: wp.float64) -> wp.float64:
        half = wp.float64(0.5)
        total = wp.float64(0.0)
        if wp.static(name == "tension"):
            total = half * wp.max(strain, wp.float64(0.0)) * strain
        elif wp.static(name == "limited"):
            beyond = wp.max(strain - wp.float64(wp.static(first)), wp.float64(0.0))
            total = half * (strain * strain + wp.float64(wp.static(second - 1.0)) * beyond * beyond)
        else:
            width = half * strain / wp.float64(wp.static(PANELS))
            for p in range(wp.static(PANELS)):
                middle = wp.float64(2 * p + 1) * width
                for k in range(3):
                    away = wp.float64(wp.static(POINTS[k])) * width
                    weight = wp.float64(wp.static(WEIGHTS[k])) * width
                    total += weight * stress(middle + away)
                    if wp.static(k > 0):
                        total += weight * stress(middle - away)
        return total

    return energy


@functools.cache
def steepest_slope(law: Any):
    """Compose the steepest slope of s at strains within AHEAD of a given one, at least 0; float64 differences."""
    stress = spring_stress(wp.float64, law)
    apart = 2 * AHEAD / INTERVALS

    @wp.func
    def steepest(strain: wp.float64) -> wp.float64:
        result = wp.float64(0.0)
        here = wp.max(strain - wp.float64(wp.static(AHEAD)), wp.float64(-0.99))
        before = stress(here)
        for _k in range(wp.static(INTERVALS)):
            here += wp.float64(wp.static(apart))
            after = stress(here)
            result = wp.max(result, (after - before) / wp.float64(wp.static(apart)))
            before = after
        return result

    return steepest
