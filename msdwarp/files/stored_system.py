"""The system in a trajectory's file: arrays and names."""

import json
from collections.abc import Iterator
from dataclasses import asdict, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..bodies import (
    TEARING_FIELDS,
    Angles,
    Cells,
    Damper,
    DamperKinds,
    LawKinds,
    OwnDamper,
    OwnSpring,
    Spring,
    SpringKinds,
    Surface,
    System,
    UnknownDamper,
    UnknownSpring,
    is_uniform,
)
from .names import OWN, ROOT, load, store, store_text

_OF_USERS = OwnDamper, UnknownDamper, OwnSpring, UnknownSpring, DamperKinds, SpringKinds
DAMPERS = {law.__name__: law for law in (Damper, *Damper.__subclasses__()) if law not in _OF_USERS}
SPRINGS = {law.__name__: law for law in (Spring, *Spring.__subclasses__()) if law not in _OF_USERS}
"""The laws that a file can store, by name: all except a user's functions."""
PARTS = {"cells": Cells, "angles": Angles}


def arrays_of(system: System) -> dict[str, NDArray]:
    """Return a system's arrays by name, without those in VTK's group; uniform arrays have no first axis."""
    found = {field.name: getattr(system, field.name) for field in fields(system)}
    del found["connections"]  # stored as VTK's lines
    if system.original_length is system.rest_length:
        del found["original_length"]
    if not system.tears:
        for name in TEARING_FIELDS:
            del found[name]
    if system.surface is not None:
        found |= {f"surface/{field.name}": getattr(system.surface, field.name) for field in fields(system.surface)}
    for name in ("cells", "angles"):
        if (part := getattr(system, name)) is not None:
            found |= {f"{name}/{field.name}": getattr(part, field.name) for field in fields(part)}
    found |= {f"groups/{k}": particles for k, particles in enumerate(system.groups.values())}  # names may have a /
    laws = {name: getattr(system, name) for name in ("damper", "spring")}
    found |= {f"laws/{name}": law.kind for name, law in laws.items() if isinstance(law, LawKinds)}
    arrays = {name: values for name, values in found.items() if isinstance(values, np.ndarray)}
    return {name: values[0] if is_uniform(values) else values for name, values in arrays.items()}


def write_system(group: Any, system: System, compress: bool) -> None:
    """Write a system in its initial state."""
    group.attrs["particle_count"], group.attrs["dim"] = system.particle_count, system.dim
    bodies = [{name: (one.start, one.stop, one.step) for name, one in body.items()} for body in system.directions]
    laws = {name: _described(getattr(system, name)) for name in ("damper", "spring")}
    described = {**laws, "directions": bodies, "groups": list(system.groups)}
    store_text(group, "description", json.dumps(described))
    for name, values in arrays_of(system).items():
        store(group, f"system/{name}", np.asarray(values), compress)


def read_system(file: Any) -> System:
    """Return the system in a file."""
    group = file[OWN]
    described, part = json.loads(load(group["description"])), group["system"]
    laws = {"spring": ("Spring", {})} | described  # missing in earlier versions
    kinds = dict(_read(part["laws"])) if "laws" in part else {}
    damper = _law(laws["damper"], DAMPERS, UnknownDamper, DamperKinds, kinds.get("damper"))
    spring = _law(laws["spring"], SPRINGS, UnknownSpring, SpringKinds, kinds.get("spring"))
    arrays = dict(_read(part))
    # The stored system may be from a later frame, with overstretched springs, which `System` would refuse.
    broken_at = arrays.pop("broken_at", np.inf)
    surface = dict(_read(part["surface"])) if "surface" in part else None
    parts = {name: kind(**dict(_read(part[name]))) for name, kind in PARTS.items() if name in part}
    return System(
        **arrays,
        broken_at=0.0,
        connections=load(file[ROOT]["Lines/Connectivity"]).reshape(-1, 2),
        damper=damper,
        spring=spring,
        surface=None if surface is None else Surface(**surface),
        **parts,
        directions=tuple({name: slice(*one) for name, one in body.items()} for body in described["directions"]),
        groups={name: load(part[f"groups/{k}"]) for k, name in enumerate(described["groups"])},
    ).replace(broken_at=broken_at)


def _described(law: Any) -> tuple[str, dict[str, Any]]:
    if isinstance(law, LawKinds):
        return type(law).__name__, {"laws": [_described(one) for one in law.laws]}
    return type(law).__name__, {} if isinstance(law, (OwnSpring, OwnDamper)) else asdict(law)


def _law(described: Any, known: Any, unknown: Any, kinds: Any, kind: Any) -> Any:
    """Return the law that `_described` describes, or several, of which `kind` are those of connections."""
    name, constants = described
    if name == kinds.__name__:
        return kinds([_law(one, known, unknown, kinds, None) for one in constants["laws"]], kind)
    return known[name](**constants) if name in known else unknown()


def _read(group: Any) -> Iterator[tuple[str, Any]]:
    for name, item in group.items():
        if hasattr(item, "shape"):
            yield name, load(item)
