"""Frames of a simulation, copied to the host while it continues."""

import queue
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from .. import checks
from ..bodies import Frame
from ..engine import Model, write_in_order, write_strain
from ..runtime import CAPTURE_LOCK, ReleasedInTurn, in_turn
from .simulation import Simulation


class Readback(ReleasedInTurn):
    """Copies frames of a simulation to the host while it continues.

    On a GPU a frame is first copied on the device, before the simulation overwrites it; this copy is sent to the
    host on a separate stream. On the CPU a frame is copied once.

    Parameters
    ----------
    simulation
        The simulation to copy from. It may be changed, reset and restored meanwhile.
    strain
        Whether to include the strain of every connection.
    contact_forces
        Whether to include the contact force on each particle, which `Simulation(contact_forces=True)` computes.
    depth
        Maximal number of frames in transfer at a time: each has its own buffers on the device and on the host,
        allocated here.

    Raises
    ------
    ValueError
        If `simulation` is no Simulation, `depth` is not a whole number of at least 1, or contact forces are
        requested and the simulation does not sum them.
    """

    @in_turn
    def __init__(
        self, simulation: Simulation, *, strain: bool = True, contact_forces: bool = False, depth: int = 6
    ) -> None:
        checks.instance("simulation", simulation, Simulation, "Simulation(chain(5))")
        checks.count("depth", depth, 1)
        if contact_forces and simulation.stepping.contact_forces is None:
            raise ValueError("contact_forces is True; the simulation must be made with contact_forces=True then")
        self._simulation, self._strain, self._contact_forces = simulation, strain, contact_forces
        device = simulation.model.device
        self._stream = wp.Stream(device) if device.is_cuda else None
        self._order: wp.array | None = None
        self._ordered_model: Model | None = None
        self._free = _Free()
        for _ in range(depth):
            self._free.put(_Buffers(simulation.model, strain, contact_forces))

    def take(self) -> "Taken":
        """Return the current frame, still in transfer to the host; wait while `depth` frames are in use."""
        return self._taken(self._free.get())

    @in_turn
    def _taken(self, buffers: "_Buffers | None") -> "Taken":
        """Start the copy of the current frame, into new buffers if None are given."""
        if buffers is None:
            buffers = _Buffers(self._simulation.model, self._strain, self._contact_forces)
        stepping = self._simulation.stepping  # read again, because a change of the simulation replaces it
        state = stepping.state
        arrays = buffers.on_device
        wp.copy(arrays["position"], state.x)
        wp.copy(arrays["velocity"], stepping.velocity())
        if stepping.model.compensated:
            wp.copy(arrays["position_compensation"], state.compensation.x)
            wp.copy(arrays["velocity_compensation"], state.compensation.v)
        if self._strain:
            write_strain(stepping.assembly, state, self._order_of(stepping.model), arrays["strain"])
        fracture = stepping.assembly.fracture
        if fracture is not None and "broken_at" in arrays:
            write_in_order(fracture.broken_at, self._order_of(stepping.model), arrays["broken_at"])
        if self._contact_forces and stepping.contact_forces is not None:
            stepping.contact_forces.write_force(arrays["contact_force"])
        if self._stream is not None:
            buffers.send(self._stream)
        return Taken(self._simulation, buffers, self._free)

    def _order_of(self, model: Model) -> wp.array | None:
        """Return the index in the system of each connection on the device; None if the order is the same."""
        if model is not self._ordered_model:
            self._ordered_model, order = model, model.order
            self._order = None if order is None else wp.array(order, dtype=int, device=model.device)
        return self._order


