"""Near pairs: the search by boxes lists each pair of a vertex and a triangle, and of two edges, that is near."""

import numpy as np
import pytest
from numpy.typing import NDArray
from surfaces import nearest_distances

from msdwarp import Contact, Simulation, StartWarning, System, box, chain, sheet
from msdwarp.engine.collision.body_contact import BodyContact
from msdwarp.engine.collision.division_planes import DivisionPlanes

CONSTANTS = {"mass": 1e-3, "stiffness": 400.0, "damping": 0.1}


def crumpled() -> System:
    """Return two sheets, two blocks, a rope and three grains, all on each other."""
    rng = np.random.default_rng(4)
    cloth = sheet((7, 7), 0.1, **CONSTANTS)
    x = cloth.position + rng.uniform(-0.09, 0.09, cloth.position.shape)
    whole = cloth.replace(position=x)
    whole += sheet((4, 4), 0.16, **CONSTANTS).rotate(1.1, axis=(1, 0, 0)).translate((0.1, 0.2, -0.1))
    whole += box((3, 3, 3), 0.11, **CONSTANTS).translate((0.2, 0.2, 0.02))
    whole += box((2, 3, 2), 0.12, **CONSTANTS).translate((0.1, 0.38, 0.02))
    whole += chain(9, 0.08, **CONSTANTS).rotate(0.4, axis=(0, 1, 1)).translate((0.0, 0.3, 0.0))
    return whole + System(position=rng.uniform(0.1, 0.5, (3, 3)) * (1.0, 1.0, 0.1), mass=1e-3)


def distances_of_segments(a: NDArray, b: NDArray) -> NDArray[np.float64]:
    """Return the distances between segments, shape [n, 2, 3] each, by going to the nearest point in turn."""
    s = np.zeros(len(a))
    ab, cd = a[:, 1] - a[:, 0], b[:, 1] - b[:, 0]
    for _ in range(300):  # each step divides the error by more than 1 / cos² of the angle between the segments
        p = a[:, 0] + s[:, None] * ab
        t = ((p - b[:, 0]) * cd).sum(axis=1) / np.maximum((cd**2).sum(axis=1), 1e-30)
        t = np.clip(t, 0.0, 1.0)
        q = b[:, 0] + t[:, None] * cd
        s = np.clip(((q - a[:, 0]) * ab).sum(axis=1) / np.maximum((ab**2).sum(axis=1), 1e-30), 0.0, 1.0)
    return np.linalg.norm(a[:, 0] + s[:, None] * ab - q, axis=1)


def all_pairs(effect: BodyContact, x: NDArray) -> tuple[list[tuple], NDArray[np.float64]]:
    """Return all pairs that may be listed, as (vertices of one side, of the other), and their distances [m]."""
    s = effect.surfaces.on_host
    triangle = s.corner[:, 1] != s.corner[:, 2]
    sides = [s.corner[triangle][:, [k, (k + 1) % 3]] for k in range(3)]
    edges = np.unique(np.sort(np.concatenate([*sides, s.corner[~triangle][:, :2]]), axis=1), axis=0)
    grain, bare = edges[:, 0] == edges[:, 1], ~np.isin(edges[:, 0], s.corner[triangle])

    v, c = (k.ravel() for k in np.meshgrid(range(len(s.particle)), np.flatnonzero(triangle), indexing="ij"))
    those = ~(s.corner[c] == v[:, None]).any(axis=1)
    v, c = v[those], s.corner[c[those]]
    i, j = np.triu_indices(len(edges), 1)
    those = ~(edges[i][:, :, None] == edges[j][:, None]).any(axis=(1, 2))
    those &= ~((grain[i] | grain[j]) & ~(bare[i] & bare[j]))
    i, j = i[those], j[those]
    pairs = [((int(a),), tuple(sorted(b))) for a, b in zip(v, c.tolist(), strict=True)]
    ends = [tuple(edge) for edge in edges.tolist()]
    pairs += [tuple(sorted((ends[a], ends[b]))) for a, b in zip(i, j, strict=True)]
    away = [nearest_distances(x[v], x[c]), distances_of_segments(x[edges[i]], x[edges[j]])]
    return pairs, np.concatenate(away)


def listed_pairs(planes: DivisionPlanes) -> list[tuple]:
    """Return the pairs in the list, named as in `all_pairs`."""
    found = []
    for row in planes.pairs.vertices.numpy()[: planes.pairs.count.numpy()[0]].tolist():
        if row[0] < 0:
            found.append(tuple(sorted((tuple(sorted((-1 - row[0], row[1]))), tuple(sorted(row[2:]))))))
        else:
            found.append(((row[0],), tuple(sorted(row[1:]))))
    return found


@pytest.mark.slow
def test_all_near_pairs_are_listed_once(plain_device):
    contact = Contact(self_contact=True, thickness=0.04, stiffness=100.0)
    with pytest.warns(StartWarning):
        simulation = Simulation(crumpled(), contact=contact, device=plain_device)
    effect = simulation.assembly.body_contact
    planes, neighbors = effect.planes, effect.neighbors
    planes.tangles = False  # else those that cross are left out
    s = effect.surfaces.on_host
    x = np.einsum("vk,vkd->vd", s.weight, simulation.frame().position[s.particle])
    pairs, away = all_pairs(effect, x)
    reach = float(neighbors.skin.on_device.numpy()[0]) + planes.activation
    near = {pair for pair, distance in zip(pairs, away, strict=True) if distance < reach}
    # The search looks 1 % further, since positions are rounded.
    nearly = {pair for pair, distance in zip(pairs, away, strict=True) if distance < 1.011 * reach}
    assert {tuple(map(len, pair)) for pair in near} == {(1, 3), (2, 2)}
    assert len(near) > 100
    sides = [(s.body[one[0]], s.body[other[0]]) for one, other in near]
    assert any(s.solid[a] and s.solid[b] and a != b for a, b in sides)
    planes.pairs.near_facets = planes.pairs.near_facets[:5]  # rooms grow until all fit
    neighbors.make_room(simulation.state.x, simulation.state.v)
    listed = listed_pairs(planes)
    assert len(listed) == len(set(listed))
    assert near <= set(listed) <= nearly
