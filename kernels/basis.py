"""The vector type of kernels, and their declaration."""

import warp as wp


def vector(dim: int, scalar: type):
    """Return Warp's vector type of `dim` coordinates (1, 2 or 3) of type `scalar`."""
    return wp.types.vector(dim, scalar)


def kernel(function, **options):
    """Declare `function` as a forward-only Warp kernel in a module of its own, with options of `wp.kernel`.

    With its own module a kernel is compiled at its first launch, and not again when other kernels are composed.
    Kernels with equal source code and equal terms share one cache entry.
    """
    return wp.kernel(function, module="unique", enable_backward=False, **options)


def fast_kernel(function, **options):
    """Declare a kernel as `kernel` does, whose divisions and roots of float32 on a GPU are a few times as fast.

    They are wrong by up to two units in the last place, instead of half a unit; and what is below 1e-38 is 0. For
    contact between bodies, which has many of them: its distances are rounded far more coarsely.
    """
    return kernel(function, module_options={"fast_math": True}, **options)


def fully_hashed(function):
    """Declare `function` as a Warp function all of whose constants count in the hash by which Warp knows kernels.

    Warp finds values of `wp.static` that depend on the variable of a loop only when it generates code, and until
    then its hash lacks them. So functions that differ in nothing else would share a kernel, and a kernel would be
    compiled again in a process that had loaded others from the cache. Here code is generated at once.
    """
    declared = wp.func(function)
    declared.build(None)
    return declared


def as_function(of):
    """Return the source of a kernel as a function that other kernels can call.

    The source must use `grid_thread` instead of `wp.tid`.
    """
    return wp.func(of.func)
