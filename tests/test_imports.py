"""Imports point one way, and heavy packages are imported where they belong: read off the source."""

import ast
import functools
import sys
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).parents[1]

# From what knows least to what knows most. A module may import what stands before it, and what stands in
# the same line with it, if that does not import it in turn. Some are yet to be written.
TIERS = [
    {"kernels"},
    {"checks", "whole"},
    {"surface", "dampers", "materials"},
    {"system", "grid"},
    {"shapes", "colliders", "vtkhdf", "trajectory", "writer", "restart"},
    {"solids"},
    {"meshes", "outlines"},
    {"lattices"},
    {"routes", "surroundings"},
    {"model"},
    {"forces"},
    {"dynamics"},
    {"integrators"},
    {"stability", "measure"},
    {"watch"},
    {"schedule"},
    {"simulation"},
    {"readback"},
    {"readback"},
    {"scene"},
    {"textures"},
    {"obstacles"},
    {"opengl", "parts", "picture", "legend", "film", "raycast", "render", "timelapse", "viewer", "export"},
    {"scenes"},  # the package, which is empty: by it the command finds the scenes' files
    {"accuracy", "energy_log", "history", "quiet", "results", "origin"},
    {"draw"},
    {"options"},
    {"run", "tune"},
    {"rerun"},
    {"file_commands"},
    {"cli"},
    {"__main__"},
    {"__init__"},
    {"scenes/*", "tests", "benchmarks"},
]
TIER = {name: k for k, tier in enumerate(TIERS) for name in tier}
LAZY = {"pyvista", "matplotlib", "scipy", "imageio", "h5py", "pxr"}


class Import(NamedTuple):
    """One imported module."""

    name: str
    """Absolute and dotted, as far as the source tells."""
    line: int
    lazy: bool
    """Whether it stands inside a function."""


@functools.cache
def imports(source: str, package: str) -> list[Import]:
    """Return the imports of a module that lies in `package`."""
    tree = ast.parse(source)
    inner = {
        id(node)
        for function in ast.walk(tree)
        if isinstance(function, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda)
        for node in ast.walk(function)
    }
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            parents = package.split(".")[: len(package.split(".")) + 1 - node.level] if node.level else []
            module = ".".join([*parents, *([node.module] if node.module else [])])
            # From a package its modules may be imported by name; from a module only what it holds.
            names = [f"{module}.{alias.name}" for alias in node.names]
        else:
            continue
        found += [Import(name, node.lineno, id(node) in inner) for name in names]
    return found


def modules() -> dict[str, tuple[Path, str]]:
    """Return the modules of the package, by path from the root: (file, dotted name of its package)."""
    found = {}
    for top, package in (
        ("msdwarp", "msdwarp"),
        ("kernels", "msdwarp.kernels"),
        ("scenes", "msdwarp.scenes"),
    ):
        for path in sorted((ROOT / top).rglob("*.py")):
            inside = path.relative_to(ROOT / top).parts
            if top == "msdwarp" and inside[0] in ("kernels", "scenes"):
                continue  # links to the folders at the top
            found["/".join((top, *inside))] = (path, ".".join((package, *inside[:-1])))
    return found


MODULES = modules()


def place(dotted: str) -> str | None:
    """Return the name in TIERS of an imported module; None for what is not of this package."""
    parts = dotted.split(".")
    if parts[0] != "msdwarp":
        return None
    if parts[1:2] == ["scenes"]:
        return "scenes" if len(parts) == 2 else "scenes/*"
    return parts[1] if len(parts) > 1 and parts[1] in TIER else "__init__"


def place_of_file(name: str) -> str:
    """Return the name in TIERS of a module of this package."""
    top, first, *_ = name.split("/")
    if top == "scenes":
        return "scenes" if first == "__init__.py" else "scenes/*"
    return Path(first).stem if top == "msdwarp" else top


def test_reading_imports():
    # The reader itself, on every form that an import can take.
    source = """
import msdwarp.model
from . import checks, stability
from .kernels.basis import vector
from .. import other
from msdwarp import Plane
def late():
    import pyvista as pv
"""
    assert [(i.name, i.lazy) for i in imports(source, "msdwarp.integrators")] == [
        ("msdwarp.model", False),
        ("msdwarp.integrators.checks", False),
        ("msdwarp.integrators.stability", False),
        ("msdwarp.integrators.kernels.basis.vector", False),
        ("msdwarp.other", False),
        ("msdwarp.Plane", False),
        ("pyvista", True),
    ]
    assert place("msdwarp.kernels.basis.vector") == "kernels"
    assert place("msdwarp.Plane") == "__init__"
    assert place("msdwarp.scenes") == "scenes"
    assert place("msdwarp.scenes.cube") == "scenes/*"
    assert place("numpy.linalg") is None
    assert {"msdwarp/model.py", "msdwarp/integrators/rk4.py", "kernels/forces.py"} <= MODULES.keys()


@pytest.mark.parametrize("name", MODULES)
def test_every_module_has_a_place(name):
    module = place_of_file(name)
    assert module in TIER, f"{name} is new: give it a place in TIERS"


@pytest.mark.parametrize("name", MODULES)
def test_imports_point_one_way(name):
    path, package = MODULES[name]
    here = place_of_file(name)
    for item in imports(path.read_text(encoding="utf-8"), package):
        there = place(item.name)
        if there is None or there == here or here not in TIER:
            continue
        assert TIER[there] <= TIER[here], f"{name}:{item.line} imports {item.name}, which knows more"


def test_no_imports_go_round():
    needs: dict[str, set[str]] = {}
    for name, (path, package) in MODULES.items():
        found = {place(item.name) for item in imports(path.read_text(encoding="utf-8"), package)}
        needs.setdefault(place_of_file(name), set()).update(found - {None, place_of_file(name)})
    while needs:
        done = [name for name, others in needs.items() if not others & needs.keys()]
        assert done, f"these import each other: {', '.join(sorted(needs))}"
        for name in done:
            del needs[name]


@pytest.mark.parametrize("name", [name for name in MODULES if name.startswith("kernels/")])
def test_kernels_import_warp_and_each_other_only(name):
    path, package = MODULES[name]
    for item in imports(path.read_text(encoding="utf-8"), package):
        allowed = item.name.split(".")[0] in {"warp", *sys.stdlib_module_names}
        assert allowed or place(item.name) == "kernels", f"{name}:{item.line} imports {item.name}"


@pytest.mark.parametrize(
    ("package", "allowed"),
    [
        ("pyvista", {"render", "viewer", "export"}),
        ("vtk", set()),
        ("vtkmodules", set()),
        ("h5py", {"trajectory", "writer", "restart"}),
        ("pxr", {"export"}),
    ],
)
def test_packages_with_one_place(package, allowed):
    found = {
        place_of_file(name)
        for name, (path, module_package) in MODULES.items()
        for item in imports(path.read_text(encoding="utf-8"), module_package)
        if item.name.split(".")[0] == package
    }
    assert found <= allowed


@pytest.mark.parametrize("name", MODULES)
def test_heavy_packages_are_imported_late(name):
    path, package = MODULES[name]
    for item in imports(path.read_text(encoding="utf-8"), package):
        top = item.name.split(".")[0]
        assert item.lazy or top not in LAZY, f"{name}:{item.line} imports {top} when it is itself imported"
