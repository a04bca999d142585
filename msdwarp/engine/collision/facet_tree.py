"""The tree of boxes around facets, on the host: see `kernels.collision.facet_tree`."""

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ...kernels.collision.facet_tree import FacetTree
from ...kernels.lanes import WARP

WIDTH = WARP
"""Facets in a leaf of the tree, and leaves in a group: the threads of a warp test them together."""


def facet_tree(order: NDArray[np.integer], owner: NDArray[np.int32], bodies: int, device: Any) -> Any:
    """Return the tree of facets in the given order, body after body; kernels compute its boxes.

    `owner` has the body of each facet.
    """
    tree = FacetTree()
    first, last, body = runs(owner[order], WIDTH)
    first_leaf, last_leaf, of_group = runs(body, WIDTH)
    group = np.repeat(np.arange(len(of_group)), last_leaf - first_leaf)
    tree.facet = wp.array(order, dtype=int, device=device)
    tree.leaf = wp.array(np.stack([body, group, first, last], axis=1), dtype=wp.vec4i, device=device)
    tree.group = wp.array(np.stack([first_leaf, last_leaf], axis=1), dtype=wp.vec2i, device=device)
    tree.first_group = wp.array(np.searchsorted(of_group, np.arange(bodies + 1)), dtype=int, device=device)
    counts = {"": len(order), "leaf_": len(body), "group_": len(of_group), "body_": bodies, "near_": bodies}
    for name, count in counts.items():
        for side in ("lower", "upper"):
            setattr(tree, name + side, wp.zeros(count, dtype=wp.vec3, device=device))
    tree.root = wp.zeros(bodies, dtype=int, device=device)
    return tree


def near_together(x: NDArray[np.floating], owner: NDArray[np.integer]) -> NDArray[np.int64]:
    """Return an order of the points x, owner after owner, in which `WIDTH` consecutive points fill a small box.

    Points are halved recursively across their greatest extent. Along a space-filling curve some consecutive points
    are far apart: one box in a flat cloth overlapped 200 others, and all threads waited for its search.
    """
    found: list[NDArray[np.int64]] = []
    by_owner = np.argsort(owner, kind="stable")
    left = np.split(by_owner, np.flatnonzero(np.diff(owner[by_owner])) + 1)[::-1]
    while left:
        those = left.pop()
        if len(those) <= WIDTH:
            found.append(those)
            continue
        half = WIDTH << (len(those) - 1).bit_length() - WIDTH.bit_length()
        parts = np.argpartition(x[those, np.ptp(x[those], axis=0).argmax()], half)
        left += [those[parts[half:]], those[parts[:half]]]
    return np.concatenate(found)


def runs(owner: NDArray[np.integer], width: int) -> tuple[NDArray[np.integer], ...]:
    """Return runs of at most `width` items of one owner: (first items, ends, owners); `owner` is sorted."""
    begins = np.flatnonzero(np.diff(owner, prepend=-1))
    ends = np.append(begins[1:], len(owner))
    firsts = np.concatenate([np.arange(a, b, width) for a, b in zip(begins, ends, strict=True)] or [begins])
    lasts = np.minimum(firsts + width, ends[np.searchsorted(begins, firsts, side="right") - 1])
    return firsts, lasts, owner[firsts]
