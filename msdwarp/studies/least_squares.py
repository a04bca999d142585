"""Sums of squares that a fit makes small: residuals, their derivatives, and damped Gauss-Newton steps.

Unknowns are the logarithms of parameters, counted from where they start: θ = ln(value / start).
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .measured import Channel, spread
from .parameters import Parameter
from .worlds import Worlds

DIFFERENCE = {"float64": 1e-6, "float32-compensated": 1e-4, "float32": 1e-3}
"""Differences of θ from which derivatives are taken, by precision.

Rounding makes about its own size over the difference of them: 1e-10, 1e-3 (in forces), 1e-3 and more.
"""
WIDE = 1e-2
"""The difference on the way, in every precision.

With contact what is measured depends on parameters in many small jumps, where a substep more or less is in
contact. Differences as wide as this see the trend.
"""
FLOOR = {"float64": 1e-7, "float32-compensated": 1e-4, "float32": 1e-3}
"""Change of what is measured, as a share of its variation, that a unit of θ makes at least if it can be seen."""
ABOVE_FLOOR = 10.0
"""What changes residuals by less than so many times the floor cannot be told from rounding."""
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
"""What a squared residual counts, and the derivative of that; as `scipy.optimize.least_squares` has them."""
GUESS = 0.5
"""On the way to the whole horizon values are held where they are by this standard deviation of θ.

