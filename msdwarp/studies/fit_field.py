"""A field (a value for each connection or particle, such as stiffness), fitted to tracked points by gradients."""

import warnings
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import checks
from ..integrators import Integrator, Leapfrog
from ..simulation import Frames, Simulation, frame_count
from ..world import Scene
from .measured import Channel, channels_of, frame_rate, interpolated
from .parameters import UNITS

FIELDS = ("stiffness", "damping", "rest_length", "mass")
HORIZONS = ((0.25, 40), (0.5, 40), (1.0, 10_000))
"""(fraction of the measured time, maximal number of steps) of each successive search."""
ENOUGH = 1e-6
"""A search ends when a step lowers the sum by less than this fraction: for 10⁵ coordinates by 0.05, where 1 is
one standard deviation of a value."""


@dataclass(frozen=True, eq=False)
class FieldFit:
    """A field that was fitted to a measured motion; returned by `fit_field`.

    Attributes
    ----------
    name
        Name of the fitted field.
    values
        The fitted value of each connection or particle, shape as in `System`.
    scene
        The scene with these values.
    residual
        Root mean square of simulated − measured coordinates [m].
    gradients
        Number of gradients computed.
    substeps
        Substeps of a frame.
    converged
        Whether the last search ended because steps no longer improved the fit.
    """

    name: str
    values: NDArray[np.float64]
    scene: Scene
    residual: float
    gradients: int
    substeps: int
    converged: bool

    def __repr__(self) -> str:
        low, middle, high = np.quantile(self.values[np.isfinite(self.values)], (0.0, 0.5, 1.0))
        lines = [
            f"FieldFit\n  {len(self.values)} values of {self.name}: {low:.4g} to {high:.4g} {UNITS[self.name]}",
            f"median {middle:.4g}; left over, root mean square: {self.residual:.3g} m",
            f"{self.gradients} gradients with {self.substeps} substeps a frame",
        ]
        return "\n  ".join(lines if self.converged else [*lines, "not converged"])


def fit_field(
    scene: Scene,
    measured: Any,
    name: str = "stiffness",
    *,
    noise: float,
    variation: float = 0.3,
    reach: float = 10.0,
    iterations: int = 100,
    fps: float | None = None,
    integrator: Integrator | None = None,
    device: str | None = None,
) -> FieldFit:
    """Fit a value for each connection, or each particle, to tracked points.

    It minimises ½ Σ (Δ/noise)² + ½ Σ (δ/variation)². Δ are simulated minus measured coordinates. δ are logarithms
    of values minus their mean over the connections that meet at a particle (for masses: over the particle and its
    neighbours). The result is the most probable field if neighbours differ by about `variation`.
    L-BFGS needs about one gradient per step, whatever the number of values (see `Simulation.gradient`). A quarter
    of the time is fitted first, then half of it, then all: over a long time the sum has many minima.

    Parameters
    ----------
    scene
        The measured scene. The search starts from its values, which must be above 0.
    measured
        A `TrackedPoints`, a `Trajectory`, or the path of either; see `fit`.
    name
        "stiffness", "damping", "rest_length" or "mass". `Cells` keep theirs.
    noise
        Standard deviation of measured coordinates [m].
    variation
        Standard deviation of ln(value) among neighbours.
    reach
        Values stay within the scene's values divided and multiplied by this factor.
    iterations
        Maximal number of steps on each part of the measured time.
    fps, integrator, device
        See `fit`. The substeps are stable for all values within reach.

    Returns
    -------
    FieldFit
        The values, and the scene with them.

    Raises
    ------
    ValueError
        If an argument is out of range, the measurements are not of points, SciPy is missing, or a part of the
        scene has no derivative, such as a change of its schedule. Nothing is simulated then.

    Reference: Liu and Nocedal, On the limited memory BFGS method, Math. Programming 45 (1989) 503-528.
    """
    checks.instance("scene", scene, Scene, "Scene(system=chain(5))")
    checks.imported("scipy.optimize", "fitting needs SciPy: pip install 'msdwarp[fit]'")
    checks.one_of("name", name, FIELDS)
    checks.positive("noise", noise)
    checks.positive("variation", variation)
    checks.between("reach", reach, 1.0 + 1e-9, 1e6)
    checks.count("iterations", iterations, 1)
    (channel, *others) = channels_of(measured, scene, noise)
    if others or channel.entry is None:
        raise ValueError("measured has probes or energies; a field is fitted to tracked points")
    if scene.settled:
        raise ValueError("scene has settled=True, and where it rests depends on the values; it must be False")
    rate = frame_rate([channel]) if fps is None else checks.positive("fps", fps)
    field = FieldProblem(scene, channel, name, rate, variation, reach, integrator, device)
    return field.fit(iterations)


