"""Kernels hold only what a scene needs, as the C++ that is generated for them shows."""

import ast
import hashlib
import re
from pathlib import Path

import pytest
import warp as wp

import msdwarp.kernels
from msdwarp import (
    Box,
    Capsule,
    Cone,
    CoulombDamper,
    Plane,
    QuadraticDamper,
    Simulation,
    Sphere,
    System,
    box,
    chain,
)
from msdwarp.engine.stepping.assemble import assemble
from msdwarp.engine.stepping.dynamics import Dynamics
from msdwarp.kernels.basis import vector
from msdwarp.kernels.integrators.composition import Composition
from msdwarp.kernels.integrators.euler import symplectic_euler
from msdwarp.kernels.integrators.persistent import persistent
from msdwarp.kernels.integrators.stages import each_connection, each_particle
from msdwarp.world import Problem

PLAIN = chain(3)
FULL = chain(3, damping=1.0).pin(0)
FORCE_ALGORITHMS = ("scatter", "gather", "stencil")


def motion(system: System, colliders=(), **options) -> Composition:
    return Dynamics(assemble(Problem(system=system, colliders=colliders), device="cpu", **options)).composition


def generated(kernel: wp.Kernel) -> str:
    """Return the C++ that Warp generates for a kernel, which is not compiled."""
    from warp._src.context import ModuleBuilder  # as Module._compile does it in Warp 1.19

    module, block = kernel.module, 1  # the CPU's block size
    module.get_module_identifier(block)
    options = module.resolve_options(wp.config, block_dim=block) | {"output_arch": None, "block_dim": block}
    return ModuleBuilder(module, options, hasher=module.hashers[block], target="cpu").codegen("cpu")


def substep(system: System, method=symplectic_euler, **options) -> wp.Kernel:
    """Return the kernel of a method's substeps on the CPU."""
    return persistent(motion(system, **options), method, 1)


@pytest.mark.parametrize("force_algorithm", FORCE_ALGORITHMS)
def test_what_is_composed_here_is_what_a_simulation_runs(force_algorithm):
    options = {"colliders": [Plane()], "force_algorithm": force_algorithm}
    Simulation(FULL, substeps=1, allow_unstable=True, device="cpu", **options).step()
    kernel = substep(FULL, **options)
    name = kernel.module.get_module_identifier(1)
    ran = (Path(wp.config.kernel_cache_dir) / name / f"{name}.cpp").read_text(encoding="utf-8")
    assert normalised(ran) == normalised(generated(kernel))


def test_threads_of_a_single_world_are_counted_in_one_dimension():
    # Warp counts by the most dimensions that any branch of a kernel asks for. With two, each thread divides to
    # find its place: that cost 3 % of a substep on a GPU, and statements do not show it.
    composed = motion(FULL, colliders=[Plane()])
    kernels = [each_particle(composed, symplectic_euler), persistent(composed, symplectic_euler, 1)]
    kernels += [each_connection(motion(FULL, force_algorithm="scatter"))]
    for kernel in kernels:
        assert "wp::launch_bounds_t<1>" in generated(kernel)
        assert "wp::launch_bounds_t<2>" not in generated(kernel)


def is_of_loop(node: ast.AST, variable: str) -> bool:
    """Return whether a node is a `wp.static` of a loop's variable."""
    names = {one.id for one in ast.walk(node) if isinstance(one, ast.Name)}
    return isinstance(node, ast.Call) and ast.unparse(node.func) == "wp.static" and variable in names


def test_functions_with_values_of_loops_are_declared_as_fully_hashed():
    found = {"wp.func": 0, "fully_hashed": 0}
    for path in Path(msdwarp.kernels.__path__[0]).rglob("*.py"):
        for one in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            declared = ast.unparse(one.decorator_list[0]) if getattr(one, "decorator_list", []) else ""
            loops = [node for node in ast.walk(one) if isinstance(node, ast.For)]
            if declared in found and any(
                is_of_loop(n, ast.unparse(loop.target)) for loop in loops for n in ast.walk(loop)
            ):
                found[declared] += 1
    assert found["fully_hashed"] >= 5
    assert found["wp.func"] == 0


def test_equal_scenes_share_kernels():
    scenes = (
        (FULL, [Plane(), Plane()]),
        (FULL.replace(stiffness=5.0, mass=[1, float("inf"), 2]), [Plane(friction=0.1), Plane()]),
    )
    for force_algorithm in FORCE_ALGORITHMS:
        a, b = (motion(system, colliders=planes, force_algorithm=force_algorithm) for system, planes in scenes)
        assert a == b
        assert symplectic_euler(a) is symplectic_euler(b)
        assert persistent(a, symplectic_euler, 1) is persistent(b, symplectic_euler, 1)
    assert vector(3, wp.float32) is vector(3, wp.float32)


def test_different_effects_are_different_kernels():
    plain = motion(PLAIN)
    others = [
        motion(FULL),
        motion(PLAIN, colliders=[Plane()]),
        motion(PLAIN, colliders=[Plane()], collider_rule="report"),
        motion(PLAIN, precision="float64"),
        motion(PLAIN, precision="float32-compensated"),
        motion(chain(3, dim=2)),
        motion(PLAIN, force_algorithm="gather"),
        motion(PLAIN, force_algorithm="stencil"),
    ]
    assert len({persistent(m, symplectic_euler, 1) for m in (plain, *others)}) == 9
    # A contact rule without colliders is none.
    assert motion(PLAIN, collider_rule="report") == plain


