"""The least-squares problem of a fit: residuals, their derivatives, and damped Gauss-Newton steps.

The unknowns are logarithms of parameters divided by starting values: θ = ln(value / start).
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .fit_predictions import Worlds
from .measured import spread

DIFFERENCE = {"float64": 1e-6, "float32-compensated": 1e-4, "float32": 1e-3}
"""Differences of θ for derivatives, by precision; rounding errors are 1e-10, 1e-3 (of forces), 1e-3 and more."""
WIDE = 1e-2
"""Difference of θ before the last steps: with contact residuals jump slightly, and this averages the jumps."""
FLOOR = {"float64": 1e-7, "float32-compensated": 1e-4, "float32": 1e-3}
"""Smallest resolvable change per unit of θ, as a fraction of the variation of the measurements."""
ABOVE_FLOOR = 10.0
"""Changes of residuals below this multiple of the floor are indistinguishable from rounding."""
Loss = Callable[[NDArray], NDArray]
LOSSES: dict[str, tuple[Loss, Loss]] = {
    "linear": (lambda z: z, np.ones_like),
    "soft_l1": (lambda z: 2 * (np.sqrt(1 + z) - 1), lambda z: 1 / np.sqrt(1 + z)),
    "huber": (
        lambda z: np.where(z <= 1, z, 2 * np.sqrt(np.maximum(z, 1)) - 1),
        lambda z: 1 / np.sqrt(np.maximum(z, 1)),
    ),
    "cauchy": (np.log1p, lambda z: 1 / (1 + z)),
}
"""The cost of a squared residual and its derivative, as in `scipy.optimize.least_squares`."""
GUESS = 0.5
"""Standard deviation of a prior that keeps θ near the start until the last steps."""
JAGGED, UNEVEN = 1e-3, 0.1
"""Difference of θ in the test for jumps; tolerated fraction by which changes to both sides, or changes and
derivatives, may differ."""
CLOUD = 24
"""Number of worlds in a cloud, for each parameter."""
CLOUDS = (100.0, 30.0, 10.0, 5.0, 3.0)
"""Sizes of clouds, in standard deviations of θ."""
WIDEST = 0.1
"""Largest difference of θ between a world and the centre of its cloud."""
CLOSE = 1e-2
"""Starts with a smaller difference in θ count as one."""
WORSE = 10.0
"""Starts with a sum of squares above this multiple of the least one are dropped."""


class Linear(NamedTuple):
    """Residuals at some θ, and their derivatives."""

    residuals: NDArray[np.float64]
    """Shape [rows]."""
    jacobian: NDArray[np.float64]
    """Shape [rows, parameters]."""


@dataclass
class Problem:
    """The least-squares problem: simulated values minus measurements."""

    worlds: Worlds
    precision: str
    loss: str

    def __post_init__(self) -> None:
        self.channels, self.parameters = self.worlds.channels, self.worlds.parameters
        self.count = len(self.parameters)
        limits = np.array([(one.low / one.start, one.high / one.start) for one in self.parameters])
        self.low, self.high = np.log(limits).T

    def values(self, theta: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return parameter values for θ of shape [..., parameters]."""
        return np.exp(theta) * [one.start for one in self.parameters]

    def floor(self, end: float) -> float:
        """Return the smallest resolvable change of a residual per unit of θ."""
        rows = [one.until(end).sum() for one in self.channels]
        squares = [(spread(one) / one.noise) ** 2 for one in self.channels]
        return FLOOR[self.precision] * float(np.sqrt(np.average(squares, weights=rows)))

    def weights(self, residuals: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the weight of each residual under the robust loss, for reweighted least squares."""
        return LOSSES[self.loss][1](residuals**2)

    def cost(self, residuals: NDArray[np.float64]) -> float:
        """Return the sum of the robust loss over all residuals."""
        return float(LOSSES[self.loss][0](residuals**2).sum())

    def residuals(self, theta: NDArray[np.float64], end: float) -> NDArray[np.float64]:
        """Return (simulated − measured) / noise until `end` [s], shape [worlds, rows], for θ of each world."""
        predicted = self.worlds.predict(self.values(theta), end)
        parts = [
            (simulated - one.values)[:, one.until(end)] / one.noise
            for one, simulated in zip(self.channels, predicted, strict=True)
        ]
        return np.concatenate(parts, axis=1)

    def linear(self, theta: NDArray[np.float64], end: float, size: float) -> list[Linear]:
        """Return residuals and derivatives for θ of shape [starts, parameters], from one run of all worlds.

        Derivatives are one-sided differences of `size` in each θ, in the direction away from a near bound.
        """
        p = self.count
        steps = np.where(theta + size > self.high, -size, size)
        moved = theta[:, None, :] + np.concatenate([np.zeros((len(theta), 1, p)), steps[:, None] * np.eye(p)], 1)
        residuals = self.residuals(moved.reshape(-1, p), end).reshape(len(theta), 1 + p, -1)
        slopes = (residuals[:, 1:] - residuals[:, :1]) / steps[..., None]
        return [Linear(one[0], slope.T) for one, slope in zip(residuals, slopes, strict=True)]

    def approach(self, theta: NDArray[np.float64], end: float, most: int) -> NDArray[np.float64]:
        """Return improved θ for the measurements until `end` [s], after at most `most` Levenberg-Marquardt steps.

        All starts, shape [starts, parameters], take steps in one run of (parameters + 1) worlds per start; SciPy
        would need a run per start.
        """
        theta, first = theta.copy(), theta.copy()
        linear = self.linear(theta, end, WIDE)
        # A prior attracts each start to its first θ, more strongly if it fits worse, and at least by the floor.
        rows, floor = len(linear[0].residuals), self.hold(end)
        hold = [max(np.sqrt(self.cost(one.residuals) / rows) / GUESS, floor) for one in linear]
        damped = np.full(len(theta), 1e-3)
        for _ in range(most):
            trial = theta.copy()
            for s, one in enumerate(linear):
                weight = self.weights(one.residuals)
                normal = one.jacobian.T @ (weight[:, None] * one.jacobian) + hold[s] ** 2 * np.eye(self.count)
                down = -one.jacobian.T @ (weight * one.residuals) - hold[s] ** 2 * (theta[s] - first[s])
                step = np.linalg.solve(normal + damped[s] * np.diag(np.diag(normal)), down)
                trial[s] = np.clip(theta[s] + np.clip(step, -1, 1), self.low, self.high)
            tried = self.linear(trial, end, WIDE)
            for s, (one, other) in enumerate(zip(linear, tried, strict=True)):
                held = [hold[s] ** 2 * ((each[s] - first[s]) ** 2).sum() for each in (theta, trial)]
                better = self.cost(other.residuals) + held[1] < self.cost(one.residuals) + held[0]
                damped[s] = max(1e-6, damped[s] / 10) if better else damped[s] * 10
                if better:
                    theta[s], linear[s] = trial[s], other
            if np.abs(trial - theta).max() == 0 and np.abs(theta - first).max() < CLOSE:
                break
        costs = np.array([self.cost(one.residuals) for one in linear])
        kept: list[int] = []
        for s in np.argsort(costs, kind="stable"):  # best first; equal and much worse starts are dropped
            alike = any(np.abs(theta[s] - theta[k]).max() < CLOSE for k in kept)
            if not alike and costs[s] <= WORSE * costs.min():
                kept.append(s)
        return theta[kept]

    def finish(self, theta: NDArray[np.float64], end: float, tolerance: float) -> tuple[NDArray, bool]:
        """Return (best θ for the measurements until `end` [s], whether the search converged)."""
        from scipy.optimize import least_squares

        hold = self.hold(end)
        latest: dict[bytes, Linear] = {}

        def linear(at: NDArray[np.float64]) -> Linear:
            if at.tobytes() not in latest:
                latest.clear()
                latest[at.tobytes()] = self.linear(at[None], end, DIFFERENCE[self.precision])[0]
            return latest[at.tobytes()]

        def residuals(at: NDArray[np.float64]) -> NDArray[np.float64]:
            # On a GPU more worlds take no longer, so derivatives are computed with the residuals.
            own = linear(at).residuals if self.worlds.on_gpu else self.residuals(at[None], end)[0]
            return np.concatenate([own, hold * (at - theta)])

        def jacobian(at: NDArray[np.float64]) -> NDArray[np.float64]:
            return np.concatenate([linear(at).jacobian, hold * np.eye(self.count)])

        found = least_squares(
            residuals,
            np.clip(theta, self.low, self.high),
            jac=jacobian,  # pyright: ignore[reportArgumentType]
            bounds=(self.low, self.high),
            loss=self.loss,
            xtol=tolerance,
            ftol=1e-12,
            gtol=1e-15,
            max_nfev=60,
        )
        return found.x, found.status > 0

    def hold(self, end: float) -> float:
        """Return the derivative by θ of an additional residual, which keeps undetermined parameters in place."""
        return self.floor(end) * np.sqrt(int(sum(one.until(end).sum() for one in self.channels)))

    def of_step(
        self, theta: NDArray[np.float64], end: float, linear: Linear, order: int
    ) -> tuple[NDArray, NDArray, NDArray]:
        """Return (change of θ for infinitely short steps, standard deviation of θ, change of residuals).

        Computed by Richardson's extrapolation from half the step, for a method of this order.
        """
        stable = self.worlds.substeps
        self.worlds.refine(2)
        change = self.residuals(theta[None], end)[0] - linear.residuals
        self.worlds.refine(stable / self.worlds.substeps)
        change *= 2**order / (2**order - 1)
        weight = self.weights(linear.residuals)[:, None]
        normal = linear.jacobian.T @ (weight * linear.jacobian) + self.hold(end) ** 2 * np.eye(self.count)
        inverse = np.linalg.inv(normal)
        variance = self.cost(linear.residuals) / max(len(change) - self.count, 1)
        moved = -inverse @ (linear.jacobian.T @ (weight[:, 0] * change))
        return moved, np.sqrt(variance * np.diag(inverse)), change

    def is_jagged(self, theta: NDArray[np.float64], end: float, linear: Linear) -> bool:
        """Return whether residuals jump as θ changes, as contact may cause.

        For smooth residuals the changes for ±δθ are opposite and agree with the derivatives at θ, up to an error
        of the order of δθ. Derivatives are computed with smaller differences and miss most jumps. Derivatives
        across a jump are far too large, which would make values appear too certain.
        """
        steps = JAGGED * np.eye(self.count)
        residuals = self.residuals(np.concatenate([theta[None], theta + steps, theta - steps]), end)
        above, below = residuals[1 : self.count + 1], residuals[self.count + 1 :]
        uneven = np.linalg.norm(above + below - 2 * residuals[0], axis=1)
        changed = np.linalg.norm(above - below, axis=1)
        unforeseen = np.linalg.norm(above - below - 2 * JAGGED * linear.jacobian.T, axis=1)
        rounding = 2 * JAGGED * ABOVE_FLOOR * self.floor(end) * np.sqrt(residuals.shape[1])
        return bool(((np.maximum(uneven, unforeseen) > UNEVEN * changed) & (changed > rounding)).any())

    def singular(self, linear: Linear) -> tuple[NDArray, NDArray]:
        """Return singular values and right singular vectors of the weighted Jacobian."""
        weighted = np.sqrt(self.weights(linear.residuals))[:, None] * linear.jacobian
        return np.linalg.svd(weighted, full_matrices=False)[1:]

    def smooth(self, theta: NDArray[np.float64], end: float, seed: int) -> tuple[NDArray, NDArray, NDArray]:
        """Return (best θ by shrinking clouds of worlds, Jacobian of the trend there, covariance of θ by jumps).

        A plane is fitted to the residuals of a cloud of worlds around θ; jumps disturb its minimum little. The
        next cloud includes this minimum, and its centre is the best θ so far. Jumps make residuals deviate from
        the plane; the covariance is the resulting uncertainty of θ.
        """
        p, random = self.count, np.random.default_rng(seed)
        linear = self.linear(theta[None], end, WIDE)[0]
        trial, best, jumps = theta, theta, np.zeros((p, p))
        for factor in CLOUDS:
            sizes, directions = self.singular(linear)
            s = np.sqrt(self.cost(linear.residuals) / len(linear.residuals))
            with np.errstate(divide="ignore"):
                shape = directions.T * np.minimum(s / sizes, WIDE)
            cloud = factor * random.normal(size=(CLOUD * p, p)) @ shape.T
            cloud = best + np.clip(cloud, -WIDEST, WIDEST)
            at: NDArray[np.float64] = np.clip(np.concatenate([[best, trial], cloud]), self.low, self.high)
            residuals = self.residuals(at, end)
            least = np.argmin([self.cost(one) for one in residuals])
            centre = at.mean(axis=0)
            columns = np.column_stack([np.ones(len(at)), at - centre])
            plane: NDArray = np.linalg.lstsq(columns, residuals, rcond=None)[0]
            root = np.sqrt(self.weights(plane[0]))
            step: NDArray = np.linalg.lstsq(root[:, None] * plane[1:].T, -root * plane[0], rcond=None)[0]
            best, linear = at[least], Linear(residuals[least], np.asarray(plane[1:].T, dtype=np.float64))
            trial = np.clip(centre + np.clip(step, -WIDEST, WIDEST), self.low, self.high)
            off = residuals - plane[0] - (at - centre) @ plane[1:]
            moves = off @ np.linalg.pinv(plane[1:])  # changes of θ with the same effect as the jumps
            jumps = moves.T @ moves / len(moves)
        return best, linear.jacobian, jumps
