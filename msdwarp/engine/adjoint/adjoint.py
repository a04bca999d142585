"""Adjoint: propagates derivatives of a loss back through the launches of substeps."""

from collections.abc import Callable, Container, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ...kernels.adjoint.kick import SUMMING, AdjointData, add_given, forget, kick_adjoint, squares, widen
from ...kernels.adjoint.mid_velocity import mid_velocity_adjoint
from ...kernels.adjoint.springs import Wanted
from ...kernels.basis import vector
from ...kernels.colliders.soft_colliders import soft_adjoint
from ...kernels.lanes import WARP
from ...kernels.springs.constants import CONSTANTS
from ..collision.soft_colliders import SoftColliders
from ..device.launcher import Launcher
from ..device.vector_arrays import in_records
from ..loads.actuators import ActuatedSprings
from ..loads.drives import Drives
from ..loads.external_work import Work
from ..loads.forces import Weight
from ..loads.surface_triangles import EmbeddedVertices
from ..model.effect import Effect, Parameter
from ..springs.extra_springs import ExtraSprings
from ..stepping.assemble import Assembly
from ..stepping.dynamics import Dynamics
from .element_adjoints import ElementAdjoints
from .motion_adjoint import MotionAdjoint
from .number_sums import NumberSums
from .spring_adjoints import InTable, springs_of_particles
from .tape import Tape

GIVEN = (Drives, Weight, Work)
DIFFERENTIABLE = (ActuatedSprings, EmbeddedVertices, ExtraSprings, SoftColliders, *GIVEN)
"""Effects without `elements` that have an adjoint, or whose forces do not depend on the motion."""
WORDS = {
    "AttachmentSprings": "mouse springs",
    "BodyContact": "contact between bodies",
    "Colliders": "obstacles without a stiffness (as Plane(stiffness=1e4) has)",
    "DivisionPlanes": "contact between bodies",
    "Fire": "a system that is led to equilibrium",
    "Fracture": "connections that break",
    "Plasticity": "connections that yield",
    "SurfaceContact": "contact between bodies",
}
"""Words for effects without an adjoint; messages name others by their class."""


