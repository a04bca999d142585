"""Driven particles: the poses of drives prescribe their positions and velocities."""

import functools
from typing import Any

import warp as wp

from ..basis import vector
from ..compensation import compensated_sum
from ..effect import Driving, ForceTerm
from ..records import records


@functools.cache
def driven(dim: int, scalar: type, compensated: bool) -> ForceTerm:
    """Return the term of drives.

    A particle that started at y is at turn y + shift, computed in float64 and rounded once. A stage writes a
    driven particle's state at the time of the next stage.

    A drive does work at the rate −f·v on a particle with force f and velocity v. Work is summed over substeps as
    for loads (see `work`): half with the velocity before, half with the velocity after. An implicit method solves
    for the force during a substep, whose work is −f·Δx.
    """
    V, Wide, Turn = vector(dim, scalar), vector(dim, wp.float64), wp.types.matrix((dim, dim), wp.float64)
    Compensation, _ = compensated_sum(dim, scalar, compensated)
    load, store, _ = records(dim, scalar)

    @wp.struct
    class Drives:
        entry: wp.array(dtype=int)  # index of a particle among driven particles, -1 if free
        drive: wp.array(dtype=int)  # drive of each driven particle
        start: wp.array(dtype=Wide)  # initial position of each driven particle [m]
        # Poses in each stage of a frame and at its end, and their rates at the times of the method's velocities:
        turn: wp.array2d(dtype=Turn)
        shift: wp.array2d(dtype=Wide)  # [m]
        turning: wp.array2d(dtype=Turn)  # [1/s]
        speed: wp.array2d(dtype=Wide)  # [m/s]
        # Second derivatives at the frame's end, one per drive:
        bending: wp.array(dtype=Turn)  # [1/s²]
        push: wp.array(dtype=Wide)  # [m/s²]
        ahead: int  # row offset from the velocity before a stage to the velocity after it
        # Work on each driven particle [J], shape [2, driven count], to be summed: of all forces so far, and of the
        # next force with the current velocity, estimated from the last force
        done: wp.array2d(dtype=wp.float64)

    def drive(SceneData: Any) -> Driving:
        @wp.func
        def holds(scene: SceneData, i: int) -> bool:
            return scene.drives.entry[i] >= 0

        @wp.func
        def velocity(scene: SceneData, e: int, row: int) -> Wide:
            d = scene.drives.drive[e]
            return scene.drives.turning[row, d] * scene.drives.start[e] + scene.drives.speed[row, d]

        @wp.func
        def acceleration(scene: SceneData, force: V, i: int) -> V:
            e = scene.drives.entry[i]
            if e < 0:
                return V()
            row = scene.stage
            before = scene.worked.weight[row]
            after = scene.worked.weight_of_last[row]
            # False at a frame's end, and where half a kick looks ahead.
            if after != wp.float64(0.0) or (scene.drives.ahead == 0 and before != wp.float64(0.0)):
                f = Wide(force)
                half = after * wp.dot(f, velocity(scene, e, row + scene.drives.ahead))
                now = before * wp.dot(f, velocity(scene, e, row)) + half
                scene.drives.done[0, e] = scene.drives.done[0, e] - now
                scene.drives.done[1, e] = -half
            d = scene.drives.drive[e]
            return V(scene.drives.bending[d] * scene.drives.start[e] + scene.drives.push[d])

        @wp.func
        def way_between(scene: SceneData, e: int, begin: int, end: int) -> Wide:
            d = scene.drives.drive[e]
            turned = scene.drives.turn[end, d] - scene.drives.turn[begin, d]
            return turned * scene.drives.start[e] + (scene.drives.shift[end, d] - scene.drives.shift[begin, d])

        @wp.func
        def way(scene: SceneData, i: int, begin: int, end: int) -> V:
            return V(way_between(scene, scene.drives.entry[i], begin, end))

        @wp.func
        def holds_out(scene: SceneData, force: V, i: int, begin: int, end: int):
            e = scene.drives.entry[i]
            work = wp.dot(Wide(force), way_between(scene, e, begin, end))
            scene.drives.done[0, e] = scene.drives.done[0, e] - work

        @wp.func
        def place(scene: SceneData, e: int) -> Wide:
            row = scene.stage + 1
            d = scene.drives.drive[e]
            return scene.drives.turn[row, d] * scene.drives.start[e] + scene.drives.shift[row, d]

        @wp.func
        def at_stage(scene: SceneData, compensation: Compensation, x: V, v: V, i: int):
            e = scene.drives.entry[i]
            if e >= 0:
                exact = place(scene, e)
                if wp.static(compensated):  # readers subtract the compensation of the substep's start
                    exact += Wide(load(compensation.x, i))
                x = V(exact)
                v = V(velocity(scene, e, scene.stage + 1))
            return x, v

        @wp.func
        def at_end(scene: SceneData, compensation: Compensation, x: V, v: V, i: int):
            e = scene.drives.entry[i]
            if e >= 0:
                exact = place(scene, e)
                x = V(exact)
                fast = velocity(scene, e, scene.stage + 1)
                v = V(fast)
                if wp.static(compensated):
                    store(compensation.x_out, i, V(Wide(x) - exact))
                    store(compensation.v, i, V(Wide(v) - fast))
            return x, v

        return Driving(holds, acceleration, way, holds_out, at_stage, at_end)

    return ForceTerm("drives", Drives, drive=drive, timed=True)
