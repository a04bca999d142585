"""Model, what is constant during a frame, and State, what moves, as arrays on a device."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from . import checks
from .colliders import Plane
from .kernels.basis import vector
from .kernels.contact import NoColliders, plane_contact
from .system import System

PRECISIONS = {
    "float32": (wp.float32, np.float32),
    "float32-compensated": (wp.float32, np.float32),
    "float64": (wp.float64, np.float64),
}
CONTACT_RULES = ("coulomb", "report")


def find_device(name: str | None) -> Any:
    """Return the Warp device called `name`; by default the first CUDA device, else the CPU.

    Raises
    ------
    ValueError
        If there is no such device here; the message lists those there are.
    """
    wp.init()
    if name is None:
        return wp.get_device("cuda:0" if wp.is_cuda_available() else "cpu")
    try:
        return wp.get_device(name)
    except Exception as error:
        known = ", ".join(device.alias for device in wp.get_devices())
        raise ValueError(f"device {name!r} is not available; there is: {known}") from error


def scalar_array(values: NDArray[np.float64], scalar: Any, device: Any) -> wp.array:
    """Upload numbers; what is one constant everywhere takes one number of memory (a stride-0 view)."""
    if len(values) > 1 and values.strides == (0,):
        one = wp.full(1, scalar(values[0]), dtype=scalar, device=device)
        view = wp.array(
            ptr=one.ptr, dtype=scalar, shape=len(values), strides=(0,), device=device, capacity=one.capacity
        )
        view._ref = one  # a view does not own its memory
        return view
    return wp.array(values, dtype=scalar, device=device)


class Model:
    """A system and its surroundings on a device: everything that a substep reads and never writes.

    Parameters
    ----------
    system
        What is simulated.
    gravity
        Acceleration of free fall [m/s²]: its size, downwards along the last coordinate, or a vector of
        shape [d].
    colliders
        Obstacles, in the order in which a particle meets them.
    contact
        The contact rule, "coulomb" or "report"; see `msdwarp.kernels.contact`.
    device
        A Warp device's name; by default the first CUDA device, else the CPU.
    precision
        "float32", "float32-compensated" (sums of positions and velocities keep what rounding takes away) or
        "float64".

    Raises
    ------
    ValueError
        If an argument is out of its range.
    """

    def __init__(
        self,
        system: System,
        *,
        gravity: ArrayLike = 9.82,
        colliders: Sequence[Plane] = (),
        contact: str = "coulomb",
        device: str | None = None,
        precision: str = "float32",
    ) -> None:
        checks.one_of("precision", precision, PRECISIONS)
        checks.one_of("contact", contact, CONTACT_RULES)
        self.device = find_device(device)
        self.precision = precision
        self.scalar, self.dtype = PRECISIONS[precision]
        self.dim = system.dim
        self.vector = vector(self.dim, self.scalar)
        self.particle_count = system.particle_count
        self.connection_count = system.connection_count

        self.compensated = precision == "float32-compensated"
        # What a scene lacks is not compiled.
        self.damped = bool(system.damping.any())
        self.pinned = bool(system.pinned.any())

        self.gravity = self.vector(*_gravity_vector(gravity, self.dim))
        self.inverse_mass = self._upload(_uniform(1.0 / system.mass, system.mass), "1 / mass")
        self.connections = wp.array(system.connections, dtype=wp.vec2i, device=self.device)
        self.rest_length = self._upload(system.rest_length, "rest_length")
        self.stiffness = self._upload(system.stiffness, "stiffness")
        self.damping = self._upload(system.damping, "damping")
        self.Colliders, self.colliders, self.collide = self._planes(tuple(colliders), contact)

    def check_range(self, values: NDArray[np.float64], name: str) -> None:
        """Raise ValueError if a number is too large for this precision."""
        most = float(np.finfo(self.dtype).max)
        checks.every(name, values, values <= most, f"at most {most:.2g} in {self.precision}")

    def _upload(self, values: NDArray[np.float64], name: str) -> wp.array:
        self.check_range(values, name)
        return scalar_array(values, self.scalar, self.device)

    def _planes(self, planes: tuple[Plane, ...], contact: str) -> tuple[Any, Any, Any]:
        """Return the struct type of the colliders, the struct and the contact function."""
        if not planes:
            return NoColliders, NoColliders(), None
        for k, plane in enumerate(planes):
            if not isinstance(plane, Plane):
                raise ValueError(f"colliders[{k}] is {plane!r}; it must be a Plane")
            if len(plane.normal) != self.dim:
                raise ValueError(f"colliders[{k}].normal is {plane.normal}; it must have {self.dim} coordinates")
        Planes, collide = plane_contact(self.dim, self.scalar, contact)
        data = Planes()
        normals = np.array([plane.normal for plane in planes])
        data.normal = wp.array(normals, dtype=self.vector, device=self.device)
        for name in ("offset", "restitution", "friction", "tangential_factor", "rest_speed"):
            values = np.array([getattr(plane, name) for plane in planes], dtype=np.float64)
            setattr(data, name, wp.array(values, dtype=self.scalar, device=self.device))
        return Planes, data, collide


@dataclass
class State:
    """What moves, on a device: arrays of vectors of shape [particle_count]."""

    x: wp.array
    """Positions [m]."""
    v: wp.array
    """Velocities [m/s]; between a frame's substeps at the integrator's own instants."""

    @classmethod
    def of(cls, system: System, model: Model) -> "State":
        """Upload the positions and velocities of a system."""
        model.check_range(np.abs(system.position), "position")
        model.check_range(np.abs(system.velocity), "velocity")
        arrays = (
            wp.array(values, dtype=model.vector, device=model.device)
            for values in (system.position, np.ascontiguousarray(system.velocity))
        )
        return cls(*arrays)

    def empty_vectors(self, count: int) -> tuple[wp.array, ...]:
        """Return `count` arrays of zeros, shaped as the positions are: an integrator's working memory."""
        return tuple(wp.zeros_like(self.x) for _ in range(count))


def _uniform(values: NDArray, like: NDArray) -> NDArray:
    """Keep a constant stored once: `values` as a stride-0 view where `like` is one."""
    return np.broadcast_to(values[0], values.shape) if like.strides == (0,) else values


def _gravity_vector(gravity: ArrayLike, dim: int) -> NDArray[np.float64]:
    given = checks.array("gravity", gravity)
    if not np.isfinite(given).all():
        raise ValueError(f"gravity is {gravity!r}; it must be finite")
    if given.ndim == 0:
        downwards = np.zeros(dim)
        downwards[-1] = -given
        return downwards
    if given.shape != (dim,):
        raise ValueError(f"gravity has shape {given.shape}; it must be a number or have shape ({dim},)")
    return given
