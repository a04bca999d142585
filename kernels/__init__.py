"""Device side: Warp functions, and factories that compose kernels from them.

Every factory is cached and takes the number of coordinates, the scalar type and the effects that a
scene has; what a scene lacks is not compiled. Nothing here knows of the host side.
"""
