"""Regions: parts of a body with a material, or with laws of springs and dampers, of their own."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import checks
from .cells import CORNERS, NONE, Cells
from .connectivity import body_cells, connection_of, corner_pairs
from .dampers import Damper, OwnDamper, UnknownDamper
from .materials import Material
from .selection import chosen, mask_of
from .springs import OwnSpring, Spring, UnknownSpring
from .uniform import joined

MOST_LAWS = 16
"""Maximal number of laws of springs, and of dampers, so that a byte can number the pairs of them."""
_EQUAL = 1e-6
"""Sides of a cell are equal if they differ by less than this fraction: far more than rounding."""


class Regional:
    """What a `System` can do for a part of it."""

    def with_material(
        self,
        selection: Any,
        material: Material,
        *,
        thickness: float | None = None,
        area: float | None = None,
    ) -> Self:
        """Return this system with part of a lattice body, such as a `box`, of another material.

        The part are the cells of which all corners are selected. Masses, springs, dampers and `cells` become those
        of the material, as if the whole body were of it; what cells of both sides have in common, such as
        connections in the face between them, sums what each contributes. So forces pass from one material to the
        other as in a solid. Where cells had different masses or springs of their own before, a connection or a
        particle counts as shared equally by the cells around it. Pinned particles stay pinned. `msdwarp.voxels`
        makes bodies of several materials at once.

        Parameters
        ----------
        selection
            Particles, as for `pin`: the name of a group, indices, a slice or a mask.
        material
            The material of the part. Its damping ratio is that of a bar as long as the whole body.
        thickness, area
            Thickness of a sheet [m], and cross section of a chain [m²]; only for these.

        Raises
        ------
        ValueError
            If the selection has no whole cell, or is part of a rod or of a sheet with bending; or cells have
            unequal sides; or a Poisson's ratio is given for a body without diagonals.
        """
        system: Any = self
        part, sections = chosen("selection", selection, system), {"thickness": thickness, "area": area}
        return system.replace(**with_material(vars(self), part, material, sections))

    def with_law(self, selection: Any, *, spring: Spring | None = None, damper: Damper | None = None) -> Self:
        """Return this system with other laws for the connections between two selected particles.

        Parameters
        ----------
        selection
            Particles, as for `pin`: the name of a group, indices, a slice or a mask.
        spring, damper
            Their laws, such as `TensionOnlySpring()` and `CoulombDamper()`. The constants stay: see
            `System.damping` for their units. Without one, the laws stay.

        Raises
        ------
        ValueError
            If no connection joins two of the particles; or a law is not built-in, and others would stay beside it.
        """
        system: Any = self
        part = np.asarray(chosen("selection", selection, system)[system.connections].all(axis=1))
        if not part.any():
            raise ValueError(f"selection is {checks.repr_short(selection)}; a connection must join two of it")
        laws: dict[str, Any] = {}
        for name, new, kind, like in (
            ("spring", spring, Spring, "TensionOnlySpring()"),
            ("damper", damper, Damper, "CoulombDamper()"),
        ):
            if new is not None:
                checks.instance(name, new, kind, like)
                laws[name] = with_law(getattr(self, name), new, part)
        return system.replace(**laws)


class LawKinds:
    """Several laws, and which of them each connection follows.

    Parameters
    ----------
    laws
        One to 16 different built-in laws.
    kind
        Index in `laws` of each connection's law, shape [connection_count]; of two laws a mask chooses the second.

    Raises
    ------
    ValueError
        If a law is given twice or is not built-in, or an index is out of range.
    """

    laws: tuple[Any, ...]
    kind: NDArray[np.uint8]

    def __init__(self, laws: Any, kind: ArrayLike) -> None:
        laws = checks.sequence("laws", laws, Spring if isinstance(self, Spring) else Damper, "QuadraticDamper()")
        others = LawKinds | OwnSpring | OwnDamper | UnknownSpring | UnknownDamper
        if any(isinstance(law, others) for law in laws) or not 1 <= len(set(laws)) == len(laws) <= MOST_LAWS:
            raise ValueError(f"laws is {laws}; it must be one to {MOST_LAWS} different built-in laws")
        given = np.asarray(kind)
        if given.ndim != 1 or given.dtype.kind not in "iub":
            raise ValueError(f"kind is {checks.repr_short(kind)}; it must be a whole number for each connection")
        checks.within("kind", given, checks.index_below(len(laws)))
        self.__dict__.update(laws=laws, kind=given.astype(np.uint8))
        self.kind.flags.writeable = False

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, LawKinds) or type(other) is not type(self):
            return False
        return other.laws == self.laws and np.array_equal(self.kind, other.kind)

    def __repr__(self) -> str:
        counts = np.bincount(self.kind, minlength=len(self.laws))
        each = (f"{law!r} of {count}" for law, count in zip(self.laws, counts, strict=True))
        return f"{type(self).__name__}({', '.join(each)})"

    def ordered(self, order: Any) -> Self:
        """Return the laws of connections in another order: connection k is the former order[k]."""
        return type(self)(self.laws, self.kind[order])


class SpringKinds(LawKinds, Spring):
    """Several laws of springs, such as `Spring()` for struts and `TensionOnlySpring()` for cables."""


class DamperKinds(LawKinds, Damper):
    """Several laws of dampers: see `LawKinds`."""

    @property
    def steepest(self) -> Any:
        """Largest slope of each connection's law, shape [connection_count]."""
        return np.array([law.steepest for law in self.laws])[self.kind]


