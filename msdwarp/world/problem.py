"""Problem: bodies and what surrounds them, as a simulation starts from them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from .. import checks
from ..bodies import System
from .colliders import Collider, check_colliders
from .contact import Contact
from .drives import bound
from .gravity import Gravity, gravity_at
from .loads import Load, check_loads
from .probes import Probe, checked_probes
from .schedule import Change


@dataclass(frozen=True, kw_only=True, eq=False)
class Problem:
    """Bodies and what surrounds them: what is simulated of a `Scene`, whose docstring has the fields.

    It travels whole from the user to `engine.stepping.assemble`. What it holds has been checked: the kinds and the
    numbers of coordinates, that each load can act on the system and each probe measure it. Raises ValueError
    otherwise.
    """

    system: System = field(kw_only=False)
    colliders: Sequence[Collider] = ()
    loads: Sequence[Load] = ()
    contact: Contact | Sequence[Contact] | None = None
    gravity: Gravity = 9.82
    schedule: Sequence[Change] = ()
    probes: Mapping[str, Probe] = field(default_factory=dict)
    shape: ArrayLike | None = None

    def __post_init__(self) -> None:
        several = isinstance(self.system, list | tuple)
        checks.instance("system", self.system, System, "a + b, or sum([a, b])" if several else "chain(5)")
        kinds = (
            ("colliders", Collider, "Plane()"),
            ("loads", Load, "Force((0, 0, 1))"),
            ("schedule", Change, "at(1.0, mass=2.0)"),
        )
        for name, kind, example in kinds:
            if not isinstance(getattr(self, name), Ruled):  # checked already in the original scene
                object.__setattr__(self, name, checks.sequence(name, getattr(self, name), kind, example))
        object.__setattr__(self, "loads", self._loads_and_contact())
        dim = self.system.dim
        check_colliders(self.colliders, dim)
        check_loads(self.loads, self.system)
        bound(self.loads, self.system)
        object.__setattr__(self, "gravity", checks.as_now(self.gravity))
        gravity_at(self.gravity, np.zeros(1), dim)
        probes = {} if self.probes is None else self.probes
        object.__setattr__(self, "probes", checked_probes(probes, self.system, self.colliders, self.loads))
        if self.shape is not None:
            shape = checks.finite("shape", self.shape)
            object.__setattr__(self, "shape", checks.broadcast("shape", shape, self.system.position.shape))

    def _loads_and_contact(self) -> Ruled:
        """Return the loads without contact rules, followed by those of `contact`.

        Raises ValueError if a load is a bare `Load`, or a `Contact` that was not given as `contact`.
        """
        for k, one in enumerate(self.loads):
            if type(one) is Load:
                raise ValueError(
                    f"loads[{k}] is a Load, which does nothing; it must be one such as Force((0, 0, 1))"
                )
            if self.contact is None and isinstance(one, Contact) and not isinstance(self.loads, Ruled):
                raise ValueError(
                    f"loads[{k}] is a Contact; rules of contact are given by contact, such as contact=Contact()"
                )
        if isinstance(self.contact, bool):
            raise ValueError(
                f"contact is {self.contact}; it must be a Contact, such as Contact(), several, or None"
            )
        given = (
            (self.contact,) if isinstance(self.contact, Contact) else () if self.contact is None else self.contact
        )
        rules = checks.sequence("contact", given, Contact, "Contact(friction=0.5)")
        if not (self.contact is None or isinstance(self.contact, Contact)):
            object.__setattr__(self, "contact", tuple(rules))  # it may be an iterator, or a list that changes
        return Ruled((*(one for one in self.loads if not isinstance(one, Contact)), *rules))

    def replace(self, **changes: Any) -> Self:
        """Return this scene with some fields changed, and checked as in a new scene.

        Raises ValueError as the class does, and TypeError for an unknown field.
        """
        for name in changes:
            if name not in vars(self):
                raise TypeError(f"{type(self).__name__}.replace() got an unexpected keyword argument {name!r}")
        return replace(self, **changes)

    def with_checked(self, **fields: Any) -> Self:
        """Return this scene with other fields that are known to fit, which takes no time."""
        made = copy(self)
        vars(made).update(fields)
        return made

    def begun(self) -> Self:
        """Return the problem with the loads and the shape for contact bound to the state of its system.

        They stay so if the system is replaced later; loads that are bound already stay as they are.
        """
        shape = self.system.position if self.shape is None else self.shape
        return self.with_checked(loads=Ruled(bound(self.loads, self.system)), shape=shape)

    @property
    def loads_as_given(self) -> Ruled:
        """The loads as the user gave them, where they are bound."""
        return Ruled(one.given or one for one in self.loads)

    @property
    def contact_rules(self) -> list[Contact]:
        """The rules of contact between bodies."""
        return [one for one in self.loads if isinstance(one, Contact)]

    @property
    def rigid_colliders(self) -> list[Collider]:
        """The obstacles that no particle enters."""
        return [one for one in self.colliders if one.stiffness is None]

    def measures(self, *quantities: str) -> bool:
        """Return whether a probe measures one of these quantities."""
        return any(one.what in quantities for one in self.probes.values())


class Ruled(tuple[Load, ...]):
    """Loads of a problem; each `Contact` among them came from the argument `contact`."""