class Taken:
    """A frame in transfer to the host, in a buffer of the readback."""

    def __init__(self, simulation: Simulation, buffers: "_Buffers", free: "_Free") -> None:
        self._time, self._buffers, self._free = simulation.time, buffers, free
        self.substeps = simulation.substeps
        """Substeps per frame in this frame; at time 0, in the first frame."""
        self._released = False

    def arrived(self) -> tuple[Frame, NDArray | None]:
        """Wait for the frame, in any thread; return it, as `Simulation.frame` does, and the strain.

        The strain of the system's connections, shape [connection_count], is computed in float64 from the device's
        arrays, and rounded to the simulation's precision; None if not requested. After `release` later frames
        overwrite these arrays. Raises RuntimeError if the device has failed meanwhile.
        """
        self._buffers.wait()
        arrays = self._buffers.on_host
        position, velocity = arrays["position"], arrays["velocity"]
        if "position_compensation" in arrays:  # subtract the rounding errors of sums
            position = position.astype(np.float64) - arrays["position_compensation"]
            velocity = velocity.astype(np.float64) - arrays["velocity_compensation"]
        return Frame(self._time, position, velocity), arrays.get("strain")

    def broken_at(self) -> NDArray | None:
        """Wait for the frame, and return the times at which connections had broken [s]; None if none can break.

        Shape [connection_count], inf for unbroken connections. After `release` later frames overwrite the array.
        """
        self._buffers.wait()
        return self._buffers.on_host.get("broken_at")

    def contact_force(self) -> NDArray | None:
        """Wait for the frame, and return the contact force on each particle [N]; None if not requested.

        Equal to `Simulation.contact_force` after this frame, shape [particle_count, d]. After `release` later
        frames overwrite the array.
        """
        self._buffers.wait()
        return self._buffers.on_host.get("contact_force")

    def release(self) -> None:
        """Release the memory for a later frame; further calls do nothing."""
        if not self._released:
            self._released = True
            self._free.put(self._buffers)

    def __del__(self) -> None:
        """Make room for another frame; arrays of this one that are still in use are not overwritten."""
        if not self._released:
            self._free.put(None)


class _Free:
    """Buffers that are free, last in, first out: on the CPU, unused buffers are then never allocated.

    The queue counts frames. Unlike that of `queue.LifoQueue` its `put` may be called by a finalizer at any moment.
    """

    def __init__(self) -> None:
        self._buffers, self._frames = list[_Buffers](), queue.SimpleQueue[None]()

    def put(self, buffers: "_Buffers | None") -> None:
        """Let another frame in; None if its buffers must be made."""
        if buffers is not None:
            self._buffers.append(buffers)
        self._frames.put(None)

    def get(self) -> "_Buffers | None":
        """Wait until another frame may come, and return its buffers; None if they must be made."""
        self._frames.get()
        try:
            return self._buffers.pop()
        except IndexError:  # those of a dropped frame
            return None


class _Buffers(ReleasedInTurn):
    """Buffers for a frame, on the device and on the host; on the CPU both are the same."""

    def __init__(self, model: Model, strain: bool, contact_forces: bool) -> None:
        n, device = model.particle_count, model.device
        kinds: dict[str, tuple[int, Any]] = {"position": (n, model.vector), "velocity": (n, model.vector)}
        if model.compensated:
            kinds |= {f"{name}_compensation": kind for name, kind in kinds.items()}
        if contact_forces:
            kinds["contact_force"] = (n, model.vector)
        if strain:
            kinds["strain"] = (model.connection_count, model.scalar)
        if model.system.tears:
            kinds["broken_at"] = (model.connection_count, wp.float32)
        self.on_device = {name: wp.empty(*kind, device=device) for name, kind in kinds.items()}
        self._host = self.on_device
        if device.is_cuda:  # only copies to pinned memory can run in parallel with kernels
            self._host = {name: wp.empty(*kind, device="cpu", pinned=True) for name, kind in kinds.items()}
            self._complete, self._sent = wp.Event(device), wp.Event(device)
        self.on_host = {name: array.numpy() for name, array in self._host.items()}

    def send(self, stream: wp.Stream) -> None:
        """Start the copy to the host on `stream`, after the device's own stream has written everything."""
        stream.device.stream.record_event(self._complete)
        stream.wait_event(self._complete)
        for name, array in self.on_device.items():
            wp.copy(self._host[name], array, stream=stream)
        stream.record_event(self._sent)

    def wait(self) -> None:
        """Wait until everything is on the host."""
        if self._host is not self.on_device:
            with CAPTURE_LOCK:
                wp.synchronize_event(self._sent)