class FieldProblem:
    """The objective of `fit_field` as a function of θ = ln(value/start), for the finite values."""

    def __init__(
        self,
        scene: Scene,
        channel: Channel,
        name: str,
        rate: float,
        variation: float,
        reach: float,
        integrator: Integrator | None = None,
        device: str | None = None,
    ) -> None:
        from scipy.sparse import csr_array, diags_array

        self._scene, self._channel, self._name, self._rate = scene, channel, name, rate
        system, self._gradients, self._squares = scene.system, 0, 0.0
        count = system.particle_count if name == "mass" else system.connection_count
        self._start = np.broadcast_to(getattr(system, name), count).astype(np.float64)
        self._free = np.isfinite(self._start)
        self.count = int(self._free.sum())
        """Number of unknown values; values of pinned particles are fixed."""
        checks.every(f"scene.system.{name}", self._start, self._start > 0, "above 0 to be fitted")
        # meets[p, c]: value c meets at particle p. Σ_p Σ_c (θ_c − mean_p)² = θᵀ (diag(n) − Mᵀ diag(1/n_p) M) θ.
        one, two = system.connections.T
        particle, entry = np.concatenate([one, two]), np.tile(np.arange(count), 2)
        if name == "mass":
            own = np.arange(count)
            particle, entry = np.concatenate([own, one, two]), np.concatenate([own, two, one])
        meets = csr_array((np.ones(len(entry)), (particle, entry)), shape=(system.particle_count, count))
        meets = meets[:, self._free]
        number = np.asarray(meets.sum(axis=1)).ravel()
        mean = diags_array(1.0 / np.maximum(number, 1.0)) @ meets
        self._prior = (diags_array(np.asarray(meets.sum(axis=0)).ravel()) - meets.T @ mean) / variation**2
        self._reach = np.log(reach)
        self._how = {"fps": rate, "integrator": integrator or Leapfrog(), "precision": "float64", "device": device}
        ends = [self._simulation(np.full(self.count, way)) for way in (self._reach, -self._reach)]
        self._how["substeps"] = max(one.substeps for one in ends)
        self._last = float(channel.time[np.isfinite(channel.values).any(axis=1)].max())
        ends[0].check_differentiable(frame_count(max(self._last, 1.0 / rate), rate), (name,))

    def _values(self, theta: NDArray[np.float64]) -> NDArray[np.float64]:
        values = self._start.copy()
        values[self._free] *= np.exp(theta)
        return values

    def _with(self, theta: NDArray[np.float64]) -> Scene:
        values: dict[str, Any] = {self._name: self._values(theta)}
        return replace(self._scene, system=self._scene.system.replace(**values))

    def _simulation(self, theta: NDArray[np.float64]) -> Simulation:
        return Simulation.from_scene(self._with(theta), **self._how)

    def cost(self, theta: NDArray[np.float64], end: float) -> tuple[float, NDArray[np.float64]]:
        """Return the objective until `end` [s], and its gradient."""
        channel, number = self._channel, frame_count(end, self._rate)
        places, row = np.unique(np.minimum(channel.time * self._rate, number), return_inverse=True)
        weights, seen, tracked = interpolated(np.eye(number + 1), places), channel.until(end), channel.what

        def misfit(frames: Frames) -> tuple[float, NDArray[np.float64], None]:
            found = np.tensordot(weights, frames.position[:, tracked], 1)[row, channel.entries]
            left = np.where(seen, found - channel.values, 0.0) / channel.noise
            by_found = np.zeros((len(places), len(tracked), left.shape[1]))
            np.add.at(by_found, (row, channel.entries), left / channel.noise)
            by_position = np.zeros(frames.position.shape)
            by_position[:, tracked] = np.tensordot(weights.T, by_found, 1)
            self._squares = float((left**2).sum())
            return 0.5 * self._squares, by_position, None

        with warnings.catch_warnings():  # motions may be chaotic for values far from the best
            warnings.simplefilter("ignore", checks.GradientWarning)
            gradient = self._simulation(theta).gradient(misfit, number, by=(self._name,))
        self._gradients += 1
        rough, by_roughness = self.prior(theta)
        by_theta = gradient[self._name][self._free] * self._values(theta)[self._free]
        return gradient.value + rough, by_theta + by_roughness

    def prior(self, theta: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        """Return the prior term ½ Σ (δ/variation)², and its gradient."""
        by_theta = self._prior @ theta
        return 0.5 * float(theta @ by_theta), by_theta

    def fit(self, iterations: int) -> FieldFit:
        """Return the best field, fitted to successively longer parts of the measured time."""
        from scipy.optimize import minimize

        channel, last, theta, converged = self._channel, self._last, np.zeros(self.count), False
        bounds = [(-self._reach, self._reach)] * len(theta)
        for fraction, steps in HORIZONS:
            end = max(fraction * last, 1.0 / self._rate)
            if channel.until(end).any():
                options = {"maxiter": min(steps, iterations), "ftol": ENOUGH}
                how = {"jac": True, "method": "L-BFGS-B", "bounds": bounds, "options": options}
                found = minimize(self.cost, theta, args=(end,), **how)
                theta, converged = found.x, bool(found.success)
        self.cost(theta, last)
        return FieldFit(
            name=self._name,
            values=self._values(theta),
            scene=self._with(theta),
            residual=float(channel.noise * np.sqrt(self._squares / channel.until(last).sum())),
            gradients=self._gradients,
            substeps=self._how["substeps"],
            converged=converged,
        )
