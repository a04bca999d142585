"""The table of loads in docs/loads.md: which are taken by which body, and which bodies are drawn torn."""

import re
from pathlib import Path

import numpy as np

import msdwarp as msd
from msdwarp.pictures.dressing import torn
from msdwarp.world import Problem

LOADS = Path(__file__).parents[1] / "docs" / "loads.md"
SPRINGS = {"mass": 0.01, "stiffness": 300.0, "damping": 0.3}
ROUND = msd.icosphere(0.2, 1)
BODIES = {
    "chain": lambda: msd.chain(4, 0.1, **SPRINGS),
    "rod": lambda: msd.rod(4, 0.1, radius=0.01, material=msd.STEEL_WIRE),
    "sheet(...).replace(surface=None)": lambda: msd.sheet((3, 3), 0.1, **SPRINGS).replace(surface=None),
    "sheet": lambda: msd.sheet((3, 3), 0.1, **SPRINGS),
    "cloth": lambda: msd.cloth([(0, 0), (0.4, 0), (0.4, 0.4), (0, 0.4)], 0.1, **SPRINGS),
    "disc": lambda: msd.shell(msd.disc(0.2, 3), stiffness=100.0),
    "icosphere": lambda: msd.shell(ROUND, stiffness=100.0),
    "box": lambda: msd.box((3, 3, 3), 0.1, **SPRINGS),
    "lattice": lambda: msd.lattice(np.ones((2, 2, 2), dtype=bool), 0.1, **SPRINGS),
    "voxels": lambda: msd.voxels(np.ones((2, 2, 2), dtype=int), 0.1, materials={1: msd.FOAM}),
    "ball": lambda: msd.ball(0.2, 0.1, **SPRINGS),
    "cone": lambda: msd.cone(0.2, 0.3, 0.1, **SPRINGS),
    "cylinder": lambda: msd.cylinder(0.2, 0.2, 0.1, **SPRINGS),
    "from_mesh": lambda: msd.from_mesh(ROUND, across=4, **SPRINGS),
    "System": lambda: msd.System(position=np.eye(3), connections=np.empty((0, 2), dtype=int), mass=0.01),
    "dimensions": lambda: msd.sheet((3, 3), 0.1, dim=2, **SPRINGS),
}


def acts(body: msd.System, load: msd.Load) -> bool:
    """Return whether a simulation takes a load on a body."""
    try:
        Problem(body, loads=[load])
    except ValueError:
        return False
    return True


def test_the_table_of_loads_says_which_are_taken_by_which_body():
    page = LOADS.read_text(encoding="utf-8")
    (table,) = re.findall(r"\| body \|.*\n\|---.*\n((?:\|.*\n)+)", page)
    seen = set()
    for row in table.splitlines():
        name, *said = (cell.strip() for cell in row.strip("|").split("|"))
        for which in [one for one in BODIES if f"`{one}`" in name] or ["dimensions"] * ("dimensions" in name):
            body = BODIES[which]()
            up = np.eye(body.dim)[-1]
            steady = [msd.Force(up), msd.PrescribedMotion([0]), msd.Attachment([0], stiffness=1.0)]
            wind = "yes" if acts(body, msd.Wind(up)) else "`area=`" * acts(body, msd.Wind(up, area=0.01))
            others = (msd.Pressure(1.0), msd.EnclosedGas(1.0), msd.Actuator(lambda t: 0.1 * np.sin(t)))
            cut = body.replace(break_strain=0.1, broken_at=np.ones(body.connection_count))
            gone = torn(cut)  # None where there are no triangles: connections are drawn then
            parts = body.connection_count > 0 if gone is None else np.isfinite(gone.parted_at).all()
            yes = [all(acts(body, one) for one in steady), *(acts(body, one) for one in others), parts]
            found = ["yes" if one else "no" for one in yes]
            assert [found[0], wind, *found[1:]] == said, which
            seen.add(which)
    assert seen == BODIES.keys()
