"""Kernels hold only what a scene needs, as the C++ that is generated for them shows."""

import re
from pathlib import Path

import pytest
import warp as wp

from msdwarp import Plane, Simulation, chain
from msdwarp.dynamics import Dynamics
from msdwarp.forces import Scatter
from msdwarp.kernels.basis import vector
from msdwarp.kernels.contact import plane_contact
from msdwarp.kernels.integrate import symplectic_euler
from msdwarp.kernels.motion import particle_acceleration
from msdwarp.kernels.scatter import scatter, scattered_force
from msdwarp.model import Model

PLAIN = chain(3)
FULL = chain(3, damping=1.0).pin(0)


def statements(kernel: wp.Kernel) -> str:
    """Return what a kernel that has run on the CPU computes: the statements of its generated C++.

    Declarations are left out, and so is the frame that Warp puts around every kernel.
    """
    name = kernel.module.get_module_identifier(1)  # the CPU's block size
    source = (Path(wp.config.kernel_cache_dir) / name / f"{name}.cpp").read_text()
    return "\n".join(re.findall(r"^ +(?:var_\d+ = .*|if \(var_.*|[\w:]+\(.*\);)$", source, re.MULTILINE))


@pytest.fixture(scope="module")
def sources() -> dict[str, tuple[str, str]]:
    """The statements of (scatter, integrator) of a scene with every effect and of one with none."""
    found = {}
    for name, system, planes in (("full", FULL, [Plane()]), ("plain", PLAIN, [])):
        Simulation(system, colliders=planes, device="cpu", substeps=1).step()
        model = Model(system, colliders=planes, device="cpu")
        found[name] = (
            statements(Scatter(model, Dynamics(model).lost.x).kernel),
            statements(symplectic_euler(Dynamics(model).motion)),
        )
    return found


SCATTER, INTEGRATOR = 0, 1


@pytest.mark.parametrize(
    ("kernel", "piece", "meaning"),
    [
        (SCATTER, "wp::dot(", "the speed along the axis, for the damper"),
        (SCATTER, "(var_v, ", "reading velocities"),
        (SCATTER, "(var_damping, ", "reading or using damper constants"),
        (INTEGRATOR, "__collide_", "contact"),
        (INTEGRATOR, "wp::dot(", "distances and normal speeds"),
        (INTEGRATOR, " == ", "the test for a pinned particle"),
        (INTEGRATOR, "if (", "a branch of any kind"),
    ],
)
def test_kernels_hold_only_what_a_scene_needs(sources, kernel, piece, meaning):
    assert piece in sources["full"][kernel], f"{meaning} is missing where it is needed"
    assert piece not in sources["plain"][kernel], f"{meaning} is compiled though nothing needs it"


def test_statements_are_all_found(sources):
    # Both kernels hold what every scene needs, so that an absence above is one.
    for scatter_code, integrator_code in sources.values():
        assert "wp::length(" in scatter_code
        assert scatter_code.count("wp::atomic_") == 2
        assert integrator_code.count("wp::array_store(") == 3  # x, v and the force set to zero
        assert "force_at" in integrator_code


def test_equal_scenes_share_kernels():
    motions = [
        Dynamics(Model(system, colliders=planes, device="cpu")).motion
        for system, planes in (
            (FULL, [Plane()]),
            (FULL.replace(stiffness=5.0, mass=[1, float("inf"), 2]), [Plane(friction=0.1), Plane()]),
        )
    ]
    assert motions[0] == motions[1]
    assert symplectic_euler(motions[0]) is symplectic_euler(motions[1])
    assert scatter(3, wp.float32, True, False) is scatter(3, wp.float32, True, False)
    assert vector(3, wp.float32) is vector(3, wp.float32)


def test_different_effects_are_different_kernels():
    def motion(system, **options):
        return Dynamics(Model(system, device="cpu", **options)).motion

    plain = motion(PLAIN)
    others = [
        motion(FULL),
        motion(PLAIN, colliders=[Plane()]),
        motion(PLAIN, colliders=[Plane()], contact="report"),
        motion(PLAIN, precision="float64"),
        motion(PLAIN, precision="float32-compensated"),
        motion(chain(3, dim=2)),
    ]
    assert len({symplectic_euler(m) for m in (plain, *others)}) == 7
    assert scatter(3, wp.float32, True, False) is not scatter(3, wp.float32, False, False)
    # A contact rule without colliders is none.
    assert motion(PLAIN, contact="report") == plain


def test_pieces_are_composed_once():
    Forces, force_at = scattered_force(3, wp.float32)
    arguments = (3, wp.float32, Forces, force_at, False)
    assert particle_acceleration(*arguments) is particle_acceleration(*arguments)
    assert plane_contact(3, wp.float32, "coulomb") is plane_contact(3, wp.float32, "coulomb")
