"""Imports point one way, through the faces of rooms, and heavy packages are imported where they belong."""

import ast
import re
import subprocess
import sys

import pytest
from rooms import ROOT, TOP, arrows, file_circles, file_imports, folders, imports, levels, modules, room_of

LAYERS = [
    {"checks", "disk", "kernels", "runtime", "scenes"},
    {"bodies", "textures"},
    {"shapes", "world", "files"},
    {"engine", "pictures"},
    {"integrators"},
    {"simulation"},
    {"studies", "live"},
    {"cli"},
]
"""A room may import what stands in a line before it; one exception stands in ASIDE."""
ASIDE = {("textures", "checks"), (TOP, "*"), ("__main__", "cli")}
APART = {"engine": {"files"}, "pictures": {"files"}}
APART |= {"integrators": {"files", "pictures"}, "simulation": {"files", "pictures"}}
"""What a room never imports though it stands before it: a run knows no disk and no screen, a picture no disk."""
HOSTS_OF_KERNELS = {"engine", "pictures", "integrators"}
LAZY = {"pyvista", "matplotlib", "scipy", "imageio", "h5py", "pxr", "viser", "xarray"}
ONE_PLACE = {
    "pyvista": {"pictures", "files"},
    "vtk": set(),
    "vtkmodules": {"pictures"},
    "h5py": {"files"},
    "pxr": {"files"},
    "cyclopts": {"cli"},
    "rich": {"cli"},
    "matplotlib": {"studies"},
    "viser": {"live"},
    "xarray": {"simulation", "studies"},
}
MOST_ROOMS, MOST_LEVELS, MOST_ARROWS = 19, 9, 75


def within(name):
    """Return the imports of a module from other rooms of the package, as (import, room)."""
    module = modules()[name]
    found = [(item, room_of(item.name)) for item in module.imports if item.name.split(".")[0] == TOP]
    return [(item, room) for item, room in found if room != module.room]


@pytest.mark.slow
def test_reading_imports():
    # The reader itself, on every form that an import can take.
    source = "import msdwarp.engine\nfrom ..kernels.basis import vector\nfrom .base import Integrator\n"
    source += "from msdwarp import Plane\ndef late():\n    import pyvista as pv\n"
    names = [
        "msdwarp.engine",
        "msdwarp.kernels.basis.vector",
        "msdwarp.integrators.base.Integrator",
        "msdwarp.Plane",
    ]
    found = [(one.name, one.lazy) for one in imports(source, "msdwarp.integrators")]
    assert found == [*((name, False) for name in names), ("pyvista", True)]
    assert room_of("msdwarp.kernels.basis.vector") == "kernels"
    assert room_of("msdwarp.Plane") == TOP
    assert room_of("msdwarp.scenes.cube") == "scenes"
    assert {"msdwarp.engine.model.model", "msdwarp.kernels.springs.law"} <= modules().keys()


def test_rooms_are_few_and_stand_in_order():
    of = levels()  # raises where imports go round
    assert len(of) <= MOST_ROOMS
    assert max(of.values()) <= MOST_LEVELS
    assert sum(map(len, arrows().values())) <= MOST_ARROWS


def test_layers_point_one_way():
    layer = {name: k for k, names in enumerate(LAYERS) for name in names}
    inner = {room: others for room, others in arrows().items() if room not in (TOP, "__main__")}
    assert inner.keys() <= layer.keys(), "a new room has a place in LAYERS"
    up = [
        f"{room} imports {other}, which is not below it"
        for room, others in inner.items()
        for other in others
        if layer[other] >= layer[room] and (room, other) not in {("pictures", "shapes"), ("cli", "scenes")}
    ]
    assert not up
    assert not {room: both for room, others in inner.items() if (both := others & APART.get(room, set()))}


def through_a_face(dotted, room):
    parts = dotted.split(".")
    if room == "kernels":  # which has none: its names are imported from their files
        path = ROOT.joinpath(*parts[1:-1])
        return path.is_dir() or path.with_suffix(".py").is_file()
    return len(parts) <= 3


# Each of these goes through all modules at once and tells of every import that breaks its rule.


def test_other_rooms_are_entered_through_their_faces():
    past = [
        f"{name}:{item.line} imports {item.name} past the face of {room}"
        for name in modules()
        if modules()[name].room != "scenes"  # which use the package as anybody's script does
        for item, room in within(name)
        if not (through_a_face(item.name, room) or (name == TOP and room == "world"))  # a load of users alone
    ]
    assert not past


def test_what_is_private_stays_in_its_file():
    private = [
        f"{name}:{item.line} imports {item.name}"
        for name, module in modules().items()
        for item in module.imports
        if item.name.split(".")[0] == TOP and re.match(r"_[a-zA-Z]", item.name.split(".")[-1])
    ]
    assert not private


def test_kernels_are_launched_from_few_rooms():
    items = modules().items()
    hosts = {module.room for name, module in items if any(room == "kernels" for _, room in within(name))}
    assert hosts <= HOSTS_OF_KERNELS


def test_integrators_see_the_equation_of_motion_and_not_how_forces_come_about():
    seen = {
        item.name.split(".")[2]
        for name in modules()
        if modules()[name].room == "integrators"
        for item, room in within(name)
        if room == "engine"
    }
    known = {"Dynamics", "Solve", "Stage", "State", "Rates", "Model"}
    assert seen <= known | {"rate_bounds", "add_linearised", "write_diagonal_blocks"}


def test_kernels_import_warp_and_each_other_only():
    others = [
        f"{name}:{item.line} imports {item.name}"
        for name, module in modules().items()
        if module.room == "kernels"
        for item in module.imports
        if item.name.split(".")[0] not in {"warp", *sys.stdlib_module_names} and room_of(item.name) != "kernels"
    ]
    assert not others


