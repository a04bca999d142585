"""Handling: interactive changes of a running simulation, recorded so that they can be replayed."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from .. import checks
from ..bodies import uniform_like
from ..simulation import Simulation
from ..world import Contact, MouseSpring, Scene, Wind

SCALED = ("mass", "stiffness", "damping", "rest_length")
"""Parameters that are set as multiples of the scene's values."""
SIDES, ROUGH = ("obstacles", "bodies"), ("friction", "restitution")
"""Contact with obstacles or between bodies; the parameters of contact."""
DEEDS = ("scale", "freeze", "gravity", "wind", "hold", "pin", "contact")
Deed = dict[str, Any]
"""A change as JSON data: its frame, name and values."""


def within_reach(scene: Scene) -> Scene:
    """Return a scene with an additional mouse spring, which holds nothing yet."""
    return replace(scene, loads=(*scene.loads, MouseSpring()))


class Handling:
    """A simulation of a scene from `within_reach`, and its interactive changes.

    `deeds` are the changes since the start, in order; `factors` multiply the scene's parameters.
    """

    def __init__(self, scene: Scene, simulation: Simulation) -> None:
        self.scene, self.simulation = scene, simulation
        self._begin()

    def _begin(self) -> None:
        self.deeds: list[Deed] = []
        self.factors: dict[str, float] = dict.fromkeys(SCALED, 1.0)
        self.loads = list(self.scene.loads)
        self.gravity = self.scene.gravity

    def reset(self) -> None:
        """Go back to the start, before all changes."""
        self.simulation.reset()
        self._begin()

    def do(self, deed: str, **values: Any) -> None:
        """Make a change and record it; values must be JSON data.

        Deeds are "scale" (name, factor), "freeze", "gravity" (value [m/s²]), "wind" (velocity [m/s]), "hold"
        (particles, to [m], stiffness [N/m], damping [N s/m]), "pin" (particles) and "contact" (side, name, value);
        see `SCALED`, `SIDES` and `ROUGH`. ValueError is raised for any other change, or if the simulation cannot
        continue with it; then nothing has changed.
        """
        checks.one_of("deed", deed, DEEDS)
        getattr(self, f"_{deed}")(**values)
        self.deeds.append({"frame": self.simulation.frame_index, "deed": deed, **values})

    def do_due(self, deeds: list[Deed]) -> None:
        """Replay and remove the changes that precede the next frame; raise ValueError for an unknown change."""
        while deeds and deeds[0].get("frame", 0) <= self.simulation.frame_index:
            deed = deeds.pop(0)
            try:
                values = {name: value for name, value in deed.items() if name not in ("frame", "deed")}
                self.do(deed["deed"], **values)
            except (KeyError, TypeError) as error:
                raise ValueError(f"{checks.repr_short(deed)} is nothing that is done by hand: {error}") from error

    def _scale(self, *, name: str, factor: float) -> None:
        checks.one_of("name", name, SCALED)
        checks.positive("factor", factor)
        before = getattr(self.scene.system, name)
        values = uniform_like(before * factor, before)
        uniform = len(values) > 0 and not values.strides[0]
        pinned = np.isinf(self.simulation.system.mass)
        if name == "mass" and pinned.any():  # particles pinned by the user stay pinned
            values, uniform = np.where(pinned, np.inf, values), False
        value: Any = float(values[0]) if uniform else values
        self.simulation.change(**{name: value})
        self.factors[name] = factor

    def _freeze(self) -> None:
        """Make the current shape the rest shape."""
        self.simulation.change(set_rest_shape=True)

    def _gravity(self, *, value: Sequence[float]) -> None:
        self.simulation.change(gravity=tuple(value))
        self.gravity = tuple(value)

    def _wind(self, *, velocity: Sequence[float]) -> None:
        """Set the air velocity of all steady winds [m/s]."""
        self._exchange({one: replace(one, velocity=tuple(velocity)) for one in self._winds})

    def _contact(self, *, side: str, name: str, value: float) -> None:
        """Set the friction or restitution of all obstacles, or of all contacts between bodies."""
        checks.one_of("side", side, SIDES)
        checks.one_of("name", name, ROUGH)
        before = self._sides(side)
        if not before:
            raise ValueError(f"side is {side!r}; there are no such contacts in the scene")
        others = {one: replace(one, **{name: value}) for one in before}
        if side == "bodies":
            self._exchange(others)
        else:
            self.simulation.change(colliders=[others[one] for one in before])

    def _sides(self, side: str) -> list[Any]:
        """Return all obstacles, or all contacts between bodies."""
        if side == "obstacles":
            return list(self.simulation.colliders)
        return [one for one in self.loads if isinstance(one, Contact) and not one.exclude]

    def contact(self, side: str, name: str) -> float | None:
        """Return the friction or restitution of obstacles or bodies; None if there is no contact."""
        return next((float(getattr(one, name)) for one in self._sides(side)), None)

    @property
    def _winds(self) -> list[Wind]:
        return [one for one in self.loads if isinstance(one, Wind) and not callable(one.velocity)]

    @property
    def wind(self) -> tuple[float, ...] | None:
        """Air velocity of the first steady wind [m/s]; None if there is none."""
        return next((tuple(map(float, one.velocity)) for one in self._winds), None)

    def _hold(
        self, *, particles: Sequence[int], to: Any, stiffness: Sequence[float], damping: Sequence[float]
    ) -> None:
        hand = MouseSpring(on=particles, to=to, stiffness=stiffness, damping=damping)
        self._exchange({one: hand for one in self.loads if isinstance(one, MouseSpring)})

    def _exchange(self, others: Mapping[Any, Any]) -> None:
        loads = [others.get(one, one) for one in self.loads]
        self.simulation.change(loads=loads)
        self.loads = loads

    def _pin(self, *, particles: Sequence[int]) -> None:
        self.simulation.change(group=np.asarray(particles), mass=np.inf)
