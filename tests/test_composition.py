"""Kernels hold only what a scene needs, as the C++ that is generated for them shows."""

import re
from pathlib import Path

import pytest
import warp as wp

from msdwarp import Plane, Simulation, System, chain
from msdwarp.dynamics import Dynamics
from msdwarp.kernels.basis import vector
from msdwarp.kernels.contact import plane_contact
from msdwarp.kernels.forces import gather, scatter
from msdwarp.kernels.integrate import particle_acceleration, symplectic_euler
from msdwarp.kernels.motion import Motion
from msdwarp.kernels.stay import stay
from msdwarp.kernels.stencil import stencil
from msdwarp.model import Model

PLAIN = chain(3)
FULL = chain(3, damping=1.0).pin(0)
ROUTES = ("scatter", "gather", "stencil")


def motion(system: System, **options) -> Motion:
    return Dynamics(Model(system, device="cpu", **options)).motion


def statements(kernel: wp.Kernel) -> str:
    """Return what a kernel that has run on the CPU computes: the statements of its generated C++.

    Declarations and comments are left out, and so is the frame that Warp puts around every kernel.
    """
    name = kernel.module.get_module_identifier(1)  # the CPU's block size
    source = (Path(wp.config.kernel_cache_dir) / name / f"{name}.cpp").read_text()
    return "\n".join(re.findall(r"^ +(?:var_\d+ = .*|if \(var_.*|[\w:]+\(.*\);)$", source, re.MULTILINE))


@pytest.fixture(scope="module", params=ROUTES)
def sources(request) -> dict[str, str]:
    """The statements of a substep of a scene with every effect and of one with none, on every route."""
    found = {}
    for name, system, planes in (("full", FULL, [Plane()]), ("plain", PLAIN, [])):
        options = {"colliders": planes, "device": "cpu", "route": request.param}
        Simulation(system, substeps=1, **options).step()
        found[name] = statements(
            stay(motion(system, **{k: options[k] for k in ("colliders", "route")}), symplectic_euler, 1)
        )
    return found


@pytest.mark.parametrize(
    ("piece", "meaning"),
    [
        ("__collide_", "contact"),
        ("__respond_", "the contact rule"),
        ("(var_v, ", "reading velocities of neighbours"),
        ("wp::dot(var_dv, ", "the speed along the axis, for the damper"),
    ],
)
def test_kernels_hold_only_what_a_scene_needs(sources, piece, meaning):
    assert piece in sources["full"], f"{meaning} is missing where it is needed"
    assert piece not in sources["plain"], f"{meaning} is compiled though nothing needs it"


def test_only_a_pinned_particle_is_tested_for(sources):
    assert sources["full"].count(" == ") == sources["plain"].count(" == ") + 1


def test_statements_are_all_found(sources):
    # Both kernels hold what every scene needs, so that an absence above is one.
    for code in sources.values():
        for piece in ("(var_x, ", "wp::dot(var_dx, ", "__rsqrt_", "__force_at_", "__store_"):
            assert piece in code


def test_equal_scenes_share_kernels():
    scenes = (
        (FULL, [Plane()]),
        (FULL.replace(stiffness=5.0, mass=[1, float("inf"), 2]), [Plane(friction=0.1), Plane()]),
    )
    for route in ROUTES:
        a, b = (motion(system, colliders=planes, route=route) for system, planes in scenes)
        assert a == b
        assert symplectic_euler(a) is symplectic_euler(b)
        assert stay(a, symplectic_euler, 1) is stay(b, symplectic_euler, 1)
    assert vector(3, wp.float32) is vector(3, wp.float32)


def test_lattices_of_any_size_share_kernels():
    long, short = (motion(chain(count, spacing=0.3), route="stencil") for count in (3, 50))
    assert stay(long, symplectic_euler, 1) is stay(short, symplectic_euler, 1)


def test_different_effects_are_different_kernels():
    plain = motion(PLAIN)
    others = [
        motion(FULL),
        motion(PLAIN, colliders=[Plane()]),
        motion(PLAIN, colliders=[Plane()], contact="report"),
        motion(PLAIN, precision="float64"),
        motion(PLAIN, precision="float32-compensated"),
        motion(chain(3, dim=2)),
        motion(PLAIN, route="gather"),
        motion(PLAIN, route="stencil"),
    ]
    assert len({stay(m, symplectic_euler, 1) for m in (plain, *others)}) == 9
    # A contact rule without colliders is none.
    assert motion(PLAIN, contact="report") == plain


def test_pieces_are_composed_once():
    arguments = (3, wp.float32, True, False)
    assert scatter(*arguments, "one") is scatter(*arguments, "one")
    assert gather(*arguments, "kinds") is gather(*arguments, "kinds")
    steps = ((1, 0, 0),)
    assert stencil(*arguments, steps, True) is stencil(*arguments, steps, True)
    assert stencil(*arguments, steps, True) is not stencil(*arguments, steps, False)
    assert particle_acceleration(motion(FULL)) is particle_acceleration(motion(FULL))
    assert plane_contact(3, wp.float32, "coulomb") is plane_contact(3, wp.float32, "coulomb")