class Adjoint:
    """The derivatives of a loss with respect to the state, and to requested parameters, on a device.

    In an ensemble each world has its own loss. The derivatives with respect to its state are in arrays like those
    of a `State`; arrays on the host have a first axis of worlds.

    Attributes
    ----------
    by_x, by_v
        Derivatives by positions [1/m] and velocities [s/m], at the instant that the propagation has reached.
    """

    def __init__(self, dynamics: Dynamics, wanted: Iterable[str]) -> None:
        assembly, model, names = dynamics.assembly, dynamics.model, set(wanted)
        self._model, device, self._count = model, model.device, model.worlds * model.stride
        actuated = next((one for one in assembly.all if isinstance(one, ActuatedSprings)), None)
        own = Wanted(*(name in names for name in Wanted._fields))
        self.by_x, self.by_v, self._phi, self._next_phi = model.vectors_together(4)
        self._springs = springs_of_particles(model, actuated)
        data = self._data = AdjointData(model.dim, model.scalar)()
        data.by_x, data.by_v = self.by_x, self.by_v
        data.gravity, data.inverse_mass = model.gravity, model.inverse_mass
        by_mass, by_gravity = "mass" in names, bool({"gravity", "force"} & names)
        if "gravity" in model.rows:  # kernels take none for their F/m = v' − v − s g; `found` subtracts it
            data.gravity, by_gravity = model.vector(), by_mass or by_gravity
        if model.in_worlds:
            each = np.zeros((model.worlds, model.stride))
            each[:, : model.particle_count] = model.of_each(1.0 / model.row_of("mass"))
            data.inverse_mass = wp.array(each.ravel(), dtype=model.scalar, device=device)
        data.by_gravity = model.vectors() if by_gravity else wp.zeros(0, dtype=model.vector, device=device)
        self._kick = kick_adjoint(model.dim, model.scalar)
        self._pull = self._springs.kernel(own)
        self._scene, self._correct = dynamics.scene, mid_velocity_adjoint(dynamics.composition)
        self._u = None if self._correct is None else model.vectors()
        """Velocities at which a kick takes the forces that are functions of velocity; None without such forces."""
        for name in (*CONSTANTS, "strain"):
            entries = self._springs.entries if name in names else 1
            setattr(data, f"by_{name}", wp.zeros(entries, dtype=model.scalar, device=device))
        data.by_inverse_mass = wp.zeros(self._count if by_mass else 0, dtype=model.scalar, device=device)
        self._sums: list[NumberSums] = []
        self._parameters: dict[str, tuple[NumberSums, Parameter]] = {}
        if isinstance(self._springs, InTable) and actuated is not None:
            sums = self._sums_of(actuated, names, self._springs.column, 1)
            if sums is not None:
                data.by_strain = sums.each.flatten()
        time = getattr(dynamics.scene, "time", None)  # None if no force depends on it
        time = wp.zeros(1, dtype=model.scalar, device=device) if time is None else time
        about = time, self._launch, self._launch_once
        self._elements = list[tuple[ElementAdjoints, bool]]()
        for effect in assembly.all:
            elements = effect.elements()
            if elements is not None:
                group, width = elements.group, elements.law.width
                sums = None if group is None else self._sums_of(effect, names, group, width)
                if elements.of_motion or sums is not None:
                    of_velocity = getattr(effect.term, "at_velocity", None) is not None
                    self._elements.append((ElementAdjoints(model, elements, *about, sums), of_velocity))
        soft = next((one for one in assembly.all if isinstance(one, SoftColliders)), None)
        self._soft, self._soft_kernel = soft, None
        if soft is not None:
            sums = self._sums_of(soft, names, np.tile(np.arange(soft.data.count), model.stride), 5 + model.dim)
            kinds = soft.kinds, by_mass, sums is not None
            self._soft_kernel = soft_adjoint(model.dim, model.scalar, *kinds)
            self._soft_by = wp.zeros((0, 1), dtype=model.scalar, device=device) if sums is None else sums.each
        drives = next((one for one in assembly.all if isinstance(one, Drives)), None)
        self._driven: wp.array | None = None
        self.motions: MotionAdjoint | None = None
        """Derivatives by prescribed motions, if any are asked for."""
        if drives is not None:
            self._start = drives.data.start
            self._by_poses = wp.zeros((0, 1), dtype=model.scalar, device=device)
            if drives.parameters().keys() & names:
                self.motions = MotionAdjoint(model, drives, self._launch_once)
                self._by_poses = self.motions.sums.each
            driven = np.concatenate([one.held for one in drives.motions])
            each = driven + model.stride * np.arange(model.worlds)[:, None]
            self._driven = wp.array(each.ravel(), dtype=int, device=device)
        self._only_springs = soft is None and drives is None and not self._elements
        self._totals = {}
        for name in names & set(CONSTANTS):
            self._totals[name] = wp.zeros(self._springs.entries, dtype=wp.float64, device=device)
        if by_mass:
            self._totals["mass"] = wp.zeros(self._count, dtype=wp.float64, device=device)
        if by_gravity:
            self._totals["gravity"] = in_records(self._count, model.dim, wp.float64, device)
        self._sizes: wp.array | None = None
        self._staged = wp.zeros(self._count, dtype=model.vector, device="cpu", pinned=device.is_cuda)
        self._given = wp.zeros_like(self._staged, device=device, pinned=False)
        self._aside: tuple[wp.array, ...] = ()
        self._launcher = dynamics.partition or Launcher()

    def _sums_of(
        self, effect: Effect, wanted: Container[str], group: NDArray[np.integer], numbers: int
    ) -> NumberSums | None:
        """Return sums of derivatives by the numbers of an effect; None if none of its parameters is wanted."""
        asked = {name: one for name, one in effect.parameters().items() if name in wanted}
        if not asked:
            return None
        varies = any(one.varies for one in asked.values())
        stages = len(effect.steps.times(0.0)) if varies else 1
        sums = NumberSums(self._model, group, numbers, stages, self._launch_once)
        self._sums.append(sums)
        self._parameters |= {name: (sums, one) for name, one in asked.items()}
        return sums

    def clear(self) -> None:
        """Set all derivatives to 0."""
        each = [getattr(self._data, name) for name in self._data._cls.vars if name.startswith("by_")]
        for array in (*each, *self._totals.values(), *([] if self._sizes is None else [self._sizes])):
            array.zero_()
        for sums in self._sums:
            sums.clear()
        if self.motions is not None:
            self.motions.clear()

    def kick(self, drift: float, seconds: float, x: wp.array, v: wp.array, v_out: wp.array, stage: int) -> None:
        """Propagate derivatives back through a kick of v to v_out by forces at (x, v), and a drift by v_out.

        `seconds` is the length of the kick and `drift` that of the drift [s]; `stage` is the stage of a frame at
        which the forces are.
        """
        theta = 1.0 if seconds > 0.0 else 0.0
        self._propagate_kick(drift, seconds, (x, v), v_out, stage, theta)
        self._propagate_forces(x, v, stage, u=self._u)

    def of_forces(self, phi: NDArray, x: wp.array, v: wp.array) -> list[NDArray]:
        """Return (∂F/∂x)ᵀ φ and (∂F/∂v)ᵀ φ of a single world, shape [particle_count, d], for forces F at (x, v).

        Call `clear` before derivatives of a loss are propagated.
        """
        for one in (self.by_x, self.by_v):
            one.zero_()
        self._phi.assign(phi)
        self._propagate_forces(x, v, 0)
        return [np.array(one.numpy()) for one in (self.by_x, self.by_v)]

    def forget_driven(self, stage: int) -> None:
        """Set derivatives of driven particles to 0, since their motion does not depend on earlier states."""
        if self._driven is not None:
            inputs = [self._driven, self._start, self.by_x, self.by_v, self._by_poses]
            self._launch(forget(self._model.dim, self._model.scalar), len(self._driven), inputs)
            if self.motions is not None:
                self.motions.sums.add_up(stage)

    def frame(self, h: float, tape: Tape) -> None:
        """Propagate derivatives back through the substeps (h seconds each) of a frame, which are stored on a tape.

        If only springs act, one launch goes back through the forces of a substep and then through the kick of the
        previous one.
        """
        states, last = tape.states, len(tape.states) - 1
        self.forget_driven(last)
        self._propagate_kick(h, h, states[-2], states[-1][1], last - 1)
        for n in reversed(range(last)):
            x, v = states[n]
            before = states[n - 1][1] if n else None
            if self._only_springs:
                self._propagate_forces(x, v, n, h, before)
            else:
                self._propagate_forces(x, v, n, u=self._u)
                self.forget_driven(n)
                if before is not None:
                    self._propagate_kick(h, h, states[n - 1], v, n - 1)

    def _propagate_kick(
        self, drift: float, seconds: float, state: Sequence[wp.array], v_out: wp.array, stage: int, theta=0.5
    ) -> None:
        """Propagate derivatives back through a kick and a drift; write those by the forces of the kick.

        `theta` is that of `kernels.integrators.mid_velocity`.
        """
        inputs = [self._data, drift, seconds, state[1], v_out, self._phi]
        self._launch(self._kick, self._count, inputs)
        if self._correct is not None:
            inputs = [self._data, self._scene, stage, self._model.stride, seconds, theta, *state, v_out]
            self._launch(self._correct, self._count, [*inputs, self._phi, self._u])

    def _propagate_forces(
        self, x: wp.array, v: wp.array, stage: int, h: float = 0.0, v_before: Any = None, u: Any = None
    ) -> None:
        """Propagate derivatives by forces to (x, v), and through the kick from `v_before` to v, if not None.

        Forces that are functions of velocity have been evaluated at velocities u, if not None.
        """
        h, v_before = (0.0, v) if v_before is None else (h, v_before)
        inputs = [self._data, self._springs.table, stage, x, v, self._phi, h, h, v_before, self._next_phi]
        self._springs.launch(self._pull, inputs, self._launch)
        for one, of_velocity in self._elements:
            one.propagate(x, u if of_velocity and u is not None else v, self._phi, self.by_x, self.by_v, stage)
        if self._soft is not None:
            by = [self.by_x, self.by_v, self._data.by_inverse_mass, self._soft_by]
            inputs = [self._soft.data, self._data.inverse_mass, x, v, self._phi, *by]
            self._launch(self._soft_kernel, self._count, inputs)
        for sums in self._sums:
            if sums.varies:
                sums.add_up(stage)
        self._phi, self._next_phi = self._next_phi, self._phi

    def _launch(self, kernel: Any, count: int, inputs: list[Any], lanes: int = 1) -> None:
        """Launch a kernel over particles, or over parts of them if CPU threads share a frame."""
        device = self._model.device
        threads = count * lanes if device.is_cuda else 1  # on a CPU each would copy its arguments

        def launch_part(k: int, parts: int) -> None:
            part = [k * count // parts, (k + 1) * count // parts, threads]
            wp.launch(kernel, threads, [*inputs, *part], device=device)

        self._launcher.launch_parts(launch_part)

    def _launch_once(self, launch: Callable[[], Any]) -> None:
        """Call `launch` in only one of the CPU threads that share a frame."""
        self._launcher.launch_parts(lambda k, parts: launch() if k == 0 else None)

    def add(self, to: wp.array, values: NDArray[np.float64]) -> None:
        """Add host values of shape [particle_count, d], or [worlds, particle_count, d], to derivatives."""
        model = self._model
        rows = self._staged.numpy().reshape(model.worlds, model.stride, model.dim)
        wp.synchronize_device(model.device)  # it may still copy what was added last
        rows[:, : model.particle_count] = values.reshape(model.worlds, model.particle_count, model.dim)
        wp.copy(self._given, self._staged)
        wp.launch(add_given(model.dim, model.scalar), len(to), [self._given, to], device=model.device)

    @contextmanager
    def aside(self, by_v: NDArray[np.float64]) -> Iterator[None]:
        """Within the context propagate `by_v` instead of the current derivatives; afterwards add these again."""
        model, own = self._model, (self.by_x, self.by_v)
        self._aside = self._aside or model.vectors_together(2)
        for array, kept in zip(own, self._aside, strict=True):
            wp.copy(kept, array)
            array.zero_()
        self.add(self.by_v, by_v)
        yield
        for array, kept in zip(own, self._aside, strict=True):
            wp.launch(add_given(model.dim, model.scalar), len(array), [kept, array], device=model.device)

    def measure(self, row: int, rows: int) -> None:
        """Launch the sums of squares of both derivatives by the state, into a row of `sizes`."""
        model = self._model
        if self._sizes is None or len(self._sizes) != rows:
            self._sizes = wp.zeros((rows, model.worlds, 2), dtype=wp.float64, device=model.device)
        threads = max(WARP, SUMMING // model.worlds // WARP * WARP)
        inputs = [self.by_x, self.by_v, model.particle_count, model.stride, threads, row]
        kernel = squares(model.dim, model.scalar)
        wp.launch(kernel, model.worlds * threads, inputs, [self._sizes], device=model.device)

    def sizes(self) -> NDArray[np.float64]:
        """Return the norms of the derivatives by positions and velocities, shape [rows, worlds, 2]."""
        assert self._sizes is not None
        return np.sqrt(self._sizes.numpy())

    def add_up(self) -> None:
        """Launch the addition of a frame's contributions to the parameters' derivatives, in float64."""
        model = self._model
        for name, total in self._totals.items():
            narrow = getattr(self._data, "by_inverse_mass" if name == "mass" else f"by_{name}")
            kinds = (model.scalar, wp.float64)
            if name == "gravity":
                kinds = (model.vector, vector(model.dim, wp.float64))
            wp.launch(widen(*kinds), len(total), [narrow, total], device=model.device)
        for sums in self._sums:
            if not sums.varies:
                sums.add_up()

    def varies(self, name: str) -> bool:
        """Tell whether a number of a load is a function of time."""
        return self._parameters[name][1].varies

    def take_stages(self) -> dict[str, NDArray[np.float64]]:
        """Return the summed derivatives by functions of time, for each stage of a frame, and set them to 0.

        Their first axis is that of stages; in an ensemble the second, after that of worlds.
        """
        found = {id(sums): sums.take() for sums in self._sums if sums.varies}
        return {
            name: self._model.of_each(one.of(found[id(sums)]))
            for name, (sums, one) in self._parameters.items()
            if sums.varies
        }

    def found(self) -> dict[str, NDArray[np.float64]]:
        """Return the derivatives by parameters, in the system's order."""
        model, result = self._model, {}
        each: Any = {name: self._totals[name].numpy() for name in ("mass", "gravity") if name in self._totals}
        for name, values in each.items():  # [worlds, particle_count, 1 or d]
            each[name] = values.reshape(model.worlds, model.stride, -1)[:, : model.particle_count]
        mass = model.row_of("mass")[np.arange(model.worlds) % len(model.row_of("mass")), :, None]
        if "mass" in each:  # ∂/∂m = −(1/m²) ∂/∂(1/m), and kernels sum (1/m) ∂/∂(1/m)
            by_inverse = each["mass"]
            if "gravity" in model.rows:
                g = model.of_each(model.rows["gravity"])
                by_inverse = by_inverse - (each["gravity"] * g[:, None]).sum(axis=-1, keepdims=True)
            result["mass"] = model.of_each((-by_inverse / mass)[..., 0])
        if "gravity" in each:  # by each particle's gravity; a force f acts like the gravity f/m
            result["force"] = model.of_each(each["gravity"] / mass)
            result["gravity"] = model.of_each(each["gravity"].sum(axis=1))
        for name in self._totals.keys() & set(CONSTANTS):
            result[name] = self._springs.by_connection(self._totals[name].numpy())
        for name, (sums, one) in self._parameters.items():
            if not sums.varies:
                result[name] = np.asarray(model.of_each(one.of(sums.total.numpy()[:, 0])))
        return result


def without_adjoint(assembly: Assembly) -> list[str]:
    """Return the effects of a scene whose forces have no adjoint, in words."""
    without = [one for one in assembly.all if not isinstance(one, DIFFERENTIABLE) and one.elements() is None]
    names = [type(one).__name__ for one in without]
    found = [WORDS.get(name, name) for name in names]
    muscles = [one.connection for one in assembly.all if isinstance(one, ActuatedSprings)]
    if any(len(np.unique(one)) < len(one) for one in muscles):
        found.append("connections with several actuators")
    return list(dict.fromkeys(found))
