"""What is doubtful about a fit: what cannot be seen, and residuals that do not look like noise."""

import warnings
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .. import checks
from .least_squares import CLOSE, Problem
from .measured import Channel

SURE = 2.33
"""A normal number is above that in one case of a hundred: so often is noise doubted that is as assumed."""
ALIKE = 0.3
"""Residuals at neighbouring times that go together less than so: standard deviations are at most 1.4 times too
small, sqrt((1 + r) / (1 - r)), and nobody is told."""
OTHER = 1.5
"""Residuals so many times as large as the noise told, or as small, are told: noise is seldom known better."""
BY_STEP = 2.0
"""Residuals below so many times what a shorter time step would change are not looked at: they are its error."""
OUTRIGHT = 1000
"""Stable substeps of a frame above which the times measured are probably in another unit."""


def doubts_of_noise(
    channel: Channel, left: NDArray[np.float64], parameters: int, step: float, *, robust: bool
) -> list[str]:
    """Return how the residuals of a kind of measurement differ from independent noise of the size told.

    Parameters
    ----------
    channel
        What was measured, with the noise told.
    left
        Simulated − measured, shape [rows, width]; NaN where nothing was measured.
    parameters
        Number of parameters fitted.
    step
        What is left by the time step alone, and below which nothing is noise: root mean square, in the same unit.
    robust
        Whether the fit bears points that are wrong: the size of the residuals is told by their median then.

    Notes
    -----
    The correlation of residuals at neighbouring times, all points together, is normal about 0 with the variance
    1 / (n T) if they are independent in time: T instants, and n numbers at each that vary independently. That are
    as many as there are points if each has noise of its own, and one if all go together, as where a camera shakes:
    n = (tr C)² / tr C² with the covariance C of what is measured at one instant.
    """
    seen = left[np.isfinite(left)]
    size = float(np.sqrt((seen**2).sum() / max(len(seen) - parameters, 1)))
    if not len(seen) or size <= BY_STEP * step:
        return []
    doubts = []
    if channel.told:
        ratio = (float(np.median(np.abs(seen))) / 0.6745 if robust else size) / channel.noise
        # χ² of n degrees of freedom is n, with a standard deviation of sqrt(2 n).
        by_chance = abs(ratio**2 - 1) < SURE * np.sqrt(2 / max(len(seen) - parameters, 1))
        if not by_chance and not 1 / OTHER < ratio < OTHER:
            doubts.append(
                f"residuals of {channel.name} are {ratio:.2g} times the noise told, {channel.noise:.3g} "
                f"{channel.unit}".rstrip()
                + (": the scene differs from what was measured" if ratio > 1 else "")
            )
    correlation, independent = _in_time(channel, left)
    if correlation > max(ALIKE, SURE / np.sqrt(independent)):
        doubts.append(
            f"residuals of {channel.name} are alike at neighbouring times (correlation {correlation:.2f}): they "
            "are no noise. The scene differs from what was measured, perhaps in its start, in when it starts, or "
            "in a unit; values may be off by far more than their standard deviations"
        )
    return doubts


def _in_time(channel: Channel, left: NDArray[np.float64]) -> tuple[float, float]:
    """Return the correlation of residuals at neighbouring times, and how many of them are independent."""
    times, row = np.unique(channel.time, return_inverse=True)
    entry = np.zeros(len(row), dtype=int) if channel.entry is None else channel.entry
    table = np.zeros((len(times), entry.max() + 1, left.shape[1]))
    table[row, entry] = np.nan_to_num(left)
    table = table.reshape(len(times), -1)
    squares = float((table**2).sum())
    crossed = table @ table.T if len(times) < table.shape[1] else table.T @ table
    return float((table[:-1] * table[1:]).sum()) / squares, squares**2 / float((crossed**2).sum()) * len(times)


def doubts_of_times(channels: Sequence[Channel], fps: float, substeps: int) -> list[str]:
    """Return what is doubtful about the times measured, before anything is simulated."""
    if substeps <= OUTRIGHT:
        return []
    times = np.unique(np.concatenate([[0.0], *(one.time for one in channels)]))
    return [
        f"measured has times {np.diff(times).min():.3g} s apart, in which the stiffest part of the scene swings "
        f"some {substeps // 3} times; times must be in seconds"
    ]


def doubts_of_values(
    problem: Problem, theta: NDArray[np.float64], unseen: list[str], converged: bool
) -> list[str]:
    """Return what is doubtful about the values found."""
    doubts = []
    if len(unseen) == 1:
        doubts.append(f"{unseen[0]} cannot be seen in what was measured: it stays about where it started")
    elif unseen:
        doubts.append(f"{' and '.join(unseen)} cannot be told apart, or seen, in what was measured")
    for one, at, low, high in zip(problem.parameters, theta, problem.low, problem.high, strict=True):
        if one.name not in unseen and min(at - low, high - at) < CLOSE * 1e-2:
            doubts.append(f"{one.name} ends at its bound, {one.start * np.exp(at):.4g}: it may lie beyond")
    if problem.worlds.diverged:
        doubts.append("the scene diverges with the values found")
    if not converged:
        doubts.append("the search has not come to an end")
    return doubts


def warn(doubts: Sequence[str], level: int) -> None:
    """Warn of each, as what the caller so many functions above has asked for."""
    for one in doubts:
        warnings.warn(one, checks.FitWarning, stacklevel=level + 1)
