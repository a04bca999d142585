"""Driven particles: where they are, and how fast, is read from the poses of their drives."""

import functools
from typing import Any

import warp as wp

from ..basis import vector
from ..compensation import compensation
from ..effect import Driving, Piece
from ..records import records


@functools.cache
def driven(dim: int, scalar: type, compensated: bool) -> Piece:
    """Return what drives add to kernels.

    What started at y is at turn y + shift, in float64: rounded once, a pose is as exact as a place can be. What a
    stage writes of a driven particle the next stage takes, and so it is that of the next stage's time.
    """
    V, Wide, Turn = vector(dim, scalar), vector(dim, wp.float64), wp.types.matrix((dim, dim), wp.float64)
    Lost, _ = compensation(dim, scalar, compensated)
    load, store, _ = records(dim, scalar)

    @wp.struct
    class Drives:
        entry: wp.array(dtype=int)  # which of the driven ones a particle is, -1 of a free one
        drive: wp.array(dtype=int)  # of each of these its drive
        start: wp.array(dtype=Wide)  # and where it was at the start [m]
        # Poses in each stage of a frame and at its end, and their rates there, as the method keeps velocities:
        turn: wp.array2d(dtype=Turn)
        shift: wp.array2d(dtype=Wide)  # [m]
        turning: wp.array2d(dtype=Turn)  # [1/s]
        speed: wp.array2d(dtype=Wide)  # [m/s]
        # The second derivatives where the frame ends, one for each drive:
        bending: wp.array(dtype=Turn)  # [1/s²]
        push: wp.array(dtype=Wide)  # [m/s²]

    def drive(World: Any) -> Driving:
        @wp.func
        def holds(world: World, i: int) -> bool:
            return world.drives.entry[i] >= 0

        @wp.func
        def acceleration(world: World, i: int) -> V:
            e = world.drives.entry[i]
            if e < 0:
                return V()
            d = world.drives.drive[e]
            return V(world.drives.bending[d] * world.drives.start[e] + world.drives.push[d])

        @wp.func
        def place(world: World, e: int) -> Wide:
            row = world.stage + 1
            d = world.drives.drive[e]
            return world.drives.turn[row, d] * world.drives.start[e] + world.drives.shift[row, d]

        @wp.func
        def velocity(world: World, e: int) -> Wide:
            row = world.stage + 1
            d = world.drives.drive[e]
            return world.drives.turning[row, d] * world.drives.start[e] + world.drives.speed[row, d]

        @wp.func
        def at_stage(world: World, lost: Lost, x: V, v: V, i: int):
            e = world.drives.entry[i]
            if e >= 0:
                exact = place(world, e)
                if wp.static(compensated):  # of which readers take what the start of the substep had lost
                    exact += Wide(load(lost.x, i))
                x = V(exact)
                v = V(velocity(world, e))
            return x, v

        @wp.func
        def at_end(world: World, lost: Lost, x: V, v: V, i: int):
            e = world.drives.entry[i]
            if e >= 0:
                exact = place(world, e)
                x = V(exact)
                fast = velocity(world, e)
                v = V(fast)
                if wp.static(compensated):
                    store(lost.x_out, i, V(Wide(x) - exact))
                    store(lost.v, i, V(Wide(v) - fast))
            return x, v

        return Driving(holds, acceleration, at_stage, at_end)

    return Piece("drives", Drives, drive=drive, timed=True)
