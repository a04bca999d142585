"""What every kernel shares: the vector type, and how a kernel is declared."""

import warp as wp


def vector(dim: int, scalar: type):
    """Return Warp's vector type of `dim` coordinates (1, 2 or 3) of type `scalar`."""
    return wp.types.vector(dim, scalar)


def kernel(function, **options):
    """Declare `function` as a forward-only Warp kernel in a module of its own, with options of `wp.kernel`.

    A module of its own means that a kernel is compiled when it is first launched and never because
    another one was composed; kernels with the same source and the same pieces share one cache entry.
    """
    return wp.kernel(function, module="unique", enable_backward=False, **options)
