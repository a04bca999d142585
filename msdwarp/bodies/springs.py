"""Springs: laws of force against a connection's strain, as frozen dataclasses.

`System.stiffness` is the constant k of each connection. The force is F = k l0 s(ε), positive in tension, with the
strain ε = l/l0 − 1 and the dimensionless s given by the law. s(ε) = ε is the linear spring k (l − l0). The
steepest slope of s near the present strain limits the stable step.
"""

from dataclasses import dataclass
from typing import Any

from .. import checks
from .device_functions import check_law

SpringLaw = tuple[str, *tuple[float, ...]]
"""Name of a law, then its parameters."""


@dataclass(frozen=True)
class Spring:
    """s = ε, the spring of the 2014 report (eq. 3)."""

    @property
    def law(self) -> Any:
        """Argument from which kernels are composed: name and parameters, a `wp.func`, or None for s = ε."""
        return None


@dataclass(frozen=True)
class TensionOnlySpring(Spring):
    """s = max(ε, 0): a rope, cable or net, which is slack if it is shorter than its rest length.

    The damper's force is at most that of the spring. So the force of a rope that becomes taut or slack does not
    jump, as gradients need it, and a rope never pushes. The Modelica Standard Library limits the damper of its
    `ElastoGap` likewise.
    """

    @property
    def law(self) -> SpringLaw:
        """Name of the law."""
        return ("tension",)


@dataclass(frozen=True)
class LimitedSpring(Spring):
    """s = ε up to a strain, and `factor` times as steep beyond it: cloth, whose threads straighten.

    Parameters
    ----------
    strain
        Tensile strain up to which the spring is soft.
    factor
        Ratio of the slope beyond it to the slope below; the stable step is shorter by its square root near there.
    """

    strain: float = 0.1
    factor: float = 20.0

    def __post_init__(self) -> None:
        checks.positive("strain", self.strain)
        checks.positive("factor", self.factor)

    @property
    def law(self) -> SpringLaw:
        """Name of the law, its strain, and by how much the slope increases there."""
        return "limited", self.strain, self.factor - 1.0


@dataclass(frozen=True)
class ExponentialSpring(Spring):
    """s = (exp(a ε) − 1)/a: soft tissue, which stiffens as it is stretched (Fung, Biomechanics, 1993, 7.5).

    Parameters
    ----------
    exponent
        a; the slope grows by a factor e for each 1/a of strain.
    """

    exponent: float = 10.0

    def __post_init__(self) -> None:
        checks.between("exponent", self.exponent, 1e-3, 100.0)

    @property
    def law(self) -> SpringLaw:
        """Name of the law and its parameter."""
        return "exponential", self.exponent


@dataclass(frozen=True)
class PolynomialSpring(Spring):
    """s = c₁ ε + c₂ ε² + …, at most five terms.

    Parameters
    ----------
    coefficients
        c₁, c₂, …
    """

    coefficients: tuple[float, ...] = (1.0,)

    def __post_init__(self) -> None:
        given = checks.finite("coefficients", self.coefficients)
        if given.ndim != 1 or not 1 <= len(given) <= 5:
            raise ValueError(f"coefficients is {self.coefficients!r}; it must be one to five numbers")
        object.__setattr__(self, "coefficients", tuple(map(float, given)))

    @property
    def law(self) -> SpringLaw:
        """Name of the law and its parameters."""
        return "polynomial", *self.coefficients


@dataclass(frozen=True)
class OwnSpring(Spring):
    """s by a function of your own.

    Parameters
    ----------
    function
        A `wp.func` of the strain that returns s. It is called with float32 and with float64 numbers, so its
        argument must be annotated `Any`, and constants in it converted: `type(strain)(0.1)`.
    """

    function: Any = None

    def __post_init__(self) -> None:
        check_law("function", self.function, ("strain",), "the force over k l0")

    def __repr__(self) -> str:
        return f"OwnSpring({self.function.key})"

    @property
    def law(self) -> Any:
        """The user's function."""
        return self.function


@dataclass(frozen=True)
class UnknownSpring(Spring):
    """A law that a file cannot store, as it is a user's function. Such a system cannot be simulated."""

    @property
    def law(self) -> Any:
        """Raise ValueError, since the user's function is not known."""
        raise ValueError(
            "spring is UnknownSpring(): the system is from a file, which does not hold a law of one's own; "
            "give it again by replace(spring=...)"
        )


LINEAR_SPRING = Spring()
"""The law of the 2014 report."""