def each_law(law: Any, count: int) -> tuple[tuple[Any, ...], NDArray[np.uint8]]:
    """Return the laws of so many connections, and which of them each follows."""
    return (law.laws, law.kind) if isinstance(law, LawKinds) else ((law,), np.zeros(count, dtype=np.uint8))


def joined_laws(one: Any, count: int, other: Any, more: int, used: Any = (True, True)) -> Any:
    """Return the law, or the laws, of `count` connections followed by `more`; a law that is not `used` gives way.

    Raises ValueError if the laws differ, and one of them is not built-in.
    """
    parts = each_law(one, count), each_law(other, more)
    laws = list(dict.fromkeys(law for (of, _), use in zip(parts, used, strict=True) if use for law in of)) or [one]
    if len(laws) == 1:
        return laws[0]
    places = [np.array([laws.index(law) if law in laws else 0 for law in of])[kind] for of, kind in parts]
    return (SpringKinds if isinstance(one, Spring) else DamperKinds)(laws, np.concatenate(places))


def with_law(law: Any, new: Any, mask: NDArray[np.bool_]) -> Any:
    """Return the law, or the laws, of connections of which those in a mask follow a new one."""
    laws, kind = each_law(law, len(mask))
    laws = laws if new in laws else (*laws, new)
    used, kind = np.unique(np.where(mask, laws.index(new), kind), return_inverse=True)
    if len(used) == 1:
        return laws[used[0]]
    kinds: type[LawKinds] = SpringKinds if isinstance(new, Spring) else DamperKinds
    return kinds([laws[k] for k in used], kind)


class CellPart(NamedTuple):
    """What one cell of a material contributes to a lattice; see `Material`."""

    mass: float
    """Mass at each of its corners [kg]."""
    stiffness: tuple[float, ...]
    """Stiffness of each connection between its corners [N/m], by the number of axes spanned, from 1 on."""
    time: float
    """β = b/k of these connections [s]."""
    modulus: float
    """κ of its volume [Pa], or of its area [N/m]."""
    damping: float
    """c of its volume [Pa s], or of its area [N s/m]."""


def cell_part(
    material: Material, axes: int, spacing: float, section: float, length: float, *, diagonals: bool
) -> CellPart:
    """Return what a cell of a material contributes to a body of this length [m]; see `Material.cell_mass`."""
    stiffness = material.cell_stiffness(axes, spacing, section, diagonals=diagonals)
    time = material.damping_time(length, axes)
    return CellPart(
        mass=material.cell_mass(axes, spacing, section) / 2**axes,
        stiffness=tuple(k / 2 ** (axes - span) for span, k in enumerate(stiffness, start=1)),
        time=time,
        modulus=material.cell_modulus(axes, section),
        damping=time * material.damped_modulus(axes, section),
    )


def with_material(
    fields: Mapping[str, Any], mask: NDArray[np.bool_], material: Material, sections: Mapping[str, Any]
) -> dict[str, Any]:
    """Return what changes if cells with all corners in a mask are of a material; see `System.with_material`.

    `sections` has the thickness of sheets and the area of chains, or None.
    """
    checks.instance("material", material, Material, "msdwarp.RUBBER")
    new: dict[str, Any] = {name: np.array(fields[name]) for name in ("mass", "stiffness", "damping")}
    cells, unused, found = fields["cells"], {name for name, one in sections.items() if one is not None}, False
    for body in fields["directions"]:
        axes = next((n for n in (3, 2, 1) if set("xyz"[:n]) <= body.keys()), 0)
        corners = (
            body_cells(fields["connections"], len(mask), body, axes) if axes else np.empty((0, 1), dtype=np.int64)
        )
        inside = np.asarray(mask[corners].all(axis=1))
        if not inside.any():
            continue
        found, name = True, {1: "area", 2: "thickness"}.get(axes)
        section = 1.0
        if name is not None:
            if sections[name] is None:
                what = {1: "a chain", 2: "a sheet"}[axes]
                raise ValueError(f"{name} is None; for a part of {what} it must be a number above 0")
            section, unused = checks.positive(name, sections[name]), unused - {name}
        part = _part_of(fields, body, corners[inside], material, section)
        for span, pairs in corner_pairs(axes).items():
            if span > len(part.stiffness):
                break
            number = connection_of(fields["connections"], corners[:, pairs])
            k = part.stiffness[span - 1]
            _replace(new["stiffness"], number, inside, k)
            _replace(new["damping"], number, inside, part.time * k)
        _replace(new["mass"], corners, inside, part.mass)
        volume = fields["rest_length"][body["x"]][0] ** axes
        cells = _with_cells(cells, corners[inside], part, volume)
    if not found:
        raise ValueError(
            "selection has no whole cell of a lattice; it must have all corners of one at least (bodies made by "
            "shell, rod, viscoelastic or System have none)"
        )
    for name in unused:
        raise ValueError(f"{name} is {sections[name]!r}; for this part of the body it must be left out")
    return {**new, "cells": cells}


