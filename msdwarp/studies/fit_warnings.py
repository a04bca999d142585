"""Warnings about a fit: parameters that cannot be determined, and residuals that differ from noise."""

import math

import numpy as np
from numpy.typing import NDArray

from ..integrators import StepChoice
from .least_squares import CLOSE, Problem
from .measured import Channel

SURE = 2.33
"""A normal variable exceeds this with a probability of 1 %, the rate of warnings about perfect noise."""
ALIKE = 0.3
"""Tolerated correlation r of residuals at neighbouring times: standard deviations are then too small by at most a
factor sqrt((1 + r) / (1 - r)) = 1.4."""
OTHER = 1.5
"""Tolerated ratio of residuals to given noise, or of noise to residuals: noise is seldom known better."""
BY_STEP = 2.0
"""Residuals below this multiple of the time step's error are attributed to the time step."""
OUTRIGHT = 300
"""If the scene oscillates more often than this in a frame, measured times are probably in another unit."""


def noise_warnings(
    channel: Channel, left: NDArray[np.float64], parameters: int, step: float, *, robust: bool
) -> list[str]:
    """Return messages about how residuals, shape [rows, width], differ from independent noise of given size.

    `parameters` is the number of fitted parameters, and `step` the root mean square of the time step's error, in
    the channel's unit. If `robust`, the size of residuals is their median, because some points may be wrong.
    """
    seen = left[np.isfinite(left)]
    freedom = max(len(seen) - parameters, 1)
    size = float(np.sqrt((seen**2).sum() / freedom))
    if not len(seen) or size <= BY_STEP * step:
        return []
    messages = []
    if channel.noise_given:
        ratio = (float(np.median(np.abs(seen))) / 0.6745 if robust else size) / channel.noise
        # χ² of n degrees of freedom is n, with a standard deviation of sqrt(2 n).
        by_chance = abs(ratio**2 - 1) < SURE * np.sqrt(2 / freedom)
        if not by_chance and not 1 / OTHER < ratio < OTHER:
            noise = f"the noise told, {channel.noise:.3g} {channel.unit}".rstrip()
            differs = ": the scene differs from what was measured" if ratio > 1 else ""
            messages.append(f"residuals of {channel.name} are {ratio:.2g} times {noise}{differs}")
    correlation, independent = _in_time(channel, left)
    if correlation > max(ALIKE, SURE / np.sqrt(independent)):
        messages.append(
            f"residuals of {channel.name} are alike at neighbouring times (correlation {correlation:.2f}): they "
            "are no noise. The scene differs from what was measured, perhaps in its start, in when it starts, or "
            "in a unit; values may be off by far more than their standard deviations"
        )
    return messages


def _in_time(channel: Channel, left: NDArray[np.float64]) -> tuple[float, float]:
    """Return the correlation of residuals at neighbouring times, and the effective number of residuals.

    If residuals are independent in time, the correlation is normal about 0 with the variance 1 / (n T), with T
    instants and n = (tr C)² / tr C² independent residuals at each, where C is the covariance of the measurements
    at one instant: n is the number of points if their noise is independent, and 1 if a camera shakes.
    """
    times, row = np.unique(channel.time, return_inverse=True)
    table = np.zeros((len(times), channel.entries.max() + 1, left.shape[1]))
    table[row, channel.entries] = np.nan_to_num(left)
    table = table.reshape(len(times), -1)
    squares = float((table**2).sum())
    crossed = table @ table.T if len(times) < table.shape[1] else table.T @ table
    return float((table[:-1] * table[1:]).sum()) / squares, squares**2 / float((crossed**2).sum()) * len(times)


def time_warnings(start: StepChoice) -> list[str]:
    """Return warnings about measured times, before anything is simulated; `start` is the choice at the start."""
    swings = math.sqrt(start.rates.stiffness) / (2 * math.pi * start.fps)
    if swings <= OUTRIGHT:
        return []
    return [
        f"measured is compared in frames {1 / start.fps:.3g} s apart, in which the stiffest part of the scene "
        f"oscillates about {swings:.0f} times at the starting values; times must be in seconds"
    ]


def value_warnings(problem: Problem, theta: NDArray[np.float64], unseen: list[str], converged: bool) -> list[str]:
    """Return warnings about fitted values: not determined (`unseen`), at a bound, diverging or not converged."""
    messages = []
    if len(unseen) == 1:
        messages.append(f"{unseen[0]} is not determined by the measurements: it stays near its start")
    elif unseen:
        messages.append(f"{' and '.join(unseen)} cannot be told apart, or seen, in what was measured")
    for one, at, low, high in zip(problem.parameters, theta, problem.low, problem.high, strict=True):
        if one.name not in unseen and min(at - low, high - at) < CLOSE * 1e-2:
            messages.append(f"{one.name} ends at its bound, {one.start * np.exp(at):.4g}: it may lie beyond")
    if problem.worlds.diverged:
        messages.append("the scene diverges with the values found")
    if not converged:
        messages.append("the search has not come to an end")
    return messages
