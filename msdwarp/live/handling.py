"""Handling: what is done by hand to a simulation as it runs, noted so that it can be done again."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import checks
from ..bodies import uniform_like
from ..simulation import Simulation
from ..world import Contact, MouseSpring, Scene, Wind

SCALED = ("mass", "stiffness", "damping", "rest_length")
"""What is handled as a multiple of what the scene has."""
SIDES, ROUGH = ("obstacles", "bodies"), ("friction", "restitution")
"""Between what there is contact: with obstacles, or of bodies with each other; and what can be set of it."""
Deed = dict[str, Any]
"""Something done: in which frame, what, and with which numbers, as JSON has them."""


def within_reach(scene: Scene) -> Scene:
    """Return a scene in which a hand can take hold of the body: as yet it holds nobody."""
    return replace(scene, loads=(*scene.loads, MouseSpring()))


class Handling:
    """A simulation, and what is done to it by hand.

    Parameters
    ----------
    scene
        What is simulated: one that `within_reach` returned.
    simulation
        Its simulation.

    Attributes
    ----------
    deeds
        What has been done since the start, in order.
    factors
        By how much mass, stiffness, damping and rest lengths are multiplied.
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
        """Go back to the start: what was done by hand is undone."""
        self.simulation.reset()
        self._begin()

    def do(self, deed: str, **values: Any) -> None:
        """Do something, and note it.

        Parameters
        ----------
        deed
            "scale" (name, factor), "freeze", "gravity" (value [m/s²]), "wind" (velocity [m/s]), "hold" (particles,
            to [m], stiffness [N/m], damping [N s/m]), "pin" (particles), "contact" (side: "obstacles" or "bodies",
            name: "friction" or "restitution", value).
        values
            Its numbers, which JSON can hold.

        Raises
        ------
        ValueError
            If it is none of these, or the simulation cannot go on with it; nothing has changed then.
        """
        checks.one_of("deed", deed, DEEDS)
        DEEDS[deed](self, **values)
        self.deeds.append({"frame": self.simulation.frame_index, "deed": deed, **values})

    def _scale(self, *, name: str, factor: float) -> None:
        """Have a parameter be so many times what the scene has."""
        checks.one_of("name", name, SCALED)
        checks.positive("factor", factor)
        before = getattr(self.scene.system, name)
        values = uniform_like(before * factor, before)
        uniform = len(values) > 0 and not values.strides[0]
        held = np.isinf(self.simulation.system.mass)
        if name == "mass" and held.any():  # what was pinned on the way stays so
            values, uniform = np.where(held, np.inf, values), False
        value: Any = float(values[0]) if uniform else values
        self.simulation.change(**{name: value})
        self.factors[name] = factor

    def _freeze(self) -> None:
        """Have the body keep the form that it has."""
        self.simulation.change(set_rest_shape=True)

    def _gravity(self, *, value: Sequence[float]) -> None:
        self.simulation.change(gravity=tuple(value))
        self.gravity = tuple(value)

    def _wind(self, *, velocity: Sequence[float]) -> None:
        """Have all steady winds blow so."""
        self._take({one: replace(one, velocity=tuple(velocity)) for one in self.winds})

    def _contact(self, *, side: str, name: str, value: float) -> None:
        """Have all obstacles, or all rules of how bodies touch, have another friction or restitution."""
        checks.one_of("side", side, SIDES)
        checks.one_of("name", name, ROUGH)
        meant = self._sides(side)
        if not meant:
            raise ValueError(f"side is {side!r}; there are no such contacts in the scene")
        others = {one: replace(one, **{name: value}) for one in meant}
        if side == "bodies":
            self._take(others)
        else:
            self.simulation.change(colliders=[others[one] for one in meant])

    def _sides(self, side: str) -> list[Any]:
        """Return the obstacles, or the rules of how bodies touch each other."""
        if side == "obstacles":
            return list(self.simulation.colliders)
        return [one for one in self.loads if isinstance(one, Contact) and not one.exclude]

    def contact(self, side: str, name: str) -> float | None:
        """Return the friction or restitution that obstacles, or bodies, have; None where nothing touches."""
        values = [float(getattr(one, name)) for one in self._sides(side)]
        return values[0] if values else None

    @property
    def winds(self) -> list[Wind]:
        """The winds that blow steadily."""
        return [one for one in self.loads if isinstance(one, Wind) and not callable(one.velocity)]

    def _hold(
        self, *, particles: Sequence[int], to: Any, stiffness: Sequence[float], damping: Sequence[float]
    ) -> None:
        """Hold particles, or with none let go."""
        hand = MouseSpring(on=particles, to=to, stiffness=stiffness, damping=damping)
        self._take({one: hand for one in self.loads if isinstance(one, MouseSpring)})

    def _take(self, others: Mapping[Any, Any]) -> None:
        """Put loads in the place of others."""
        loads = [others.get(one, one) for one in self.loads]
        self.simulation.change(loads=loads)
        self.loads = loads

    def _pin(self, *, particles: Sequence[int]) -> None:
        """Have particles stay where they are."""
        self.simulation.change(group=np.asarray(particles), mass=np.inf)

    @property
    def holds(self) -> NDArray[np.int64]:
        """The particles that are held, shape [any]."""
        return next(one.on for one in self.loads if isinstance(one, MouseSpring))


DEEDS = {
    "scale": Handling._scale,
    "freeze": Handling._freeze,
    "gravity": Handling._gravity,
    "wind": Handling._wind,
    "hold": Handling._hold,
    "pin": Handling._pin,
    "contact": Handling._contact,
}
"""What can be done, by name."""


class Repeat:
    """Does again what was done by hand: each deed before the frame before which it was done.

    Parameters
    ----------
    handling
        A simulation at its start.
    deeds
        What was done.
    """

    def __init__(self, handling: Handling, deeds: Sequence[Deed]) -> None:
        self._handling = handling
        self._due = [dict(deed) for deed in deeds]

    def before_frame(self) -> None:
        """Do what is due before the next frame.

        Raises
        ------
        ValueError
            If a deed is none.
        """
        while self._due and self._due[0].get("frame", 0) <= self._handling.simulation.frame_index:
            deed = self._due.pop(0)
            try:
                values = {name: value for name, value in deed.items() if name not in ("frame", "deed")}
                self._handling.do(deed["deed"], **values)
            except (KeyError, TypeError) as error:
                raise ValueError(f"{checks.repr_short(deed)} is nothing that is done by hand: {error}") from error
