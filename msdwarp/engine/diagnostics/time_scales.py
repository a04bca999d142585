"""Time scales: the substeps that resolve functions of time, of loads, of gravity and of prescribed motions."""

import math

import numpy as np
from numpy.typing import NDArray

from ... import checks
from ...runtime import in_turn
from ..loads.forces import ForceField, Varying
from ..model.model import Model
from ..model.state import State
from ..stepping.assemble import Assembly

LOOK = 10
"""Frames between looks at functions of time. A look sees the frames until the next, and one on either side."""
LEAST, MOST = 64, 4096
"""Values of a function taken in each frame: at first, and at most, where these show that it is fast."""
FINER = 4
"""Values taken for each substep asked for: what seems to change in the time of one may be a jump."""
ERROR = 0.05
"""Largest error of the integral over a pulse with edges, as a fraction: 20 substeps fall into it."""
RADIANS = 2.0 * math.pi / 20
"""Longest substep under a sinusoid, times its angular frequency: 20 to a period."""
FLOOR = 1e-3
"""Changes count if they are not much below this fraction of a function's values."""


@in_turn
def time_rates(assembly: Assembly, state: State, time: float, fps: float) -> dict[str, float]:
    """Return substeps per second that resolve each function of time from `time` [s] on; of noise, inf."""
    found, start, most = dict[str, float](), max(0.0, time - 1.0 / fps), MOST * fps
    for effect in (one for one in assembly.all if one.timed):
        least = _rounding(assembly.model) if isinstance(effect, Varying | ForceField) else 0.0
        count, ahead, rates = LEAST, LOOK + 1, dict[str, float]()
        while ahead > 0:
            times = _times(start, time + ahead / fps, count * fps)
            try:
                values = effect.look_ahead(times, state.x, state.v)
                for name, each in values.items():
                    checks.finite(name, each)
            except (ValueError, SystemExit):  # it may be defined for a shorter run only
                ahead -= 1
                continue
            coarse, rates = rates, {name: _rate(times, each, least) for name, each in values.items()}
            if count == MOST or max(rates.values(), default=0.0) <= count * fps / FINER:
                # Of noise more values ask for more substeps.
                ends = {name: min(most, max(most / FINER, 2.0 * coarse.get(name, 0.0))) for name in rates}
                found |= {name: rate if rate <= ends[name] else math.inf for name, rate in rates.items()}
                break
            count *= 4
    return found


def _rounding(model: Model) -> float:
    """Return the rounding error of the lightest free particle's weight [N]: a smaller force does not count."""
    mass, gravity = model.row_of("mass"), np.linalg.norm(model.row_of("gravity"), axis=-1)
    free = mass[np.isfinite(mass)]
    error = np.finfo(np.float64 if model.compensated else model.dtype).eps
    return float(error * free.min() * gravity.min()) if free.size else 0.0


def _times(start: float, end: float, density: float) -> NDArray[np.float64]:
    """Return so many times per second, unevenly, so that no period falls on all of them."""
    k = np.arange(max(4, math.ceil((end - start) * density)))
    uneven = 0.5 * (k * (math.sqrt(5.0) - 1.0) / 2.0 % 1.0)
    return start + (end - start) / len(k) * (k + uneven)


def _rate(times: NDArray[np.float64], values: NDArray[np.float64], least: float) -> float:
    """Return the substeps per second that resolve all columns of `values`, shape [time_count, columns, width].

    With substeps h a sum errs from ∫f dt by at most h/2 Σ|Δf|, and if f is smooth by about h²/12 ∫|f''| dt. One of
    them must be a small fraction of ∫|f| dt, where the line through the ends of f is subtracted. From time 0 on f
    is compared with its end: it may be a pulse that begins with the run, which errs by h/2 |f|. Columns that stay
    within `least` do not count.
    """
    at_start = (times[0] == 0.0) & (values[0] != 0.0).any(axis=-1, keepdims=True)
    first, span, apart = np.where(at_start, values[-1], values[0]), times[-1] - times[0], np.diff(times)[:, None]
    off = values - first - np.multiply.outer((times - times[0]) / span, values[-1] - first)
    size, steps = np.linalg.norm(off, axis=-1), np.diff(off, axis=0)
    integral = (0.5 * (size[1:] + size[:-1]) * apart).sum(axis=0)
    largest = np.linalg.norm(values, axis=-1).max(axis=0)
    integral = np.where(largest <= least, np.inf, integral + FLOOR * span * largest)
    jumps = size[0] + np.linalg.norm(steps, axis=-1).sum(axis=0)
    bends = np.linalg.norm(np.diff(steps / apart[..., None], axis=0), axis=-1).sum(axis=0)
    by_jumps, by_start = (one / (2.0 * ERROR * integral) for one in (jumps, size[0]))
    by_bends = np.sqrt(bends / integral) / RADIANS
    return float(np.maximum(np.minimum(by_jumps, by_bends), by_start).max())