def _part_of(
    fields: Mapping[str, Any],
    body: Mapping[str, slice],
    corners: NDArray[np.int64],
    material: Material,
    section: float,
) -> CellPart:
    """Return what each of these cells of a body contributes; raise ValueError if no material fits the body."""
    if any("2" in name for name in body):
        raise ValueError(
            "selection has part of a sheet with bending, whose springs are in equilibrium with each other; "
            "make it without bending"
        )
    angles, position = fields["angles"], fields["position"]
    if angles is not None and mask_of(corners, len(position))[angles.particles].any():
        raise ValueError("selection has part of a rod, whose angles would keep their stiffness; make it a chain")
    names = [name for name in "xyz" if name in body]
    for name in names:
        first = fields["connections"][body[name], 0]
        if len(np.unique(first)) < len(first):
            raise ValueError(
                "selection has part of a body whose neighbouring cells are apart; make it by voxels again"
            )
    length = np.concatenate([fields["original_length"][body[name]] for name in names])
    spacing = float(length[0])
    if np.ptp(length) > _EQUAL * spacing:
        raise ValueError(
            f"the body's cells have sides of {length.min():g} to {length.max():g} m; for a material all must be "
            "equal, since a Material's stiffness is derived for such cells"
        )
    axes, longest = len(names), 0.0
    for name in names:  # extents along the lattice's own axes, in case the body is rotated
        i, j = fields["connections"][body[name]].T
        axis = (position[j] - position[i]).mean(axis=0)
        along = position[np.union1d(i, j)] @ (axis / np.linalg.norm(axis))
        longest = max(longest, float(np.ptp(along)))
    diagonals = axes > 1 and "x+y" in body
    if axes > 1 and not diagonals and material.poissons_ratio is not None:
        raise ValueError(
            f"material has poissons_ratio={material.poissons_ratio:g}; it needs a body with diagonals: without "
            "them nothing resists shear"
        )
    return cell_part(material, axes, spacing, section, longest, diagonals=diagonals)


def _replace(values: NDArray, number: NDArray[np.integer], inside: NDArray[np.bool_], each: float) -> None:
    """Let cells `inside` contribute `each` to the values at their numbers, shape [cell_count, any], −1 for none.

    What a value had before counts as that of the cells around it in equal parts.
    """
    there = number >= 0
    around = np.bincount(number[there], minlength=len(values))
    new = np.bincount(number[inside][there[inside]], minlength=len(values))
    changed = (new > 0) & np.isfinite(values)  # pinned particles stay
    values[changed] *= 1 - new[changed] / around[changed]
    values[changed] += each * new[changed]


def _with_cells(cells: Cells | None, corners: NDArray[np.int64], part: CellPart, volume: float) -> Cells | None:
    """Return the cells of a system in which those with these corners are of a material."""
    wide = np.full((len(corners), CORNERS), NONE, dtype=np.int64)
    wide[:, : corners.shape[1]] = corners
    numbers = {"rest_volume": volume, "modulus": part.modulus, "damping": part.damping}
    added = {name: np.full(len(wide), one) for name, one in numbers.items()}
    kept: Any = slice(0)
    if cells is not None:
        _, row = np.unique(np.concatenate([cells.corners, wide]), axis=0, return_inverse=True)
        kept = ~np.isin(row[: len(cells)], row[len(cells) :])
    if part.modulus == 0.0:
        wide, added = wide[:0], {name: one[:0] for name, one in added.items()}
    if cells is None:
        return Cells(corners=wide, **added) if len(wide) else None
    every = np.concatenate([cells.corners[kept], wide])
    if not len(every):
        return None
    order = np.argsort(every[:, 0], kind="stable")
    values = {name: joined(getattr(cells, name)[kept], one)[order] for name, one in added.items()}
    return Cells(corners=every[order], **values)
