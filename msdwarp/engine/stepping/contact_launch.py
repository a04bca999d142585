"""ContactLaunch: one launch for all substeps of small bodies in contact, by a cluster of blocks of a GPU."""

from collections.abc import Sequence
from typing import Any

import warp as wp

from ...kernels.collision.neighbor_search import ON_GPU
from ...kernels.integrators.persistent import MOST_THREADS, persistent
from ...kernels.integrators.persistent_contact import ContactNumbers, contact_before
from ..collision.body_contact import DAMPING, BodyContact
from ..model.state import Instant
from .dynamics import Dynamics
from .persistent import CLUSTER, whole
from .stages import Stage, stages_for

AHEAD, SOON = 2.0, 3.0
"""Lists are made again unless valid for this many substeps at present speeds, one would suffice; and what is fast
may move for so many substeps when they are made."""
MOST = 2**13, 2**8, 2**11
"""Points, bodies and particles up to which a cluster may be faster than the whole GPU."""
MOST_ACTIVE = CLUSTER * MOST_THREADS // ON_GPU
"""Above this number of active points, threads would take several points in turn."""


class ContactLaunch:
    """Launches `persistent` with `contact_before`: stages, contact forces and searches in one kernel.

    It is composed of the kernels that are otherwise launched separately.
    """

    def __init__(self, dynamics: Dynamics, effect: BodyContact, stages: Sequence[Stage]) -> None:
        self._dynamics, self._effect, self._method = dynamics, effect, stages[0].method
        model, self._kept = dynamics.model, [one.step(dynamics.composition) for one in stages]
        Step = self._method(dynamics.composition).Step
        self._steps = wp.array(self._kept, dtype=Step, device=model.device).reshape((2, 1))
        self._is_compiled = False
        model.kernels.note(self._kernel()[0], block=MOST_THREADS, beside=True)

    @property
    def pays(self) -> bool:
        """Whether one launch is faster: too few points are near anything for separate launches to fill the GPU.

        False while the kernel compiles, some ten seconds beside the run; separate launches do the same until then,
        to the last bit. False if pairs are kept apart: with that in the kernel it would compile for half a minute
        and save a tenth of the time.
        """
        if self._effect.planes.awake or self._effect.neighbors.active > MOST_ACTIVE:
            return False
        if not self._is_compiled:
            kernels = self._dynamics.model.kernels
            self._is_compiled = kernels.is_compiled(self._kernel()[0], MOST_THREADS)
        return self._is_compiled

    def _kernel(self) -> tuple[Any, Any]:
        """Return the kernel, and what it does before forces."""
        effect, composition = self._effect, self._dynamics.composition
        how = effect.overlapping_at_start, effect.lanes(triangles=True)
        before = contact_before(composition, self._method, *how)
        return persistent(composition, self._method, CLUSTER, before=before), before

    def launch(self, substeps: int, first: int) -> None:
        """Advance by `substeps` substeps of a frame, from number `first` on."""
        dynamics, effect, model = self._dynamics, self._effect, self._dynamics.model
        neighbors, planes = effect.neighbors, effect.planes
        dynamics.go_to_substep(first)
        numbers, h = ContactNumbers(model.scalar)(), effect.steps.dt
        numbers.beyond, numbers.farthest = neighbors.longest_path, neighbors.farthest
        numbers.h, numbers.rate, numbers.per_unit = h, DAMPING / h, 1.0 / effect.data.unit
        numbers.ahead, numbers.soon, numbers.most = AHEAD * h, SOON * h, neighbors.overruns.most
        numbers.activation = planes.activation
        (kernel, before), threads = self._kernel(), CLUSTER * MOST_THREADS
        contact = before.Data()
        contact.data, contact.tree = effect.on_device
        contact.pairs, contact.numbers, contact.none = planes.pairs, numbers, effect.nothing
        contact.buffer, contact.flags = neighbors.skin.on_device, neighbors.flags
        inputs = [dynamics.scene, stages_for(kernel, self._steps), substeps, whole(model, threads), contact]
        wp.launch(kernel, threads, inputs, device=model.device, block_dim=MOST_THREADS)

    def test_motion(self, now: Instant) -> None:
        """Launch the test of motion that shows, at a frame's end, whether lists were valid."""
        self._effect.neighbors.place(now.x, now.v, now.compensation)


def contact_launch(dynamics: Dynamics, stages: Sequence[Stage], per_substep: int) -> ContactLaunch | None:
    """Return the launch of a scene's frames; None unless it is small, of solid bodies, without other effects."""
    model, effect, algorithm = dynamics.model, dynamics.assembly.body_contact, dynamics.composition.force_algorithm
    if effect is None or model.in_worlds or not model.device.is_cuda or model.device.arch < 90 or per_substep != 1:
        return None
    if not dynamics.only_contact_precedes or algorithm.evaluate is not None or algorithm.tears:
        return None
    # They never sleep if any body is open, such as a rope or a grain.
    if effect.planes.tangles or not effect.planes.may_sleep:
        return None
    sizes = effect.shared_points, len(effect.neighbors.tree.body_lower), model.particle_count
    if any(size > most for size, most in zip(sizes, MOST, strict=True)):
        return None
    return ContactLaunch(dynamics, effect, stages)