So a stage in which a parameter can hardly be seen does not lead it astray.
"""
JAGGED, UNEVEN = 1e-3, 0.1
"""Over such a difference of θ, changes to both sides, or a change and what derivatives say of it, differ by more
than this share only where there are jumps."""
CLOUD = 24
"""Worlds of a cloud for each parameter."""
CLOUDS = (100.0, 30.0, 10.0, 5.0, 3.0)
"""Sizes of clouds, in standard deviations of θ."""
WIDEST = 0.1
"""No θ of a cloud is further from its centre."""
CLOSE = 1e-2
"""Starts that have come so close in θ count as one."""
WORSE = 10.0
"""Starts whose sum of squares is so many times the least are given up."""


class Linear(NamedTuple):
    """Residuals at some θ, and how they change with it."""

    residuals: NDArray[np.float64]
    """Shape [rows]."""
    jacobian: NDArray[np.float64]
    """Shape [rows, parameters]."""


@dataclass
class Problem:
    """What is measured against what is simulated."""

    worlds: Worlds
    channels: list[Channel]
    parameters: list[Parameter]
    precision: str
    loss: str

    def __post_init__(self) -> None:
        """Find the bounds of θ."""
        limits = np.array([(one.low / one.start, one.high / one.start) for one in self.parameters])
        self.low, self.high = np.log(limits).T

    @property
    def count(self) -> int:
        """How many parameters there are."""
        return len(self.parameters)

    def values(self, theta: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return values for θ of shape [..., parameters]."""
        return np.exp(theta) * [one.start for one in self.parameters]

    def floor(self, end: float) -> float:
        """Return what a unit of θ changes in a residual at least, if it can be seen at all."""
        sums = [(spread(one) / one.noise) ** 2 * one.until(end).sum() for one in self.channels]
        rows = sum(one.until(end).sum() for one in self.channels)
        return FLOOR[self.precision] * float(np.sqrt(sum(sums) / rows))

    def residuals(self, theta: NDArray[np.float64], end: float) -> NDArray[np.float64]:
        """Return (simulated − measured) / noise up to a time [s], shape [worlds, rows], for θ of each world."""
        told = self.worlds.predict(self.values(theta), end)
        parts = []
        for one, simulated in zip(self.channels, told, strict=True):
            wanted = one.until(end)
            parts.append((simulated - one.values)[:, wanted] / one.noise)
        return np.concatenate(parts, axis=1)

    def linear(self, theta: NDArray[np.float64], end: float, size: float) -> list[Linear]:
        """Return residuals and derivatives for θ of shape [starts, parameters], by one run of all worlds.

        Derivatives are differences over `size` in each θ, away from a bound that is near.
        """
        p = self.count
        steps = np.where(theta + size > self.high, -size, size)
        moved = theta[:, None, :] + np.concatenate([np.zeros((len(theta), 1, p)), steps[:, None] * np.eye(p)], 1)
        residuals = self.residuals(moved.reshape(-1, p), end).reshape(len(theta), 1 + p, -1)
        slopes = (residuals[:, 1:] - residuals[:, :1]) / steps[..., None]
        return [Linear(one[0], slope.T) for one, slope in zip(residuals, slopes, strict=True)]

    def cost(self, residuals: NDArray[np.float64]) -> float:
        """Return the sum of what squared residuals count."""
        return float(LOSSES[self.loss][0](residuals**2).sum())

    def approach(self, theta: NDArray[np.float64], end: float, most: int) -> NDArray[np.float64]:
        """Return better θ up to a time [s], from several starts at once, by Levenberg's and Marquardt's steps.

        Each step is one run of (parameters + 1) worlds for each start.

        Parameters
        ----------
        theta
            Shape [starts, parameters].
        end
            Up to when [s].
        most
            Steps at most.
        """
        theta, first = theta.copy(), theta.copy()
        linear = self.linear(theta, end, WIDE)
        floor = self.floor(end)
        # How firmly each start is held: by the guess where it fits as badly as it does, and by the floor at least.
        rows = len(linear[0].residuals)
        hold = [max(np.sqrt(self.cost(one.residuals) / rows) / GUESS, floor * np.sqrt(rows)) for one in linear]
        damped = np.full(len(theta), 1e-3)
        for _ in range(most):
            trial = theta.copy()
            for s, one in enumerate(linear):
                weight = LOSSES[self.loss][1](one.residuals**2)
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
        return theta[_worth_keeping(theta, costs)]

    def finish(self, theta: NDArray[np.float64], end: float, tolerance: float) -> tuple[NDArray, bool]:
        """Return the best θ up to a time [s], and whether steps came to an end."""
        from scipy.optimize import least_squares

        floor, start, p = self.floor(end), theta.copy(), self.count
        kept: dict[bytes, Linear] = {}

        def residuals(at: NDArray[np.float64]) -> NDArray[np.float64]:
            if self.worlds.on_gpu:  # where more worlds take no longer: derivatives come with it
                return linear(at).residuals
            return self.residuals(at[None], end)[0]

        def linear(at: NDArray[np.float64]) -> Linear:
            if at.tobytes() not in kept:
                kept.clear()
                kept[at.tobytes()] = self.linear(at[None], end, DIFFERENCE[self.precision])[0]
            return kept[at.tobytes()]

        rows = int(sum(one.until(end).sum() for one in self.channels))
        hold = floor * np.sqrt(rows)  # what cannot be seen stays where it is

        slopes: Any = lambda at: np.concatenate([linear(at).jacobian, hold * np.eye(p)])  # noqa: E731
        found = least_squares(
            lambda at: np.concatenate([residuals(at), hold * (at - start)]),
            np.clip(start, self.low, self.high),
            jac=slopes,
            bounds=(self.low, self.high),
            loss=self.loss,
            xtol=tolerance,
            ftol=1e-12,
            gtol=1e-15,
            max_nfev=60,
        )
        return found.x, found.status > 0

    def of_step(
        self, theta: NDArray[np.float64], end: float, linear: Linear, order: int
    ) -> tuple[NDArray, NDArray, NDArray]:
        """Return what endlessly short steps would change: θ, its standard deviation beside that, and residuals.

        By Richardson's extrapolation from half the steps, with a method of some order.
        """
        stable = self.worlds.substeps
        self.worlds.refine(2)
        change = self.residuals(theta[None], end)[0] - linear.residuals
        self.worlds.refine(stable / self.worlds.substeps)
        change *= 2**order / (2**order - 1)
        hold = self.floor(end) * np.sqrt(len(change))  # what cannot be seen stays where it is
        weight = LOSSES[self.loss][1](linear.residuals**2)[:, None]
        inverse = np.linalg.inv(linear.jacobian.T @ (weight * linear.jacobian) + hold**2 * np.eye(self.count))
        variance = self.cost(linear.residuals) / max(len(change) - self.count, 1)
        moved = -inverse @ (linear.jacobian.T @ (weight[:, 0] * change))
        return moved, np.sqrt(variance * np.diag(inverse)), change

    def is_jagged(self, theta: NDArray[np.float64], end: float, linear: Linear) -> bool:
        """Tell whether what is simulated jumps as θ changes, as it does with contact.

        What is smooth changes to one side by the opposite of its change to the other side, and by what the
        derivatives at θ say, but for a share of the order of the difference. Derivatives are differences over
        less. They miss most jumps. Where they meet one they are far too large, and values would seem certain.
        """
        steps = JAGGED * np.eye(self.count)
        residuals = self.residuals(np.concatenate([theta[None], theta + steps, theta - steps]), end)
        above, below = residuals[1 : self.count + 1], residuals[self.count + 1 :]
        uneven = np.linalg.norm(above + below - 2 * residuals[0], axis=1)
        changed = np.linalg.norm(above - below, axis=1)
        unforeseen = np.linalg.norm(above - below - 2 * JAGGED * linear.jacobian.T, axis=1)
        rounding = 2 * JAGGED * ABOVE_FLOOR * self.floor(end) * np.sqrt(residuals.shape[1])
        return bool(((np.maximum(uneven, unforeseen) > UNEVEN * changed) & (changed > rounding)).any())

    def spread(self, linear: Linear) -> NDArray[np.float64]:
        """Return a matrix L with which θ is as uncertain as L times independent normal numbers are."""
        weight = LOSSES[self.loss][1](linear.residuals**2)
        _, sizes, directions = np.linalg.svd(np.sqrt(weight)[:, None] * linear.jacobian, full_matrices=False)
        s = np.sqrt(self.cost(linear.residuals) / len(weight))
        with np.errstate(divide="ignore"):
            return directions.T * np.minimum(s / sizes, WIDE)

    def smooth(self, theta: NDArray[np.float64], end: float, seed: int) -> tuple[NDArray, NDArray, NDArray]:
        """Return the best θ found in clouds of worlds about it, each smaller than the last.

        And the trend there, as a Jacobian, and the covariance of θ that jumps about the trend make.

        A plane laid through the residuals of a cloud tells where the sum of squares is least if jumps are
        smoothed out. The world there and the best of the cloud contend for the centre of the next one.
        """
        p, random = self.count, np.random.default_rng(seed)
        linear = self.linear(theta[None], end, WIDE)[0]
        trial, best, jumps = theta, theta, np.zeros((p, p))
        for factor in CLOUDS:
            shape = self.spread(linear)
            cloud = factor * random.normal(size=(CLOUD * p, p)) @ shape.T
            cloud = best + np.clip(cloud, -WIDEST, WIDEST)
            at = np.clip(np.concatenate([[best, trial], cloud]), self.low, self.high)
            residuals = self.residuals(at, end)
            costs = np.array([self.cost(one) for one in residuals])
            centre = at.mean(axis=0)
            plane, *_ = np.linalg.lstsq(np.column_stack([np.ones(len(at)), at - centre]), residuals, rcond=None)
            weight = LOSSES[self.loss][1](plane[0] ** 2)
            step, *_ = np.linalg.lstsq(
                np.sqrt(weight)[:, None] * plane[1:].T, -np.sqrt(weight) * plane[0], rcond=None
            )
            best = at[np.argmin(costs)]
            trial = np.clip(centre + np.clip(step, -WIDEST, WIDEST), self.low, self.high)
            slopes: NDArray[np.float64] = np.asarray(plane[1:].T, dtype=np.float64)
            linear = Linear(residuals[np.argmin(costs)], slopes)
            off = residuals - plane[0] - (at - centre) @ plane[1:]
            moves = off @ np.linalg.pinv(plane[1:])  # what a jump is taken for
            jumps = moves.T @ moves / len(moves)
        return best, linear.jacobian, jumps


def _worth_keeping(theta: NDArray[np.float64], costs: NDArray[np.float64]) -> list[int]:
    """Return the numbers of the starts to go on with, the best first: no two alike, none much worse."""
    kept: list[int] = []
    for s in np.argsort(costs, kind="stable"):
        alike = any(np.abs(theta[s] - theta[k]).max() < CLOSE for k in kept)
        if not alike and costs[s] <= WORSE * costs.min():
            kept.append(int(s))
    return kept