@pytest.mark.parametrize("package", ONE_PLACE)
def test_packages_with_one_place(package):
    each = modules().values()
    found = {module.room for module in each for item in module.imports if item.name.split(".")[0] == package}
    assert found <= ONE_PLACE[package]


def test_heavy_packages_are_imported_late():
    early = [
        f"{name}:{item.line} imports {item.name} when it is itself imported"
        for name, module in modules().items()
        for item in module.imports
        if not item.lazy and item.name.split(".")[0] in LAZY
    ]
    assert not early


def brought_in(code):
    """Return the rooms, and those of the large packages, that are imported once some code has run by itself."""
    code += """
import sys
rooms = {name.split(".")[1] for name in sys.modules if name.startswith("msdwarp.")}
print(*sorted(rooms | sys.modules.keys() & set(sys.argv)))
"""
    command = [sys.executable, "-c", code, *LAZY, "warp", "numpy", "PIL", "cyclopts", "rich"]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=120)
    return set(done.stdout.split())


def test_importing_the_package_brings_in_nothing_large():
    assert brought_in("import msdwarp; dir(msdwarp)") == {"runtime"}


def test_describing_a_scene_needs_no_warp():
    needed = brought_in("import msdwarp as msd; msd.Scene(system=msd.box((2, 2, 2)), colliders=[msd.Plane()])")
    assert needed == {"runtime", "bodies", "checks", "shapes", "world", "numpy"}


@pytest.mark.slow
def test_names_are_found_where_they_are_said_to_be():
    code = """
import msdwarp
before = dir(msdwarp)
from msdwarp import *
assert set(msdwarp.__all__) <= set(before) & globals().keys()
for room, names in msdwarp._ROOMS.items():
    for name in names:
        assert getattr(getattr(msdwarp, room), name) is globals()[name], name
"""
    assert "warp" in brought_in(code)


def test_faces_say_what_they_show():
    # `from .x import A as A` is what type checkers take for public where users import it.
    hidden = []
    for name, module in modules().items():
        if module.path.name != "__init__.py":
            continue
        tree = ast.parse(module.path.read_text(encoding="utf-8"))
        assert ast.get_docstring(tree), name
        imported = [
            alias
            for node in ast.walk(tree)  # what is imported when it is asked for stands under a condition
            if isinstance(node, ast.ImportFrom)
            for alias in node.names
        ]
        if name in (TOP, f"{TOP}.cli", f"{TOP}.files"):
            hidden += [f"{name}: {alias.name}" for alias in imported if alias.asname != alias.name]
    assert not hidden


LONGEST, MEDIAN = 400, 150
TOO_LONG: set[str] = set()
"""Files that are longer than LONGEST lines, and are to be cut."""


def test_no_files_import_each_other():
    # Imports for types and in functions count: they hide that two files are one.
    assert file_circles() == []


def test_the_commands_know_nothing_of_the_app():
    app = {f"{TOP}.cli.{name}" for name in ("app", "entry_points", "file_commands")}
    below = {name: others for name, others in file_imports().items() if name.startswith(f"{TOP}.cli.commands.")}
    found = {name: app & others for name, others in below.items()}
    assert found
    assert not any(found.values())


def test_folders_stay_small():
    # Twenty files are read at a glance; scenes are found by their names.
    crowded = {folder: len(files) for folder, files in folders().items() if len(files) > 20}
    crowded.pop("msdwarp.scenes", None)
    assert crowded == {}


LARGE_FUNCTIONS = {
    "integrators/shared_memory.take_steps_on_chip": "6 deep: choices at compile time, in loops over stages",
    "pictures/raster.shade_square": "6 deep: it returns early from its loop over points",
    "reductions/measure.sum_up_state": "127 lines: all sums in one pass over the state",
    "springs/stencil.forces_at": "8 deep: all its loops, and most choices in them, are unrolled at compile time",
}
"""Functions of kernels that are over 120 lines, or nested over 5 deep, and why."""


def nesting(statements) -> int:
    """Return how deep blocks are nested; an `elif` is as deep as its `if`."""
    most = 0
    for node in statements:
        for block in (getattr(node, "body", []), getattr(node, "orelse", [])):
            is_elif = isinstance(node, ast.If) and block is node.orelse and len(block) == 1
            is_elif = is_elif and isinstance(block[0], ast.If)
            most = max(most, nesting(block) + (0 if is_elif else 1) if block else 0)
    return most


def test_kernel_functions_stay_short_and_flat():
    large = set()
    for path in sorted((ROOT / "kernels").rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.FunctionDef) and not any(
                isinstance(inner, ast.FunctionDef) for statement in node.body for inner in ast.walk(statement)
            ):
                length = (node.end_lineno or 0) - node.lineno + 1
                if length > 120 or nesting(node.body) > 5:
                    name = path.relative_to(ROOT / "kernels").with_suffix("").as_posix()
                    large.add(f"{name}.{node.name}")
    assert large == LARGE_FUNCTIONS.keys()


def test_files_stay_short():
    places = ("msdwarp", "kernels", "scenes", "tests", "benchmarks")
    paths = {path.relative_to(ROOT).as_posix(): path for place in places for path in (ROOT / place).rglob("*.py")}
    paths = {
        name: path for name, path in paths.items() if not name.startswith(("msdwarp/kernels", "msdwarp/scenes"))
    }
    lines = {name: len(path.read_text(encoding="utf-8").splitlines()) for name, path in paths.items()}
    assert {name for name, count in lines.items() if count > LONGEST} == TOO_LONG
    assert sorted(lines.values())[len(lines) // 2] <= MEDIAN
