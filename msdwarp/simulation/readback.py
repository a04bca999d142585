"""Frames of a simulation, copied to the host while it goes on."""

import queue
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from .. import checks
from ..bodies import Frame
from ..engine import Model, write_in_order, write_strain
from ..runtime import in_turn
from .pinned_staging import CAPTURE_LOCK
from .simulation import Simulation


class Readback:
    """Copies frames of a simulation to the host while it goes on.

    On a GPU a frame is first copied there, before the simulation writes over it; from that copy it goes to the
    host on a stream of its own. On the CPU it is copied at once.

    Parameters
    ----------
    simulation
        What is copied. It may be changed, reset and restored meanwhile.
    strain
        Whether the strain of every connection comes with it.
    contact_forces
        Whether to include the contact force on each particle, which `Simulation(contact_forces=True)` computes.
    depth
        Frames that may be on their way at a time: each has room of its own, allocated here, on the device and
        on the host.

    Raises
    ------
    ValueError
        If `depth` is not a whole number of at least 1, or the simulation sums no contact forces and they are
        asked for.
    """

    @in_turn
    def __init__(
        self, simulation: Simulation, *, strain: bool = True, contact_forces: bool = False, depth: int = 6
    ) -> None:
        checks.count("depth", depth, 1)
        if contact_forces and simulation.stepping.contact_forces is None:
            raise ValueError("contact_forces is True; the simulation must be made with contact_forces=True then")
        self._simulation, self._strain, self._contact_forces = simulation, strain, contact_forces
        device = simulation.model.device
        self._stream = wp.Stream(device) if device.is_cuda else None
        self._place: wp.array | None = None
        self._placed: Model | None = None
        # What was released last is taken first: on the CPU, memory that is never touched is never there.
        self._free: queue.LifoQueue[_Room] = queue.LifoQueue()
        for _ in range(depth):
            self._free.put(_Room(simulation.model, strain, contact_forces))

    def take(self) -> "Taken":
        """Return the present frame, which is on its way; wait while `depth` others have not been released."""
        room = self._free.get()
        self._fill(room)
        return Taken(self._simulation, room, self._free)

    @in_turn
    def _fill(self, room: "_Room") -> None:
        """Have the present frame copied."""
        stepping = self._simulation.stepping  # anew each time: what changes a simulation replaces it
        state = stepping.state
        wp.copy(room.here["position"], state.x)
        wp.copy(room.here["velocity"], stepping.velocity())
        if stepping.model.compensated:
            wp.copy(room.here["position_lost"], state.compensation.x)
            wp.copy(room.here["velocity_lost"], state.compensation.v)
        if self._strain:
            write_strain(stepping.assembly, state, self._place_in(stepping.model), room.here["strain"])
        fracture = stepping.assembly.fracture
        if fracture is not None and "broken_at" in room.here:
            write_in_order(fracture.broken_at, self._place_in(stepping.model), room.here["broken_at"])
        if self._contact_forces and stepping.contact_forces is not None:
            stepping.contact_forces.write_force(room.here["contact_force"])
        if self._stream is not None:
            room.send(self._stream)

    def _place_in(self, model: Model) -> wp.array | None:
        """Return, for each connection on the device, its number in the system; None where it is the same."""
        if model is not self._placed:
            self._placed, order = model, model.order
            self._place = None if order is None else wp.array(order, dtype=int, device=model.device)
        return self._place


class Taken:
    """A frame on its way to the host; its memory is the readback's."""

    def __init__(self, simulation: Simulation, room: "_Room", free: "queue.LifoQueue[_Room]") -> None:
        self._time, self._room, self._free = simulation.time, room, free
        self.substeps = simulation.substeps
        """How many the frame took, or of the first one is to take."""
        self._released = False

    def arrived(self) -> tuple[Frame, NDArray | None]:
        """Wait for it, in any thread, and return it: the same as `Simulation.frame` returned at its time.

        The arrays are overwritten by a later frame once this one has been released.

        Returns
        -------
        frame
            Time [s], positions [m] and velocities [m/s], shape [particle_count, d] each.
        strain
            Length / rest length − 1 of the system's connections, shape [connection_count]: computed in float64
            from the device's numbers, and rounded to the simulation's. None where it was not asked for.

        Raises
        ------
        RuntimeError
            If the device has failed meanwhile.
        """
        self._room.wait()
        there = self._room.there
        position, velocity = there["position"], there["velocity"]
        if "position_lost" in there:  # what sums have lost belongs to them
            position = position.astype(np.float64) - there["position_lost"]
            velocity = velocity.astype(np.float64) - there["velocity_lost"]
        return Frame(self._time, position, velocity), there.get("strain")

    def broken_at(self) -> NDArray | None:
        """Wait for it, and return when connections had broken by then [s]; None where none can break.

        It is inf where they were whole, shape [connection_count]. As for `arrived`, the array is overwritten once
        this one has been released.
        """
        self._room.wait()
        return self._room.there.get("broken_at")

    def contact_force(self) -> NDArray | None:
        """Wait for it, and return the contact force on each particle [N]; None if it was not requested.

        It is what `Simulation.contact_force` returned at its time, shape [particle_count, d]. As for `arrived`,
        the array is overwritten once this one has been released.
        """
        self._room.wait()
        return self._room.there.get("contact_force")

    def release(self) -> None:
        """Give its memory back, for a frame to come; it may be called again."""
        if not self._released:
            self._released = True
            self._free.put(self._room)


class _Room:
    """Memory for a frame, on the device and on the host; on the CPU both are one."""

    def __init__(self, model: Model, strain: bool, contact_forces: bool) -> None:
        n, device = model.particle_count, model.device
        kinds: dict[str, tuple[int, Any]] = {"position": (n, model.vector), "velocity": (n, model.vector)}
        if model.compensated:
            kinds |= {f"{name}_lost": kind for name, kind in kinds.items()}
        if contact_forces:
            kinds["contact_force"] = (n, model.vector)
        if strain:
            kinds["strain"] = (model.connection_count, model.scalar)
        if model.system.tears:
            kinds["broken_at"] = (model.connection_count, wp.float32)
        self.here = {name: wp.empty(*kind, device=device) for name, kind in kinds.items()}
        self._host = self.here
        if device.is_cuda:  # copies run beside kernels only into memory that is pinned
            self._host = {name: wp.empty(*kind, device="cpu", pinned=True) for name, kind in kinds.items()}
            self._complete, self._sent = wp.Event(device), wp.Event(device)
        self.there = {name: array.numpy() for name, array in self._host.items()}

    def send(self, stream: wp.Stream) -> None:
        """Have `stream` copy what the device's own stream writes here to the host."""
        stream.device.stream.record_event(self._complete)
        stream.wait_event(self._complete)
        for name, array in self.here.items():
            wp.copy(self._host[name], array, stream=stream)
        stream.record_event(self._sent)

    def wait(self) -> None:
        """Wait until all is on the host."""
        if self._host is not self.here:
            with CAPTURE_LOCK:
                wp.synchronize_event(self._sent)
