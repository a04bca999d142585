"""Dampers: laws of force against a connection's rate of lengthening, as frozen dataclasses.

`System.damping` is the constant b of each connection, in the unit of the law. Laws without a linear term become
linear at a given speed, since a force that jumps, or grows without bound, is unstable at every step. So the force
has a known steepest slope, which determines the stable step.
"""

from dataclasses import dataclass
from typing import Any

from .. import checks
from .device_functions import check_law


@dataclass(frozen=True)
class Damper:
    """F = b l', the damper of the 2014 report (eq. 3): b in N s/m."""

    @property
    def steepest(self) -> float:
        """Largest derivative of the force with respect to the rate, divided by b; it limits the stable step."""
        return 1.0

    @property
    def law(self) -> Any:
        """Argument from which kernels are composed: the law's name and speed [m/s], or a `wp.func`."""
        return "linear", 0.0


@dataclass(frozen=True)
class QuadraticDamper(Damper):
    """F = b |l'| l', the resistance of a turbulent flow: b in N s²/m². Above `most_speed` it grows linearly.

    Parameters
    ----------
    most_speed
        Rate of lengthening up to which the law holds [m/s]; the stable step is inversely proportional to it.
    """

    most_speed: float = 10.0

    def __post_init__(self) -> None:
        checks.positive("most_speed", self.most_speed)

    @property
    def steepest(self) -> float:
        """Largest derivative of the force with respect to the rate, divided by b [m/s]."""
        return 2.0 * self.most_speed

    @property
    def law(self) -> tuple[str, float]:
        """Name of the law and its speed [m/s]."""
        return "quadratic", self.most_speed


@dataclass(frozen=True)
class CoulombDamper(Damper):
    """F = b sign(l'), dry friction: b in N. Below `sliding_speed` it is proportional to the rate.

    Parameters
    ----------
    sliding_speed
        Rate of lengthening above which friction is constant [m/s]. Sticking connections creep at up to this rate.
    """

    sliding_speed: float = 0.01

    def __post_init__(self) -> None:
        checks.positive("sliding_speed", self.sliding_speed)

    @property
    def steepest(self) -> float:
        """Largest derivative of the force with respect to the rate, divided by b [s/m]."""
        return 1.0 / self.sliding_speed

    @property
    def law(self) -> tuple[str, float]:
        """Name of the law and its speed [m/s]."""
        return "coulomb", self.sliding_speed


@dataclass(frozen=True)
class OwnDamper(Damper):
    """F by a function of your own, given the strain, the rate of lengthening and the constant b of a connection.

    Parameters
    ----------
    function
        A `wp.func` of the strain l/l0 − 1, the rate l' [m/s] and b that returns the force [N], positive in
        tension. It should have the sign of l', or be 0, so that it dissipates energy; gradients are wrong if it
        jumps. It is called with float32 and with float64 numbers, so its arguments must be annotated `Any`.
    steepest
        Upper bound of the force's derivative with respect to the rate, divided by b; it limits the stable step.
    """

    function: Any = None
    steepest: float = 1.0  # type: ignore[assignment]

    def __post_init__(self) -> None:
        check_law("function", self.function, ("strain", "rate", "damping"), "the force [N]")
        checks.positive("steepest", self.steepest)

    def __repr__(self) -> str:
        return f"OwnDamper({self.function.key}, {self.steepest:g})"

    @property
    def law(self) -> Any:
        """The user's function."""
        return self.function


@dataclass(frozen=True)
class UnknownDamper(Damper):
    """A law that a file cannot store, as it is a user's function. Such a system cannot be simulated."""

    @property
    def law(self) -> Any:
        """Raise ValueError, since the user's function is not known."""
        raise ValueError(
            "damper is UnknownDamper(): the system is from a file, which does not hold a law of one's own; "
            "give it again by replace(damper=...)"
        )


LINEAR = Damper()
"""The law of the 2014 report."""
