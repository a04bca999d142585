"""Attachments: springs and dampers from particles to fixed or moving points."""

import functools
from typing import Any, NamedTuple

import warp as wp

from ..basis import kernel, vector
from ..compensation import state_types
from ..effect import ForceTerm
from ..records import records


class Attachments(NamedTuple):
    """The device side of attachments."""

    piece: ForceTerm
    """The force term, for a scene's kernels."""
    add_blocks: Any
    """Kernel, over members, that adds to the blocks of the stability bound (`Effect.add_blocks`)."""
    measure: Any
    """Kernel, over members, that writes each one's stored energy [J] and dissipated power [W]."""
    projected: Any
    """φ·F of an attachment, for `adjoint.elements`."""
    numbers: Any
    """Stiffness, damping, rest length and anchor point of an attachment, for `adjoint.elements`."""


@functools.cache
def attachments(
    dim: int, scalar: type, compensated: bool, *, moving: bool, damped: bool, stretched: bool
) -> Attachments:
    """Compose the attachments of a scene; each flag is set if an attachment moves, is damped, has a rest length.

    An attachment of rest length 0, F = −k (x − p) − b (v − u) for the point p with velocity u, acts equally in all
    directions. With a rest length it acts only along its axis, as a spring between particles, and exerts no force
    if there is no axis.

    The carrier of a point does work at the rate F·u, which is summed over substeps like the work of drives.
    """
    V, Vectors, Compensation = state_types(dim, scalar, compensated)
    Turn = wp.types.matrix((dim, dim), scalar)
    Block: Any = wp.types.matrix((dim, dim), wp.float64)
    load = records(dim, scalar).load

    @wp.struct
    class Attached:
        first: wp.array(dtype=int)  # row starts of the attachments, shape [particle_count + 1]
        member: wp.array(dtype=int)  # particles with attachments, shape [member_count]
        # Of each attachment, shape [attachment_count]:
        point: wp.array(dtype=V)  # anchor point [m]; in the given pose of its carrier if it has one
        carrier: wp.array(dtype=int)  # index of the carrier that moves the point; −1 if fixed
        rest_length: wp.array(dtype=scalar)  # l0 [m]
        stiffness: wp.array(dtype=scalar)  # k [N/m]
        damping: wp.array(dtype=scalar)  # b [N s/m]
        # Of each carrier in each stage of a frame, and at its end, shape [stage_count + 1, carrier_count]:
        turn: wp.array2d(dtype=Turn)  # R: point y of a carrier is at R y + o
        shift: wp.array2d(dtype=V)  # o [m]
        turning: wp.array2d(dtype=Turn)  # dR/dt [1/s]
        speed: wp.array2d(dtype=V)  # do/dt [m/s]
        if moving:
            ahead: int  # row offset from the velocity before a stage to the velocity after it
            # Work of each one [J], shape [2, attachment_count], to be summed: of all forces so far, and of the
            # next force with the current velocity, estimated from the last force
            done: wp.array2d(dtype=wp.float64)

    @wp.func
    def place(attached: Attached, row: int, e: int, y: V) -> V:
        if wp.static(moving):
            c = attached.carrier[e]
            if c >= 0:
                return attached.turn[row, c] * y + attached.shift[row, c]
        return y

    @wp.func
    def velocity(attached: Attached, row: int, e: int, y: V) -> V:
        if wp.static(moving):
            c = attached.carrier[e]
            if c >= 0:
                return attached.turning[row, c] * y + attached.speed[row, c]
        return V()

    @wp.func
    def pull(attached: Attached, row: int, e: int, y: V, k: scalar, b: scalar, l0: scalar, x: V, v: V) -> V:
        dx = x - place(attached, row, e, y)
        dv = V()
        if wp.static(damped):
            dv = v - velocity(attached, row, e, y)
        if wp.static(stretched):
            if l0 > scalar(0.0):
                length = wp.length(dx)
                if length == scalar(0.0):
                    return V()
                axis = dx / length
                return -(k * (length - l0) + b * wp.dot(dv, axis)) * axis
        return -k * dx - b * dv

    def force(SceneData: Any):
        @wp.func
        def add_work(scene: SceneData, row: int, e: int, f: V):
            if scene.attached.carrier[e] >= 0:
                before = scene.worked.weight[row]
                after = scene.worked.weight_of_last[row]
                # False at a frame's end, and where half a kick looks ahead.
                if after != wp.float64(0.0) or (scene.attached.ahead == 0 and before != wp.float64(0.0)):
                    y = scene.attached.point[e]
                    later = row + scene.attached.ahead
                    now = before * wp.float64(wp.dot(f, velocity(scene.attached, row, e, y)))
                    half = after * wp.float64(wp.dot(f, velocity(scene.attached, later, e, y)))
                    scene.attached.done[0, e] = scene.attached.done[0, e] + now + half
                    scene.attached.done[1, e] = half

        @wp.func
        def attachment(scene: SceneData, compensation: Compensation, x: Vectors, v: Vectors, i: int) -> V:
            row = int(0)
            if wp.static(moving):
                row = scene.stage
            x_i = load(x, i)
            if wp.static(compensated):
                x_i = x_i - load(compensation.x, i)
            v_i = V()
            if wp.static(damped):
                v_i = load(v, i)
            total = V()
            for e in range(scene.attached.first[i], scene.attached.first[i + 1]):
                y = scene.attached.point[e]
                k = scene.attached.stiffness[e]
                b = scene.attached.damping[e]
                f = pull(scene.attached, row, e, y, k, b, scene.attached.rest_length[e], x_i, v_i)
                if wp.static(moving):
                    add_work(scene, row, e, f)
                total += f
            return total

        return attachment

    Rows: Any = wp.types.matrix((1, dim), scalar)
    Numbers = vector(3 + dim, scalar)

    @wp.func
    def numbers(attached: Attached, e: int, i: int, stage: int) -> Numbers:
        own = Numbers()
        own[0] = attached.stiffness[e]
        own[1] = attached.damping[e]
        own[2] = attached.rest_length[e]
        for k in range(wp.static(dim)):
            own[3 + k] = attached.point[e][k]
        return own

    @wp.func
    def projected(
        attached: Attached, e: int, i: int, time: scalar, stage: int, x: Rows, v: Rows, phi: Rows, own: Numbers
    ) -> scalar:
        row = int(0)
        if wp.static(moving):
            row = stage
        y = V()
        for k in range(wp.static(dim)):
            y[k] = own[3 + k]
        return wp.dot(pull(attached, row, e, y, own[0], own[1], own[2], x[0], v[0]), phi[0])

    @kernel
    def add_attachment_blocks(
        attached: Attached,
        # Out, one block per particle, shape [particle_count]:
        stiffness: wp.array(dtype=Block),  # [N/m]
        damping: wp.array(dtype=Block),  # [N s/m]
    ):
        i = attached.member[wp.tid()]
        k = wp.float64(0.0)
        b = wp.float64(0.0)
        for e in range(attached.first[i], attached.first[i + 1]):
            k += wp.float64(attached.stiffness[e])
            b += wp.float64(attached.damping[e])
        for c in range(wp.static(dim)):
            stiffness[i][c, c] += wp.float64(0.5) * k
            damping[i][c, c] += wp.float64(0.5) * b

    @kernel
    def measure_attached(
        attached: Attached,
        row: int,  # row in the tables of carriers
        # State in:
        x: wp.array(dtype=V),  # [m], of all worlds
        v: wp.array(dtype=V),  # [m/s], of all worlds
        stride: int,  # particles from one world to the next
        # Out, of each member, shape [worlds, member_count]:
        energy: wp.array2d(dtype=wp.float64),  # [J]
        power: wp.array2d(dtype=wp.float64),  # [W]
    ):
        w, m = wp.tid()
        i = attached.member[m]
        here = w * stride + i
        stored = wp.float64(0.0)
        lost_power = wp.float64(0.0)
        for e in range(attached.first[i], attached.first[i + 1]):
            p = place(attached, row, e, attached.point[e])
            u = velocity(attached, row, e, attached.point[e])
            square = wp.float64(0.0)  # |x − p|²
            along = wp.float64(0.0)  # (v − u)·(x − p)
            whole = wp.float64(0.0)  # |v − u|²
            for c in range(wp.static(dim)):
                d = wp.float64(x[here][c]) - wp.float64(p[c])
                rate = wp.float64(v[here][c]) - wp.float64(u[c])
                square += d * d
                along += rate * d
                whole += rate * rate
            l0 = wp.float64(attached.rest_length[e])
            stretch = wp.sqrt(square) - l0
            stored += wp.float64(0.5) * wp.float64(attached.stiffness[e]) * stretch * stretch
            if l0 > wp.float64(0.0):
                whole = along * along / wp.max(square, wp.float64(1.0e-300))
            lost_power += wp.float64(attached.damping[e]) * whole
        energy[w, m] = stored
        power[w, m] = lost_power

    piece = ForceTerm("attached", Attached, force=force, selective=True, timed=moving)
    return Attachments(piece, add_attachment_blocks, measure_attached, projected, numbers)
