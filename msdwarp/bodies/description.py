"""What a system is, in a few lines of text: how much there is of it, never its arrays."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from .dampers import LINEAR
from .uniform import stored

if TYPE_CHECKING:
    from .system import System

_NAMED = 4
"""Groups that are named; of more it is said how many there are."""


def headline(system: "System") -> str:
    """Return in a line how large a system is."""
    particles = f"{counted(system.particle_count, 'particle')} in {counted(system.dim, 'dimension')}"
    return f"System of {particles}, {counted(system.connection_count, 'connection')}"


def description(system: "System") -> str:
    """Return in up to five lines what a system is."""
    low, high = system.position.min(axis=0), system.position.max(axis=0)
    extent = " × ".join(f"{edge:.4g}" for edge in high - low)
    corner = ", ".join(f"{edge:.4g}" for edge in low)
    lines = [headline(system), f"extent {extent} m, lowest corner ({corner}) m"]
    pinned = int(system.pinned.sum())
    free = float(np.where(system.pinned, 0.0, system.mass).sum())
    masses = [f"mass {free:.4g} kg"] if pinned < system.particle_count else []
    lines.append(", ".join(masses + ([f"{counted(pinned, 'particle')} pinned"] if pinned else [])))
    if system.connection_count:
        linear = system.damper == LINEAR
        forces = [f"stiffness {span(system.stiffness)} N/m"]
        forces += [f"damping {span(system.damping)}{' N s/m' if linear else f' by {system.damper!r}'}"]
        forces += [f"yields beyond a strain of {span(system.yield_strain)}"] if system.yields else []
        broken = int(system.broken.sum()) if system.tears else 0
        forces += [f"{counted(broken, 'connection')} broken"] if broken else []
        forces += ["tears"] if system.tears and not broken else []
        lines.append(", ".join(forces))
    if system.groups:
        groups = [f"{name} ({len(particles)})" for name, particles in list(system.groups.items())[:_NAMED]]
        more = len(system.groups) - len(groups)
        lines.append(f"groups: {', '.join(groups)}" + (f" and {more} more" if more else ""))
    return "\n  ".join(lines)


def counted(count: int, what: str) -> str:
    """Return so many of something, such as "1 particle"."""
    return f"{count} {what}" if count == 1 else f"{count} {what}s"


def span(values: NDArray[np.float64]) -> str:
    """Return the least and the greatest of some numbers, or the one that all are."""
    least, most = (float(of(stored(values))) for of in (np.min, np.max))
    return f"{least:.4g}" if least == most else f"{least:.4g} to {most:.4g}"
