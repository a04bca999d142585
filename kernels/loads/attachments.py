"""Attachments: springs and dampers from particles to fixed or moving points."""

import functools
from typing import Any

import warp as wp

from ..basis import kernel, vector
from ..compensation import position_of
from ..effect import ElementForce, ForceTerm, instant
from ..records import records


@functools.cache
def spring_to_point(dim: int, scalar: type, stretched: bool) -> Any:
    """Compose wp.func (k, b, l0, dx, dv) -> (force on the particle [N], stored energy [J], dissipated power [W]).

    dx and dv are the particle's position and velocity less those of the point [m, m/s].
    """
    V = vector(dim, scalar)
    half, zero = scalar(0.5), scalar(0.0)

    @wp.func
    def evaluate(k: scalar, b: scalar, l0: scalar, dx: V, dv: V):
        if wp.static(stretched):
            if l0 > zero:
                length = wp.length(dx)
                if length == zero:
                    return V(), half * k * l0 * l0, zero
                axis = dx / length
                stretch = length - l0
                speed = wp.dot(dv, axis)
                return -(k * stretch + b * speed) * axis, half * k * stretch * stretch, b * speed * speed
        return -k * dx - b * dv, half * k * wp.dot(dx, dx), b * wp.dot(dv, dv)

    return evaluate


@functools.cache
def attachments(
    dim: int, scalar: type, compensated: bool, *, moving: bool, damped: bool, stretched: bool
) -> tuple[ForceTerm, ElementForce, Any, Any]:
    """Compose (term, law, add_blocks, measure) of a scene's attachments.

    Each flag is set if an attachment moves, is damped, has a rest length. The law's numbers are stiffness,
    damping, rest length and anchor point. `add_blocks` is a kernel over members for `Effect.add_blocks`;
    `measure`, one over worlds and members, writes each one's stored energy [J] and dissipated power [W].

    An attachment of rest length 0, F = −k (x − p) − b (v − u) for the point p with velocity u, acts equally in all
    directions. With a rest length it acts only along its axis, as a spring between particles, and exerts no force
    if there is no axis.

    The carrier of a point does work at the rate F·u, which is summed over substeps like the work of drives.
    """
    V, Wide, Numbers = vector(dim, scalar), vector(dim, wp.float64), vector(3 + dim, scalar)
    Turn, Rows = wp.types.matrix((dim, dim), scalar), wp.types.matrix((1, dim), scalar)
    Block: Any = wp.types.matrix((dim, dim), wp.float64)
    Instant, position = instant(dim, scalar, compensated), position_of(dim, scalar, compensated)
    load = records(dim, scalar).load
    spring, wide_spring = (spring_to_point(dim, kind, stretched) for kind in (scalar, wp.float64))

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
    def numbers(data: Attached, e: int, stage: int) -> Numbers:
        own = Numbers()
        own[0] = data.stiffness[e]
        own[1] = data.damping[e]
        own[2] = data.rest_length[e]
        for k in range(wp.static(dim)):
            own[3 + k] = data.point[e][k]
        return own

    @wp.func
    def evaluate(data: Attached, e: int, time: scalar, stage: int, x: Rows, v: Rows, own: Numbers) -> V:
        row = int(0)
        if wp.static(moving):
            row = stage
        y = V()
        for k in range(wp.static(dim)):
            y[k] = own[3 + k]
        dx = x[0] - place(data, row, e, y)
        dv = V()
        if wp.static(damped):
            dv = v[0] - velocity(data, row, e, y)
        force, _energy, _power = spring(own[0], own[1], own[2], dx, dv)
        return force

    @wp.func
    def add_work(data: Attached, now: Instant, e: int, f: V):
        if data.carrier[e] >= 0:
            before = now.weight[now.stage]
            after = now.weight_of_last[now.stage]
            # False at a frame's end, and where half a kick looks ahead.
            if after != wp.float64(0.0) or (data.ahead == 0 and before != wp.float64(0.0)):
                y = data.point[e]
                work = before * wp.float64(wp.dot(f, velocity(data, now.stage, e, y)))
                half = after * wp.float64(wp.dot(f, velocity(data, now.stage + data.ahead, e, y)))
                data.done[0, e] = data.done[0, e] + work + half
                data.done[1, e] = half

    @wp.func
    def attachment(data: Attached, now: Instant, i: int) -> V:
        x = Rows()
        v = Rows()
        x[0] = position(now.compensation, now.x, i)
        v[0] = load(now.v, i)
        total = V()
        for e in range(data.first[i], data.first[i + 1]):
            f = evaluate(data, e, now.time, now.stage, x, v, numbers(data, e, now.stage))
            if wp.static(moving):
                add_work(data, now, e, f)
            total += f
        return total

    # Not derived from `evaluate`: half of k and b bounds what a spring exerts in any direction, also in those to
    # which it turns later. Derivatives are those of the present one, and grow without bound near the point.
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
            k = wp.float64(attached.stiffness[e])
            b = wp.float64(attached.damping[e])
            l0 = wp.float64(attached.rest_length[e])
            _force, own, lost = wide_spring(k, b, l0, Wide(x[here]) - Wide(p), Wide(v[here]) - Wide(u))
            stored += own
            lost_power += lost
        energy[w, m] = stored
        power[w, m] = lost_power

    term = ForceTerm("attached", Attached, force=attachment, selective=True, timed=moving)
    law = ElementForce(evaluate, numbers, 3 + dim)
    return term, law, add_attachment_blocks, measure_attached
