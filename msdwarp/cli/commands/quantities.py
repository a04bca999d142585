"""What the colors and arrows of pictures show, and their scales."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ...bodies import lengths, stress, von_mises
from ...files import FrameArray, Trajectory
from ...pictures import ColorScale
from ...studies import particle_energies, system_in
from ...world import Scene
from ..picture_options import Pictures

Values = Callable[[int], NDArray[np.float64]]


def dressed(
    scene: Scene, trajectory: Trajectory, pictures: Pictures, shown: Sequence[int]
) -> tuple[Scene, str | ColorScale, Values | None]:
    """Return the scene as pictures show it: torn, and with their camera; and `_coloring`."""
    look = pictures.aimed(scene.look)
    look = look if pictures.floor is None else replace(look, floor=pictures.floor)
    if scene.system.tears:
        scene = replace(scene, system=scene.system.replace(broken_at=trajectory.broken_at))
    color = pictures.color or ("strain" if look.strain else "texture")
    if color == "strain":
        look = replace(look, full_strain=_full_strain(scene, trajectory, pictures, shown))
    scene = replace(scene, look=look)
    return scene, *_coloring(scene, trajectory, color, shown)


def _coloring(
    scene: Scene, trajectory: Trajectory, color: str, shown: Sequence[int]
) -> tuple[str | ColorScale, Values | None]:
    """Return (coloring of the body, function (k) -> particles' values in frame k); None if it has no values.

    The scale ends at the largest 99th percentile of a frame.
    """
    if color not in _QUANTITIES:
        return color, None
    label, values_of = _QUANTITIES[color]
    values = partial(values_of, scene, trajectory)
    largest = max(float(np.quantile(values(k), 0.99)) for k in shown)
    return ColorScale(label, round_up(largest)), values


def _full_strain(scene: Scene, trajectory: Trajectory, pictures: Pictures, shown: Sequence[int]) -> float:
    """Return the strain at the scale's ends: the given one, or the 99th percentile over springs and frames.

    If there are many springs and frames, only some are evaluated.
    """
    if (given := pictures.full_strain or scene.look.full_strain) is not None:
        return given
    system = scene.system
    some = slice(None, None, max(1, system.connection_count // 5000))
    pairs, rest_length = system.connections[some], system.rest_length[some]
    sizes = [np.zeros(0)]
    for k in list(shown)[:: max(1, len(shown) // 100)]:
        strain = np.abs(lengths(trajectory.positions[k].astype(np.float64), pairs) / rest_length - 1)
        # Broken springs are not drawn.
        sizes.append(strain[system.broken_at[some] > trajectory.times[k]] if system.tears else strain)
    strains = np.concatenate(sizes)
    return round_up(float(np.quantile(strains, 0.99)) if len(strains) else 0.0)


def arrows(trajectory: Trajectory, shown: Sequence[int]) -> tuple[FrameArray, float]:
    """Return (contact forces in the frames, force of the longest arrow [N]).

    This force is the median over frames of the 90th percentile. Relative to a short impact's force, all other
    arrows would be invisibly short.
    """
    forces, large = trajectory.contact_forces, list[float]()
    for k in shown:
        sizes = _lengths(forces[k])
        if sizes.any():
            large.append(float(np.quantile(sizes[sizes > 0], 0.9)))
    return forces, round_up(float(np.median(large)) if large else 0.0)


def _lengths(vectors: NDArray) -> NDArray[np.float64]:
    return np.linalg.norm(vectors.astype(np.float64), axis=1)


_QUANTITIES: dict[str, tuple[str, Callable[[Scene, Trajectory, int], NDArray[np.float64]]]] = {
    "velocity": ("speed [m/s]", lambda scene, trajectory, k: _lengths(trajectory.velocities[k])),
    "energy": (
        "energy of a particle and half its connections [J]",
        lambda scene, trajectory, k: particle_energies(system_in(trajectory, k, scene.schedule)),
    ),
    "stress": (
        "von Mises stress [Pa]",
        lambda scene, trajectory, k: von_mises(stress(system_in(trajectory, k, scene.schedule))),
    ),
    "contact": (
        "contact force on a particle [N]",
        lambda scene, trajectory, k: _lengths(trajectory.contact_forces[k]),
    ),
}
"""Quantities of particles that colors can show, by name: the label, and a function for the values in a frame."""


def round_up(value: float) -> float:
    """Return a value rounded up to one or two digits; 1 if it is not above 0."""
    if value <= 0:
        return 1.0
    power = 10.0 ** math.floor(math.log10(value))
    return next(step * power for step in (1, 1.5, 2, 3, 4, 5, 6, 8, 10) if step * power >= value * (1 - 1e-9))
