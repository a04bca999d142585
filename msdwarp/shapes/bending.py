"""Sheets that resist bending: springs to second neighbours, in equilibrium with the springs between neighbours.

**The springs.** Provot (Deformation constraints in a mass-spring model to describe rigid cloth behaviour, Graphics
Interface 1995) joins second neighbours. If three particles of a line, l apart, bend by the angle θ, the outer two
come closer by δ = 2 l (1 − cos θ/2), about l θ²/4. A spring between them that is at rest in the flat sheet stores
k δ²/2, of fourth order in the curvature θ/l: for small loads it gives no stiffness.

So here this spring is compressed and pushes with P, and the two springs between neighbours have an additional
tension P: in the flat sheet the forces on each particle balance. When bent, the line stores P δ, of second order:
linear bending. The spring's stiffness is P/(6 l), so its rest length is 8 l, four times its length. Then P δ + k
δ²/2 is P l θ²/4 up to terms in θ⁶, and the moment is P l θ/2, proportional to the angle: the exact moment is lower
by 0.4 % at θ = 1.2, by 3 % at 2 and by 15 % at π, folded flat.

**From the flexural rigidity D [N m].** A line along n stores P l θ²/4, θ = l w_nn, for a deflection w. There is
one such angle at each particle, so that an area s² of a sheet stores P l³ w_nn²/4 in each direction. The energy of
a plate per unit area is

    D/2 (w_xx² + w_yy² + 2 ν w_xx w_yy + 2 (1 − ν) w_xy²)  =  D/3 (w_xx² + w_yy² + w_pp² + w_qq²)

for the diagonals p and q and ν = 1/3, which is also Poisson's ratio of the sheet's springs in its plane. Hence P =
4 D s²/(3 l³): 4/3 D/s along axes and √2/3 D/s along diagonals, where l = √2 s. With 4 neighbours there are only
axes: P = 2 D/s, ν = 0, and nothing resists twist.

**At a rim.** A spring that pushes with w P, while both that it spans pull with w P more, is in equilibrium for any
weight w. So weights are those of a quadrature: how much of the plate an angle stands for. With 4 neighbours, where
ν = 0 and no moment is missing at a rim, w is 1, and 1/2 along a margin, with cells on one side. With 8:

- The end of a diagonal has no angle, so the last one stands for it too, w = 3/2: or half a cell at each rim would
  not resist the twist of a supported or free plate.
- Two pinned rows clamp midway between them if the angles of the second stand for one cell. In a cylinder axes have
  2/3 of the energy and diagonals 1/3: 2/3 w + 1/3 · 3/2 = 1, so the last angle of an axis has w = 3/4.
- At a free rim a curvature 1 along it brings about one across it, c, that costs least: 3/2 c² + 3/4 (1 + c)² is
  1/2 then, but 3/8 with 3/4 c². The margin makes up for that: w = 1/2 + 1/8.

**Error.** Curvatures are differences of second order: the sag of a strip with N cells between clamp and end is
within 1/N² of theory with 4 neighbours. A square plate with 8, with 16 cells on a side, sags 2.3 % too much if
simply supported and 0.25 % if clamped, and with 32 cells a quarter of that; its lowest frequency is 1.5 % too low
if supported, 0.6 % if clamped or free. A free strip is a plate from three cells of width on; two cells wide it has
31/32 of the stiffness, one cell wide, without twist, 15/16. A rim oblique to the lattice is a staircase: the error
there is of first order. In its plane a sheet is stiffer along a line by 4 P/(6 l), with a material (t/s)²/9 of its
own springs.

**Limits.** Bending resistance needs rest lengths unlike those of the flat sheet: `System.set_rest_shape`,
new rest lengths, or a yield strain below 3/4 (the strain of these springs when flat) remove the resistance.
The measured largest strain excludes these springs, unless something yields. The elastic energy of a flat sheet
is not 0: with 8 neighbours it is 12 D per inner particle. The energy that bending adds equals the energy of
the plate.
"""

import math

import numpy as np
from numpy.typing import NDArray

from .. import checks
from ..bodies import Material, System
from .grid import ends_of, lattice_directions, whole_cells

_SLACK = 4.0
"""Ratio of a second-neighbour spring's rest length to its length in the flat sheet."""
_DIAGONAL, _AXIS, _MARGIN = 1 / 2, -1 / 4, 5 / 8
"""What weights have more at the ends of lines, diagonals and axes, and that of margins: see above."""
_LEAST = 0.5
"""Under tension, connections between neighbours keep at least this fraction of their rest length."""


def flexural_rigidity(
    bending: float | str | None, material: Material | None, thickness: float, diagonals: bool, dim: int
) -> float:
    """Return the requested flexural rigidity D [N m]; 0 for None.

    Raises ValueError if it is invalid, needs a missing material, or the sheet cannot leave the plane.
    """
    if bending is None:
        return 0.0
    if isinstance(bending, str | bool):
        if bending != "material":
            raise ValueError(f"bending is {bending!r}; it must be a rigidity [N m], 'material' or None")
        if material is None:
            raise ValueError("bending is 'material'; without a material it must be a rigidity [N m] or None")
        rigidity = material.flexural_rigidity(thickness, diagonals=diagonals)
    else:
        rigidity = checks.non_negative("bending", bending)
    if rigidity and dim == 2:
        raise ValueError(
            f"bending is {bending!r}; with dim=2, where nothing leaves the plane, it must be left out"
        )
    return rigidity


