"""Sums over connections for probes, in float64: strains, tensions and virials."""

import functools

import warp as wp

from ..basis import fully_hashed, vector
from ..springs.dampers import LINEAR, damper_force
from ..springs.spring_laws import Laws, connection_table, spring_stress
from .measure import difference
from .probes import COMPONENTS, Sum

SUM, LARGEST, COUNT = 0, 1, 2
"""Columns of sums of strains or tensions: their sum, the largest absolute one, the number of connections."""
SPRING_COLUMNS = 3


@functools.cache
def spring_sums(dim: int, scalar: type) -> tuple[Sum, Sum]:
    """Return the sums of strains of chosen unbroken connections, and of weight · tension · length · n nᵀ."""
    V, components, separation = vector(dim, scalar), COMPONENTS[dim], difference(dim, scalar)
    Stress = wp.types.vector(len(components), wp.float64)

    @wp.struct
    class SpringData:
        # Model, row w mod (number of rows) for world w:
        rest_length: wp.array2d(dtype=scalar)  # [m], shape [rows, connection_count]
        stiffness: wp.array2d(dtype=scalar)  # [N/m], shape [rows, connection_count]
        damping: wp.array2d(dtype=scalar)  # in the units of the law, shape [rows, connection_count]
        # The same in all worlds:
        connections: wp.array(dtype=wp.vec2i)  # two particles each, shape [connection_count]
        tears: int  # whether connections without stiffness and damping are broken
        member: wp.array(dtype=int)  # indices of the chosen connections
        weight: wp.array(dtype=wp.float64)  # fraction of each chosen connection that is counted in the stress
        # State, of all worlds:
        value: wp.array(dtype=V)  # positions [m]
        lost: wp.array(dtype=V)  # compensation of positions [m], or empty
        stride: int  # particles from one world to the next

    @wp.func
    def apart(data: SpringData, w: int, c: int) -> wp.vec3d:
        start = w * data.stride
        return separation(data.value, data.lost, start + data.connections[c][0], start + data.connections[c][1])

    @wp.func
    def strain(data: SpringData, w: int, m: int) -> wp.vec3d:
        c = data.member[m]
        if data.tears != 0:
            stiff = data.stiffness[w % data.stiffness.shape[0], c] != scalar(0.0)
            if not (stiff or data.damping[w % data.damping.shape[0], c] != scalar(0.0)):
                return wp.vec3d()
        rest = wp.float64(data.rest_length[w % data.rest_length.shape[0], c])
        strain = wp.length(apart(data, w, c)) / rest - wp.float64(1.0)
        return wp.vec3d(strain, wp.abs(strain), wp.float64(1.0))

    @fully_hashed
    def virial(data: SpringData, w: int, m: int) -> Stress:
        c = data.member[m]
        dx = apart(data, w, c)
        length = wp.length(dx)
        rest = wp.float64(data.rest_length[w % data.rest_length.shape[0], c])
        density = wp.float64(data.stiffness[w % data.stiffness.shape[0], c]) * (length - rest) * data.weight[m]
        if length > wp.float64(0.0):
            density /= length
        result = Stress()
        for k in range(wp.static(len(components))):
            result[k] = density * (dx[wp.static(components[k][0])] * dx[wp.static(components[k][1])])
        return result

    return Sum(SpringData, strain, SPRING_COLUMNS, LARGEST), Sum(SpringData, virial, len(components))


@functools.cache
def sum_tensions(dim: int, scalar: type, laws: Laws, actuated: bool) -> Sum:
    """Return the sum of tensions of chosen unbroken connections [N]: of spring, damper and actuators."""
    V, separation = vector(dim, scalar), difference(dim, scalar)
    Connected, law_of = connection_table(scalar, laws)
    stress, resistance = spring_stress(wp.float64, laws.spring or LINEAR), damper_force(wp.float64, laws)

    class TensionData:
        connections: Connected
        # The same in all worlds:
        tears: int  # whether connections without stiffness and damping are broken
        member: wp.array(dtype=int)  # indices of the chosen connections
        if actuated:
            strain: wp.array2d(dtype=scalar)  # of actuators, in each stage of a frame
            row: int  # the stage that counts
            columns: int  # of a world; world w has those from w · columns on, mod the number of all
            entries: wp.array(dtype=int)  # row starts of the chosen connections' entries, one for each actuator
            column: wp.array(dtype=int)  # column of `strain` of each entry
        # State, of all worlds:
        value: wp.array(dtype=V)  # positions [m]
        lost: wp.array(dtype=V)  # compensation of positions [m], or empty
        v: wp.array(dtype=V)  # velocities [m/s]
        v_lost: wp.array(dtype=V)  # compensation of velocities [m/s], or empty
        stride: int  # particles from one world to the next

    if actuated:  # generated code needs another name
        TensionData.__qualname__ = TensionData.__qualname__.replace("Tension", "ActuatedTension")
    TensionData = wp.struct(TensionData)

    @wp.func
    def tension(data: TensionData, w: int, m: int) -> wp.vec3d:
        c = data.member[m]
        springs = data.connections
        stiffness = wp.float64(springs.stiffness[w % springs.stiffness.shape[0], c])
        damping = wp.float64(springs.damping[w % springs.damping.shape[0], c])
        if data.tears != 0 and stiffness == wp.float64(0.0) and damping == wp.float64(0.0):
            return wp.vec3d()
        rest = wp.float64(springs.rest_length[w % springs.rest_length.shape[0], c])
        i = w * data.stride + springs.ends[c][0]
        j = w * data.stride + springs.ends[c][1]
        dx = separation(data.value, data.lost, i, j)
        length = wp.length(dx)
        rate = wp.float64(0.0)
        if length > wp.float64(0.0):
            rate = wp.dot(separation(data.v, data.v_lost, i, j), dx) / length
        if wp.static(laws.linear):
            pull = stiffness * (length - rest) + damping * rate
        else:
            strain = length / rest - wp.float64(1.0)
            pull = stiffness * rest * stress(strain, law_of(springs, c))
            pull += resistance(strain, rate, damping, pull, law_of(springs, c))
        if wp.static(actuated):
            start = w * data.columns % data.strain.shape[1]
            for e in range(data.entries[m], data.entries[m + 1]):
                pull -= stiffness * rest * wp.float64(data.strain[data.row, start + data.column[e]])
        return wp.vec3d(pull, wp.abs(pull), wp.float64(1.0))

    return Sum(TensionData, tension, SPRING_COLUMNS, LARGEST)
