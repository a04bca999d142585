"""The force of a spring with its damper.

`spring_laws.py` has laws of springs, `dampers.py` laws of dampers, `linearised.py` the stiffness, and
`reductions/measure.py` the energy.
"""

import functools

import warp as wp

from ..basis import vector
from .dampers import LINEAR, damper_force, law_numbers
from .spring_laws import Laws, spring_stress

RSQRT = """
#if defined(__CUDA_ARCH__)
    {cuda}
#else
    return decltype(x)(1) / wp::sqrt(x);
#endif
"""
RSQRT_FLOAT = 'float r; asm("rsqrt.approx.ftz.f32 %0, %1;" : "=f"(r) : "f"(x)); return r;'
PRODUCT = """
#if defined(__CUDA_ARCH__)
    return {cuda}(a, b);
#else
    return a * b;
#endif
"""
TINY = {wp.float32: 1.2e-38, wp.float64: 1e-300}
"""Added to squared lengths [m²]: coincident particles, which have no axis, then exert no force: q·0 = 0."""


@functools.cache
def inverse_root(scalar: type):
    """Compose 1/√x; in float32 on a GPU it is one instruction (with an error of 2 units in the last place)."""
    cuda = RSQRT_FLOAT if scalar is wp.float32 else "return rsqrt(x);"

    @wp.func_native(RSQRT.format(cuda=cuda))
    def rsqrt(x: scalar) -> scalar: ...

    return rsqrt


@functools.cache
def product(scalar: type):
    """Compose a·b with separate rounding, never fused with a sum.

    Whether a compiler fuses a product with a sum depends on the rest of a kernel, for example if it moves the
    product out of a loop. But a spring must exert the same force in each kernel, to the last bit.
    """

    @wp.func_native(PRODUCT.format(cuda="__fmul_rn" if scalar is wp.float32 else "__dmul_rn"))
    def rounded(a: scalar, b: scalar) -> scalar: ...

    return rounded


@functools.cache
def spring_damper(dim: int, scalar: type, laws: Laws):
    """Compose the force density q of a spring: its force on its first particle is −q Δx (2014 report, eq. 7).

    F = (−k (|Δx| − l0) − b Δv·Δx̂) Δx̂ with Δx = x_i − x_j, Δv = v_i − v_j and Δx̂ = Δx/|Δx|; the second particle
    gets −F. Another damping law replaces b Δv·Δx̂; without a damper this part is not compiled. Another spring law
    replaces k (|Δx| − l0) by k l0 s(|Δx|/l0 − 1). For springs that bear only tension, a damper's force is at most
    the spring's. Unless `laws` are linear, the last argument has the numbers of the law, or of all laws; then the
    argument before is the number of this spring's law.
    """
    V, Numbers, (damper, spring, _) = vector(dim, scalar), law_numbers(scalar), laws
    rsqrt, rounded = inverse_root(scalar), product(scalar)
    damped, tiny = damper is not None, TINY[scalar]
    stress, resistance = spring_stress(scalar, spring or LINEAR), damper_force(scalar, laws)

    if laws.linear:

        @wp.func
        def force_density(dx: V, dv: V, rest_length: scalar, stiffness: scalar, damping: scalar) -> scalar:
            inverse_length = rsqrt(wp.dot(dx, dx) + scalar(tiny))
            tension = rounded(-stiffness, rest_length)  # without k |Δx|, which adds k to the density
            if wp.static(damped):
                tension += damping * (wp.dot(dv, dx) * inverse_length)
            return stiffness + tension * inverse_length

        return force_density

    @wp.func
    def force_density(
        dx: V, dv: V, rest_length: scalar, stiffness: scalar, damping: scalar, law: Numbers
    ) -> scalar:
        inverse_length = rsqrt(wp.dot(dx, dx) + scalar(tiny))
        strain = wp.dot(dx, dx) * inverse_length / rest_length - scalar(1.0)
        pull = rounded(-stiffness, rest_length)
        if wp.static(spring is not None):
            pull = rounded(stiffness, rest_length) * stress(strain, law)
        if wp.static(damped):
            pull += resistance(strain, wp.dot(dv, dx) * inverse_length, damping, pull, law)
        if wp.static(spring is None):
            return stiffness + pull * inverse_length
        return pull * inverse_length

    Table = wp.array(dtype=Numbers)

    @wp.func
    def one_of(dx: V, dv: V, l0: scalar, k: scalar, b: scalar, number: scalar, law: Table) -> scalar:
        return force_density(dx, dv, l0, k, b, law[int(number)])

    return one_of if laws.several else force_density
