"""Five masses in a row, the first pulled out, in one dimension; from the 2014 report msdwarp is based on."""

import numpy as np

from msdwarp import Look, Scene, chain
from msdwarp.cli import scene_main


def build(*, count: int = 5, stiffness: float = 30.0, damping: float = 1.0, pull: float = 1.5) -> Scene:
    """Release a chain of 1 kg masses with the first one pulled out.

    Parameters
    ----------
    count
        Number of masses.
    pull
        Displacement of the first mass [m].
    """
    row = chain(count, 1.0, stiffness=stiffness, damping=damping, dim=1)
    row = row.translate(1.0 - row.position[0])  # at 1, 2, 3 ... m
    position = np.array(row.position)
    position[0] -= pull
    look = Look(strain=True, azimuth=-90, elevation=12, full_strain=0.5)
    return Scene(system=row.replace(position=position), gravity=0.0, duration=12.5, look=look)


if __name__ == "__main__":
    scene_main(build)
