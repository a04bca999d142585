"""Laws of springs: s(ε) = force / (k l0) as a function of strain (see `msdwarp.bodies.springs`).

The form of a law is compiled. Its numbers are an argument, as for the laws of dampers (`dampers.py`).
"""

import functools
from typing import Any, NamedTuple

import warp as wp

from ..basis import fully_hashed
from .dampers import LINEAR, SPEED, SPRING_FORM, law_data, law_numbers

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
    """Forms of the dampers' laws: names in a tuple, or a `wp.func`; None without dampers."""
    spring: Any = None
    """Forms of the springs' laws: names in a tuple, or a `wp.func`; None for the linear law."""
    several: bool = False
    """Whether connections follow different laws: then each has the number of its law, a fourth constant."""

    @property
    def linear(self) -> bool:
        """Whether springs and dampers are linear, so that their laws have no numbers."""
        return self.spring is None and self.damper in (None, LINEAR) and not self.several

    @property
    def slackens(self) -> bool:
        """Whether some springs only pull, and their dampers exert no more than they."""
        return isinstance(self.spring, tuple) and "tension" in self.spring


def forms_of(laws: Any) -> Any:
    """Return the forms of some laws of `msdwarp.bodies`: names in a tuple, or the one that has no name."""
    names = {law[0] if isinstance(law, tuple) else "linear" for law in laws}
    return tuple(sorted(names)) if len(laws) > 1 or isinstance(laws[0], tuple) else laws[0]


def numbers_of(spring: Any, damper: Any, laws: Laws) -> tuple[float, ...]:
    """Return the numbers of the laws of springs and dampers, in the order of `law_numbers`."""
    (first, *own), (last, *speed) = (law if isinstance(law, tuple) else LINEAR for law in (spring, damper))
    places = (
        of.index(one) if isinstance(of, tuple) else 0 for one, of in ((first, laws.spring), (last, laws.damper))
    )
    return (*own, *(0.0,) * (SPEED - len(own)), *(speed or (0.0,)), *places)


@functools.cache
def connection_table(scalar: type, laws: Laws):
    """Compose (Connected, law_of): the connections of all worlds, for measures and bounds; the law of one."""
    Numbers = law_numbers(wp.float64)

    @wp.struct
    class Connected:
        ends: wp.array(dtype=wp.vec2i)  # two particles each, shape [connection_count]
        # Row w mod (number of rows) for world w, shape [rows, connection_count]:
        rest_length: wp.array2d(dtype=scalar)  # l0 [m]
        stiffness: wp.array2d(dtype=scalar)  # k [N/m]
        damping: wp.array2d(dtype=scalar)  # b in the units of the law, or times its steepest slope
        if not laws.linear:
            law: law_data(wp.float64, laws)
        if laws.several:
            number: wp.array(dtype=wp.uint8)  # of its law, shape [connection_count]

    @wp.func
    def law_of(connections: Connected, c: int) -> Numbers:
        if wp.static(laws.several):
            return connections.law[int(connections.number[c])]
        elif wp.static(not laws.linear):
            return connections.law
        else:
            return Numbers()

    return Connected, law_of


@functools.cache
def spring_stress(scalar: type, form: Any):
    """Compose s(ε, numbers of the law), a spring's force divided by k l0, positive in tension."""
    Numbers = law_numbers(scalar)
    names, own = (form, None) if isinstance(form, tuple) else (("own",), form)
    count, alone = len(names), len(names) == 1

    @fully_hashed
    def stress(strain: scalar, law: Numbers) -> scalar:
        result = strain
        for n in range(wp.static(count)):
            if wp.static(alone) or law[SPRING_FORM] == scalar(wp.static(n)):
                if wp.static(names[n] == "own"):
                    result = own(strain)
                if wp.static(names[n] == "tension"):
                    result = wp.max(strain, scalar(0.0))
                if wp.static(names[n] == "limited"):
                    result = strain + law[1] * wp.max(strain - law[0], scalar(0.0))
                if wp.static(names[n] == "exponential"):
                    result = (wp.exp(law[0] * strain) - scalar(1.0)) / law[0]
                if wp.static(names[n] == "polynomial"):
                    result = scalar(0.0)
                    for k in range(MOST_COEFFICIENTS):
                        result = (result + law[MOST_COEFFICIENTS - 1 - k]) * strain
        return result

    return stress


@functools.cache
def spring_energy(form: Any):
    """Compose ∫ s dε from 0 to ε, a spring's energy divided by k l0², in float64.

    Laws with a kink are integrated by hand, others by Gauss's rule, which is exact for polynomials.
    """
    stress = spring_stress(wp.float64, form)
    Numbers = law_numbers(wp.float64)
    names = form if isinstance(form, tuple) else ("own",)
    count, alone = len(names), len(names) == 1

    @fully_hashed
    def energy(strain: wp.float64, law: Numbers) -> wp.float64:
        half = wp.float64(0.5)
        total = wp.float64(0.0)
        if wp.static(names not in (("tension",), ("limited",))):
            width = half * strain / wp.float64(wp.static(PANELS))
            for p in range(wp.static(PANELS)):
                middle = wp.float64(2 * p + 1) * width
                for k in range(3):
                    away = wp.float64(wp.static(POINTS[k])) * width
                    weight = wp.float64(wp.static(WEIGHTS[k])) * width
                    total += weight * stress(middle + away, law)
                    if wp.static(k > 0):
                        total += weight * stress(middle - away, law)
        for n in range(wp.static(count)):
            if wp.static(alone) or law[SPRING_FORM] == wp.float64(wp.static(n)):
                if wp.static(names[n] == "tension"):
                    total = half * wp.max(strain, wp.float64(0.0)) * strain
                if wp.static(names[n] == "limited"):
                    beyond = wp.max(strain - law[0], wp.float64(0.0))
                    total = half * (strain * strain + law[1] * beyond * beyond)
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
