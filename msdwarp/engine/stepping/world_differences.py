"""Differences between the worlds of an ensemble, for kernels, and the number of threads per world."""

from typing import Any

from ... import checks
from ...kernels.effect import ForceTerm
from ...kernels.integrators.differences import Differences
from ..springs.fracture import Fracture
from ..springs.spring_constants_by_world import EnsembleForces
from .assemble import Assembly

MOST_IN_BLOCK = {"float32": 1024, "float32-compensated": 1024, "float64": 512}
"""Threads per block, and per multiprocessor, for which the registers suffice."""
FEW_WORLDS_BLOCK, MANY_WORLDS_BLOCK = 1024, 512
"""Threads of the largest block: if each world has its own multiprocessor, and if there are more worlds."""
MOST_IN_SMALL_WORLD, MOST_IN_WORLD = 512, 4096
"""Larger worlds use a launch per stage: limits [particles] for few worlds and for many."""


def differences(assembly: Assembly, forces: EnsembleForces) -> Differences:
    """Return the differences between worlds: parameters of the system, and arrays of effects for each world."""
    rows, arrays = assembly.model.rows, list[str]()
    for effect in assembly.all:
        field = effect.term.field if isinstance(effect.term, ForceTerm) else "colliders"
        if isinstance(effect, Fracture):
            field, arrays = "forces.breaking", [*arrays, f"forces.{effect.joined_field}"]
        arrays += [f"{field}.{name}" for name in effect.by_world]
    return Differences(
        gravity="gravity" in rows,
        mass="mass" in rows,
        friction="friction" in rows,
        storage=forces.storage,
        arrays=tuple(arrays),
        **forces.how,
    )


def fill_world_data(data: Any, assembly: Assembly, forces: EnsembleForces, frozen: Any) -> None:
    """Write the differences between worlds to `data`; `frozen` is the status of each world, see `Dynamics`."""
    model = assembly.model
    data.stride, data.frozen = model.stride_in_bytes, frozen
    if "gravity" in model.rows:
        data.gravity = model.table("gravity")
    if "mass" in model.rows:
        data.inverse_mass = model.table("inverse_mass")
    if "friction" in model.rows:
        data.friction = model.upload_rows(model.rows["friction"])
    for name, array in forces.fields.items():
        setattr(data, name, array)
    if assembly.body_contact is not None:
        data.unit = assembly.body_contact.units


def threads_at_a_time(assembly: Assembly) -> int:
    """Return the number of threads per multiprocessor, half as many with solid obstacles, which take registers."""
    solids = assembly.colliders is not None and not assembly.colliders.planes_only
    return MOST_IN_BLOCK[assembly.model.precision] // (2 if solids else 1)


def threads_of_world(assembly: Assembly, threads: Any) -> int | None:
    """Return the number of threads for one launch of all substeps of a world; None for a launch per stage.

    `threads` is the requested number, None or "auto". Raises ValueError for a number that is not possible.
    """
    model, launches_between = assembly.model, any(one.precedes for one in assembly.all)
    if isinstance(threads, str):
        checks.one_of("threads", threads, ("auto",))
    elif threads is not None:
        if launches_between:
            raise ValueError(f"threads is {threads}; it must be 'auto' or None where bodies touch")
        most = MOST_IN_BLOCK[model.precision] if model.device.is_cuda else 1
        if checks.count("threads", threads, 1) > most or threads != 1 << (threads - 1).bit_length():
            raise ValueError(f"threads is {threads}; it must be 'auto', None, or a power of 2 up to {most} here")
        return threads
    if threads is None or launches_between:
        return None
    if not model.device.is_cuda:
        return 1
    many = 2 * model.worlds >= model.device.sm_count
    if model.particle_count > (MOST_IN_WORLD if many else MOST_IN_SMALL_WORLD):
        return None
    most = FEW_WORLDS_BLOCK if model.worlds <= model.device.sm_count else MANY_WORLDS_BLOCK
    return min(power_of_two(model.particle_count), most, threads_at_a_time(assembly))


def power_of_two(threads: int) -> int:
    """Round up to a power of two, at least 32, since each number of threads needs a compiled kernel."""
    return max(32, 1 << (threads - 1).bit_length())
