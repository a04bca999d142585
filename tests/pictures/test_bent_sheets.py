"""Sheets that resist bending: what joins second neighbours is not drawn, as it would hide what it lies along."""

import numpy as np

from msdwarp import Look, Scene, System, sheet
from msdwarp.pictures.drawing import Drawing


def drawn(system: System) -> Drawing:
    return Drawing(Scene(system=system, look=Look(texture=None)), "strain")


def test_springs_to_second_neighbours_are_not_drawn():
    plain, bent = sheet((5, 4)), sheet((5, 4), bending=20.0)
    np.testing.assert_array_equal(bent.connections[bent.between_neighbours], plain.connections)
    assert plain.between_neighbours is None
    assert len(drawn(bent).triangles) == len(drawn(plain).triangles)
    both = plain + bent
    np.testing.assert_array_equal(
        both.between_neighbours, np.append(np.ones(plain.connection_count, bool), bent.between_neighbours)
    )


def test_directions_of_other_names_are_drawn():
    named = sheet((3, 3)).replace(directions=({"layer 2": slice(0, 6), "x2": slice(6, 9)},))
    assert named.between_neighbours is None
