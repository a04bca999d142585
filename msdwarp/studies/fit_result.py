"""The result of a fit: values, their standard deviations, residuals."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..world import Scene
from .plots import BLUE, DARK, RED, add_grid, new_figure, save_figure


@dataclass(frozen=True, eq=False)
class FitResult:
    """Parameters of a scene, fitted to a measured motion; returned by `fit`.

    Attributes
    ----------
    values
        The parameters by name, in the units of `units`.
    units
        Units of the values; if the scene's values vary between springs or particles, a fitted value is a factor.
    covariance
        Covariance of the values, s² (JᵀJ)⁻¹, shape [p, p]; inf for parameters that are not determined.
    residuals
        Simulated − measured, by kind of measurement: times [s] and differences, shape [rows, width].

        NaN if nothing was measured. The kind "points" has tracked points.
    residual_units
        The units of the differences by kind.
    scene
        The scene with the fitted values.
    fps
        Frames per second of the simulations.
    substeps
        Substeps of a frame in the last runs.
    runs
        Number of simulated worlds.
    batches
        Number of runs; the worlds of one `Ensemble` run in parallel.
    alone
        Why worlds were simulated one by one: a feature that an `Ensemble` does not support. Otherwise empty.
    unseen
        Parameters that the measurement does not determine.
    converged
        Whether the last steps were below the tolerance.
    """

    values: dict[str, float]
    units: dict[str, str]
    covariance: NDArray[np.float64]
    residuals: dict[str, tuple[NDArray[np.float64], NDArray[np.float64]]]
    residual_units: dict[str, str]
    scene: Scene
    fps: float
    substeps: int
    runs: int
    batches: int
    alone: str
    unseen: tuple[str, ...]
    converged: bool

    @property
    def standard_deviations(self) -> dict[str, float]:
        """Standard deviations of the values, in the same units: square roots of the covariance's diagonal."""
        return dict(zip(self.values, map(float, np.sqrt(np.diag(self.covariance))), strict=True))

    @property
    def residual_size(self) -> dict[str, float]:
        """Root mean square of the residuals of each kind of measurement, in the unit of this kind."""
        return {name: float(np.sqrt(np.nanmean(own**2))) for name, (_, own) in self.residuals.items()}

    def __repr__(self) -> str:
        lines = ["FitResult"]
        for name, deviation in self.standard_deviations.items():
            certain = f"± {deviation:.2g}" if np.isfinite(deviation) else "(cannot be seen)"
            lines.append(f"{name} {self.values[name]:.8g} {certain} {self.units[name]}".rstrip())
        sizes = self.residual_size.items()
        left = ", ".join(f"{name} {size:.3g} {self.residual_units[name]}".rstrip() for name, size in sizes)
        lines.append(f"left over, root mean square: {left}")
        together = f"in {self.batches} batches" if not self.alone else f"one after the other: {self.alone}"
        lines.append(f"{self.runs} worlds of {self.substeps} substeps a frame, {together}")
        if not self.converged:
            lines.append("not converged")
        return "\n  ".join(lines)

    def plot(self, path: str | Path) -> None:
        """Plot the residuals against time, and their histogram, to a file such as residuals.png."""
        figure = new_figure(8, 2.8 * len(self.residuals))
        grid = figure.subplots(len(self.residuals), 2, width_ratios=(3, 1), squeeze=False, sharey="row")
        for (name, (time, left)), (over_time, often) in zip(self.residuals.items(), grid, strict=True):
            unit = self.residual_units[name]
            over_time.plot(np.repeat(time, left.shape[1]), left.ravel(), ".", color=BLUE, ms=2, alpha=0.5)
            seen = [t for t in np.unique(time) if np.isfinite(left[time == t]).any()]
            size = [np.sqrt(np.nanmean(left[time == t] ** 2)) for t in seen]
            over_time.plot(seen, size, color=RED, lw=1.5, label="root mean square")
            over_time.axhline(0, color=DARK, lw=0.8)
            over_time.set_ylabel(f"{name}\nsimulated − measured" + (f" [{unit}]" if unit else ""))
            over_time.legend(frameon=False)
            often.hist(left[np.isfinite(left)], bins=40, orientation="horizontal", color=BLUE)
            often.set_xlabel("how often")
            for axes in (over_time, often):
                add_grid(axes)
        grid[-1, 0].set_xlabel("time [s]")
        save_figure(figure, path)