def resisting_bending(
    flat: System, mask: NDArray[np.bool_], spacing: float, rigidity: float, *, diagonals: bool, solid: bool
) -> System:
    """Return a flat sheet with springs to second neighbours; see the module's docstring.

    `flat` is the sheet without these springs, made by `lattice`; `mask` are the lattice points with particles; the
    rigidity D [N m] is above 0. Such a spring exists if both connections that it spans exist, so that none bridges
    a hole or notch. Its damper has the same ratio b/k as these connections. It acts along the chord, so it damps
    bending of a flat sheet only to second order. A `solid` sheet (of a material) has such springs beside two whole
    cells alone; without a material others, as in a net, have the weight 1.

    Raises ValueError if connections are too weak for the tension.
    """
    damping_time = np.zeros(flat.connection_count)
    np.divide(flat.damping, flat.stiffness, out=damping_time, where=flat.stiffness > 0)
    tension = np.zeros(flat.connection_count)
    parts = {name: [getattr(flat, name)] for name in ("connections", "stiffness", "damping")}
    lengths, slices, start = [], dict(flat.directions[0]), flat.connection_count
    for name, step in lattice_directions(2, diagonals=diagonals).items():
        length = spacing * math.hypot(*step)
        push = rigidity * spacing**2 / length**3 * (4 / 3 if diagonals else 2.0)
        first, second, weight = _angles(flat, name, step, mask, diagonals=diagonals, solid=solid)
        for one in (first, second):
            tension += np.bincount(one, push * weight, flat.connection_count)
        if len(first):
            stiffness = weight * (push / (2 * (_SLACK - 1) * length))
            parts["connections"].append(
                np.stack([flat.connections[first, 0], flat.connections[second, 1]], axis=1)
            )
            parts["stiffness"].append(stiffness)
            parts["damping"].append((damping_time[first] + damping_time[second]) / 2 * stiffness)
            lengths.append(np.full(len(first), 2 * _SLACK * length))
            slices[name.replace("x", "2x").replace("y", "2y")] = slice(start, start + len(first))
            start += len(first)
    pulled = tension > 0
    most = (1 - _LEAST) * (flat.stiffness * flat.rest_length)[pulled] / tension[pulled]
    if (most < 1).any():
        raise ValueError(
            f"bending is {rigidity:g} N m; connections of this stiffness bear at most {most.min() * rigidity:.4g}"
        )
    rest_length = np.array(flat.rest_length)
    rest_length[pulled] -= tension[pulled] / flat.stiffness[pulled]
    return System(
        position=flat.position,
        mass=flat.mass,
        connections=np.concatenate(parts["connections"]),
        rest_length=np.concatenate([rest_length, *lengths]),
        stiffness=np.concatenate(parts["stiffness"]),
        damping=np.concatenate(parts["damping"]),
        surface=flat.surface,
        cells=flat.cells,
        directions=(slices,),
    )


def _angles(
    flat: System, name: str, step: tuple[int, ...], mask: NDArray[np.bool_], *, diagonals: bool, solid: bool
) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.float64]]:
    """Return (connections before, connections after, weights) of the points where a line along `step` can bend."""
    part = flat.directions[0][name]
    beginning = np.full(mask.shape, -1)  # connection that starts at each point, −1 for none
    points = np.argwhere(mask.T)[:, ::-1]
    beginning[tuple(points[flat.connections[part, 0]].T)] = np.arange(part.start, part.stop)
    here, _ = ends_of([2 * s for s in step], mask.shape)
    middle = tuple(slice(one.start + s, max(one.start, one.stop) + s) for one, s in zip(here, step, strict=True))
    first, second = beginning[here].T, beginning[middle].T  # x varies fastest, as in all arrays
    weight = _weights(whole_cells(mask), step, diagonals=diagonals).T
    if not solid:
        weight[weight == 0] = 1.0
    there = (first >= 0) & (second >= 0) & (weight > 0)
    return first[there], second[there], weight[there]


def _weights(whole: NDArray[np.bool_], step: tuple[int, ...], *, diagonals: bool) -> NDArray[np.float64]:
    """Return the weight of each angle along a step; 0 where no two cells in a row beside it are whole.

    Ordered as by `ends_of`: points of a grid that have a neighbour two steps further.
    """
    here, there = ends_of(step, whole.shape)
    pairs = whole[here] & whole[there]  # two cells in a row
    around = np.pad(pairs, [(abs(s), abs(s)) for s in step])
    here, there = ends_of([2 * s for s in step], around.shape)
    ends = 2 - around[here].astype(int) - around[there]  # how many ends of the line are a cell away
    if 0 not in step:
        return pairs * (1 + _DIAGONAL * ends)
    along = np.pad(pairs * (1 + _AXIS * ends * diagonals), [(1 - abs(s), 1 - abs(s)) for s in step])
    left, right = np.delete(along, -1, step.index(0)), np.delete(along, 0, step.index(0))
    margin = diagonals & ((left > 0) != (right > 0))
    return (left + right) * np.where(margin, _MARGIN, 1 / 2)
