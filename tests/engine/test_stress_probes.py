"""Probes of stress: against Hooke's law, `stress` of all particles, and in an ensemble."""

import numpy as np
import pytest

from msdwarp import Cells, Material, Probe, Simulation, System, ball, box, sheet, stress, von_mises

MODULUS, RATIO = 1e5, 0.4
RUBBER = Material(1000.0, MODULUS, 0.0, RATIO)


def square() -> System:
    """Return four particles in two dimensions, which are the corners of a cell."""
    cells = Cells(corners=[[0, 1, 2, 3]], rest_volume=0.01, modulus=5e4)
    position = [[0.0, 0.0], [0.1, 0.0], [0.1, 0.1], [0.0, 0.1]]
    connections = [[0, 1], [1, 2], [2, 3], [0, 3], [0, 2], [1, 3]]
    return System(position=position, connections=connections, stiffness=1000.0, mass=0.1, cells=cells)


BODIES = {
    "block": lambda: box((5, 4, 4), 0.1, material=RUBBER),
    "ball": lambda: ball(0.3, 0.1, material=RUBBER),
    "sheet": lambda: sheet((5, 6), 0.1, thickness=0.01, material=RUBBER),
    "square": square,
}


def at_end(body: System, on: object, **options) -> tuple[np.ndarray, np.ndarray]:
    """Return the reading after a short frame, and the positions there."""
    simulation = Simulation(body, gravity=0.0, fps=1e6, probes={"part": Probe(on, "stress")}, **options)
    simulation.step()
    return simulation.readings["part"].values[-1], simulation.frame().position


def test_a_stretched_block_has_the_stress_of_hookes_law(device):
    strain, block = 1e-4, BODIES["block"]()
    stretched = block.replace(position=block.position * [1 + strain, 1, 1])
    found, _ = at_end(stretched, slice(None), device=device, precision="float64")
    lame, shear = MODULUS * RATIO / ((1 + RATIO) * (1 - 2 * RATIO)), MODULUS / (2 * (1 + RATIO))
    wanted = strain * np.array([lame + 2 * shear, lame, lame, 0, 0, 0])
    # A body of springs and cells has these moduli at a strain of zero; at this strain it differs by
    # 1e-4 of each. In a microsecond a surface moves by 1e-9 of the spacing.
    np.testing.assert_allclose(found[:6], wanted, rtol=0, atol=3e-4 * wanted[0])
    assert found[6] == pytest.approx(2 * shear * strain, rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in BODIES if name != "block"])
def test_the_mean_over_a_body_is_that_of_its_particles(name, device):
    body, rng = BODIES[name](), np.random.default_rng(1)
    x = 1.02 * body.position + 0.004 * rng.normal(size=body.position.shape)
    body = body.replace(position=x)
    found, x = at_end(body, slice(None), device=device, precision="float64")
    # Particles have means of their cells by volume, so that each cell counts once for each corner.
    cells, each = body.cells, stress(body, x)
    volume = np.abs(cells.volumes(x))
    of_particle = np.zeros(len(x))
    held = cells.corners >= 0
    np.add.at(of_particle, cells.corners[held], np.broadcast_to(volume[:, None], held.shape)[held])
    mean = np.einsum("n,nij->ij", of_particle, each) / of_particle.sum()
    dim = x.shape[1]
    pairs = [(k, k) for k in range(dim)] + [(a, b) for a in range(dim) for b in range(a + 1, dim)]
    # Frames in float64 have positions to the last bit.
    scale = np.abs(mean).max()
    np.testing.assert_allclose(found[:-1], [mean[pair] for pair in pairs], rtol=0, atol=1e-11 * scale)
    assert found[-1] == pytest.approx(float(von_mises(mean)), abs=3e-11 * scale)


def test_a_group_without_cells_has_no_stress():
    plain = box((3, 3, 3), 0.1, stiffness=100.0)
    with pytest.raises(ValueError, match=r"probes\['part'\].on is .*must contain a cell"):
        Simulation(plain, probes={"part": Probe(slice(None), "stress")})
    with pytest.raises(ValueError, match="must contain a cell"):
        Simulation(BODIES["block"](), probes={"part": Probe([0, 1], "stress")})
