"""Springs: the law of a spring and its damper (`law`), and the algorithms that sum the forces on a particle.

An algorithm has a struct, `Forces`, which its kernels read, and a function `force_at` that returns the force on a
particle. Scattered forces (`scatter`) are evaluated in an earlier launch, spring by spring. Gathered forces are
evaluated by `force_at`, from a table of neighbours (`gather`) or, in a lattice, from index offsets (`stencil`). In
compensated precision positions are x − compensation.x, since rounding errors matter in short springs.
"""
