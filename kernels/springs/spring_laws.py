"""Laws of springs: s(ε) = force / (k l0) as a function of strain (see `msdwarp.bodies.springs`).

The form of a law is compiled. Its numbers are an argument, as for the laws of dampers (`dampers.py`).
"""

import functools
from typing import Any, NamedTuple

import warp as wp

from ..basis import fully_hashed
from .dampers import LINEAR, SPEED, law_numbers

AHEAD, INTERVALS = 0.1, 8
"""Half width of the strain interval in which the steepest slope is sought; number of differences in it."""
PANELS = 4
"""Parts of the strain interval; on each, a five-point Gauss rule integrates."""
POINTS = (0.0, 0.5384693101056831, 0.9061798459386640)
WEIGHTS = (0.5688888888888889, 0.4786286704993665, 0.2369268850561891)
MOST_COEFFICIENTS = 5
"""Maximal number of terms of a polynomial; shorter ones have zeros at the end."""


class Laws(NamedTuple):
    """The forms of the laws of all connections, from which kernels are composed."""

    damper: Any = LINEAR
    """Form of the dampers' law: its name in a tuple, or a `wp.func`; None without dampers."""
    spring: Any = None
    """Form of the springs' law: its name in a tuple, or a `wp.func`; None for the linear law."""

    @property
    def linear(self) -> bool:
        """Whether springs and dampers are linear, so that their laws have no numbers."""
        return self.spring is None and self.damper in (None, LINEAR)

    @property
    def slacken(self) -> bool:
        """Whether springs exert no force while shorter than their rest length, nor dampers more than springs."""
        return self.spring == ("tension",)


def form_of(law: Any) -> Any:
    """Return the form of a law of `msdwarp.bodies`: its name in a tuple, or what it is if it has no numbers."""
    return law[:1] if isinstance(law, tuple) else law


def numbers_of(spring: Any, damper: Any) -> tuple[float, ...]:
    """Return the numbers of the laws of springs and dampers, in the order of `law_numbers`."""
    first, last = (law[1:] if isinstance(law, tuple) else () for law in (spring, damper))
    return (*first, *(0.0,) * (SPEED - len(first)), *(last or (0.0,)))


@functools.cache
def connection_table(scalar: type, laws: Laws):
    """Compose the struct of the connections of all worlds, for measures and for bounds, which read each once."""

    @wp.struct
    class Connected:
        ends: wp.array(dtype=wp.vec2i)  # two particles each, shape [connection_count]
        # Row w mod (number of rows) for world w, shape [rows, connection_count]:
        rest_length: wp.array2d(dtype=scalar)  # l0 [m]
        stiffness: wp.array2d(dtype=scalar)  # k [N/m]
        damping: wp.array2d(dtype=scalar)  # b in the units of the law, or times its steepest slope
        if not laws.linear:
            law: law_numbers(wp.float64)

    return Connected


@functools.cache
def spring_stress(scalar: type, form: Any):
    """Compose s(ε, numbers of the law), a spring's force divided by k l0, positive in tension."""
    Numbers = law_numbers(scalar)
    name, own = (form[0], None) if isinstance(form, tuple) else ("own", form)

    @wp.func
    def stress(strain: scalar, law: Numbers) -> scalar:
        result = strain
        if wp.static(own is not None):
            result = own(strain)
        if wp.static(name == "tension"):
            result = wp.max(strain, scalar(0.0))
        if wp.static(name == "limited"):
            result = strain + law[1] * wp.max(strain - law[0], scalar(0.0))
        if wp.static(name == "exponential"):
            result = (wp.exp(law[0] * strain) - scalar(1.0)) / law[0]
        if wp.static(name == "polynomial"):
            result = scalar(0.0)
            for k in range(MOST_COEFFICIENTS):
                result = (result + law[MOST_COEFFICIENTS - 1 - k]) * strain
        return result

    return stress


@functools.cache
def spring_energy(form: Any):
    """Compose ∫ s dε from 0 to ε, a spring's energy divided by k l0², in float64."""
    stress = spring_stress(wp.float64, form)
    Numbers = law_numbers(wp.float64)
    name = form[0] if isinstance(form, tuple) else "own"

    @fully_hashed
    def energy(strain: wp.float64, law: Numbers) -> wp.float64:
        half = wp.float64(0.5)
        total = wp.float64(0.0)
        if wp.static(name == "tension"):
            total = half * wp.max(strain, wp.float64(0.0)) * strain
        elif wp.static(name == "limited"):
            beyond = wp.max(strain - law[0], wp.float64(0.0))
            total = half * (strain * strain + law[1] * beyond * beyond)
        else:
            width = half * strain / wp.float64(wp.static(PANELS))
            for p in range(wp.static(PANELS)):
                middle = wp.float64(2 * p + 1) * width
                for k in range(3):
                    away = wp.float64(wp.static(POINTS[k])) * width
                    weight = wp.float64(wp.static(WEIGHTS[k])) * width
                    total += weight * stress(middle + away, law)
                    if wp.static(k > 0):
                        total += weight * stress(middle - away, law)
        return total

    return energy


@functools.cache
def steepest_slope(form: Any):
    """Compose the steepest slope of s at strains within AHEAD of a given one, at least 0; float64 differences."""
    stress = spring_stress(wp.float64, form)
    Numbers = law_numbers(wp.float64)
    apart = 2 * AHEAD / INTERVALS

    @wp.func
    def steepest(strain: wp.float64, law: Numbers) -> wp.float64:
        result = wp.float64(0.0)
        here = wp.max(strain - wp.float64(wp.static(AHEAD)), wp.float64(-0.99))
        before = stress(here, law)
        for _k in range(wp.static(INTERVALS)):
            here += wp.float64(wp.static(apart))
            after = stress(here, law)
            result = wp.max(result, (after - before) / wp.float64(wp.static(apart)))
            before = after
        return result

    return steepest
