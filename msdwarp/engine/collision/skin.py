"""Skin: how far searches reach beyond the distance of contact; and how often they may begin."""

from typing import Any

import warp as wp

from ...kernels.collision.vertices import FURTHER
from ..model.model import Model

LEAST_SKIN = 0.25
"""Initial and least width of the skin, as a fraction of the distance at which bodies touch."""
SKIN_BY_PATH = 2.0 * FURTHER
"""Width of the skin over the longest path of a vertex while lists should be valid; at least 2 are needed."""
WIDEST_SKIN = 0.5
"""Largest width of the skin, over the distance at which bodies touch, unless the next limit is wider."""
SPACINGS_OF_SKIN = 0.4
"""Largest width of the skin, as a fraction of the least spacing; wider means longer rows, fewer searches."""
FEW_OVERRUNS = 3
"""Frames one after the other in which vertices may move further than foreseen, before all get a wider skin."""
MOST_BETWEEN = 32
"""Substeps between two searches for which the width of the skin is chosen, within its limits."""
CHECK_EVERY = 4
"""Substeps between a GPU's decisions whether to search: a launch that depends on it takes 10 µs.

A CPU decides in every substep. So does a GPU if rarer decisions needed a skin wider than the widest.
"""
NARROWER = 0.8
"""Least width of the skin, over that in the frame before."""
ALLOWANCE, LEAST_ALLOWANCE = 0.5, 0.25
"""Further substeps for which lists must stay valid, as vertices may become faster: when lists are made, and at a
decision."""


class Skin:
    """The width of the skin, by how far vertices have moved.

    `thickest` is the largest distance at which bodies touch, `spacing` the least of particles [m].
    """

    def __init__(self, thickest: float, spacing: float, model: Model) -> None:
        self.widest, self.least = max(WIDEST_SKIN * thickest, SPACINGS_OF_SKIN * spacing), LEAST_SKIN * thickest
        """Limits of the width [m]; only vertices that move unforeseen make it wider."""
        self.width = self.least
        """The width now [m]: a list is valid until a vertex has moved by half of it."""
        self.on_device: Any = wp.full(1, self.width, dtype=model.scalar, device=model.device)
        """The same on the device, shape [1]."""
        self.check_every = self._seldom = CHECK_EVERY if model.device.is_cuda else 1
        """Substeps between decisions whether to search."""

    def holds(self, moved: float) -> bool:
        """Return whether lists stay valid if a vertex moves so far [m], beside any further slack."""
        return moved <= 0.5 * self.width

    def choose(self, path: float, near_path: float, moved: float, overruns: int) -> bool:
        """Choose both for the next frame; return whether the width changed.

        `path` is the longest path of a vertex in a substep of the last frame, `near_path` that of bodies near
        others, `moved` how far a vertex moved between two searches [m]; `overruns` is in how many frames one after
        the other a vertex moved too far.
        """
        narrowest = 2.0 * path * (CHECK_EVERY + ALLOWANCE)
        if narrowest > self.widest:
            self.check_every = 1
        elif narrowest < 0.5 * self.widest:
            self.check_every = self._seldom
        held = self.holds(moved)
        foreseen = max(MOST_BETWEEN * near_path, 0.0 if held else moved)
        wanted = min(self.widest, max(self.least, SKIN_BY_PATH * foreseen))
        if not held and overruns >= FEW_OVERRUNS:  # others each time: then all get more
            wanted = max(wanted, SKIN_BY_PATH * moved)
        if NARROWER * self.width <= wanted <= self.width:
            return False
        # It narrows over some frames: what was too fast once may soon be again, and a frame is repeated then.
        self.width = max(wanted, NARROWER * self.width)
        self.on_device.fill_(self.width)
        return True