# How many statements a substep has, and a digest of them without the numbers of their variables.
BEFORE = {
    ("plain", "scatter"): (227, "9443a6eb45ec08fc"),
    ("plain", "gather"): (232, "cc3a46a147eb7d80"),
    ("damped", "gather"): (239, "13b4fdef12626283"),
    ("damped", "stencil"): (232, "cdb2979c6d410d51"),
    ("box", "stencil"): (811, "ae123bb2def789bc"),
}
SYSTEMS = {"plain": PLAIN, "damped": FULL, "box": box((3, 3, 3), damping=1.0)}
GENERATED_BY = "1.19.0"


def normalised(code: str) -> str:
    """Return the statements of a kernel and of its functions, without what merely numbers them."""
    pattern = r"^ +(?:var_\w+ = .*|if \(var_.*|[\w:]+\(.*\);|return .*)$"
    lines = [line.strip() for line in re.findall(pattern, code, re.MULTILINE)]
    text = re.sub(r"\bvar_\d+\b", "_", "\n".join(lines))
    # Of `factory__locals__function_0123abcd` the function's name is kept: what composed it does not matter.
    return re.sub(r"\w*__locals__(\w+?)_(?:[0-9a-f]{8}\w*|\d+)\b", r"@\1", text)


@pytest.mark.skipif(
    wp.__version__ != GENERATED_BY,
    reason=f"Warp {GENERATED_BY} wrote what is compared; others may word it otherwise",
)
@pytest.mark.parametrize(("name", "force_algorithm"), BEFORE)
def test_what_a_scene_does_not_use_has_left_its_kernels_as_they_were(name, force_algorithm):
    text = normalised(generated(substep(SYSTEMS[name], force_algorithm=force_algorithm)))
    found = len(text.splitlines()), hashlib.sha256(text.encode()).hexdigest()[:16]
    assert found == BEFORE[name, force_algorithm]


def pieces(system: System, **options) -> set[str]:
    """Return the names of the functions and structs that a substep is composed from."""
    return set(re.findall(r"@(\w+)", normalised(generated(substep(system, **options)))))


DAMPED = chain(3, damping=1.0)
TOUCH = {"Surface", "Solids", "collide", "put_back", "respond", "result"}
FIXED, MOVING = TOUCH | {"Obstacles"}, TOUCH | {"MovingObstacles", "add_work"}
# A plane cannot be passed; what can be is swept.
SWEPT = {"passes", "sweep_way", "first_on_way", "enter", "look", "carried", "answer"}
# Between several there are corners.
CORNER = {"settle", "speed"}
AT = (0, 0, -9)
KINDS_ALONE = ["plane", "sphere", "box", "capsule", "cone"]


@pytest.mark.parametrize("force_algorithm", ["scatter", "gather"])
@pytest.mark.parametrize(
    ("changes", "colliders", "more"),
    [
        ({"yield_strain": 0.1}, [], {"Flow", "flow", "begin_all", "data_of_effect", "take_data"}),
        ({"damper": QuadraticDamper()}, [], {"force"}),
        ({"damper": CoulombDamper()}, [], {"force"}),
        ({}, [Plane()], FIXED | {"plane"}),
        ({}, [Sphere(AT)], FIXED | SWEPT | {"sphere", "from_point"}),
        ({}, [Box(AT)], FIXED | SWEPT | {"box"}),
        ({}, [Capsule(AT, (1, 0, -9))], FIXED | SWEPT | {"capsule", "from_point"}),
        ({}, [Cone(AT, (1, 0, -9))], FIXED | SWEPT | {"cone"}),
        ({}, [Sphere(AT), Box(AT)], FIXED | SWEPT | CORNER | {"distance", "plane", "sphere", "from_point", "box"}),
        ({}, [Plane(motion=lambda t: (0, 0, -t))], MOVING | {"plane"}),
        ({}, [Sphere(AT, motion=lambda t: (0, 0, -t))], MOVING | SWEPT | {"sphere", "from_point"}),
    ],
    ids=["yielding", "quadratic", "coulomb", *KINDS_ALONE, "two kinds", "moving", "moving sphere"],
)
@pytest.mark.each_value
def test_each_effect_brings_its_own_pieces_alone(force_algorithm, changes, colliders, more):
    without = pieces(DAMPED, force_algorithm=force_algorithm)
    found = pieces(DAMPED.replace(**changes), colliders=colliders, force_algorithm=force_algorithm)
    # Where springs yield their constants lie elsewhere.
    elsewhere = {"SceneData", "OneForAll", "take_one", "Own", "take_own", "number"}
    assert found - without - elsewhere == more
    assert without - found <= elsewhere


def test_laws_share_a_kernel_if_they_differ_by_numbers_alone():
    laws = QuadraticDamper(1.0), QuadraticDamper(2.0), CoulombDamper(1.0), CoulombDamper(2.0)
    quadratic, same, coulomb, this = (substep(DAMPED.replace(damper=law)) for law in laws)
    assert quadratic is same
    assert coulomb is this
    assert quadratic.module.get_module_identifier(1) != coulomb.module.get_module_identifier(1)


def test_kinds_of_obstacles_are_told_apart():
    # What differs by which kinds there are must not be taken for the same kernel.
    kernels = [
        substep(DAMPED, colliders=pair)
        for pair in (
            [Plane(), Sphere(AT)],
            [Plane(), Box(AT)],
            [Sphere(AT), Box(AT)],
            [Plane(), Cone(AT, (1, 0, -9))],
        )
    ]
    assert len({kernel.module.get_module_identifier(1) for kernel in kernels}) == len(kernels)
