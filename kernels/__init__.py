"""Device side: Warp functions, and factories that compose kernels from them.

Groups: `springs` (the law and the algorithms that sum forces), `colliders` (contact with obstacles), `collision`
(contact between bodies), `loads`, `integrators` (methods; `stages.py` puts kernels together), `reductions`
(energies, bounds), `adjoint` (derivatives of a loss), `pictures`. Every factory is cached and takes the number of
coordinates, the scalar type and the effects of a scene; other effects are not compiled. Nothing here depends on
host code.
"""
