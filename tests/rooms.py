"""The rooms of the package, and who imports whom, read off the source. `python tests/rooms.py` prints them.

A room is a package of msdwarp or one of its modules at the top; what groups kernels is no room of its own.
"""

import ast
import functools
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
TOP = "msdwarp"
"""The room of `import msdwarp` itself."""


class Import(NamedTuple):
    """One imported name."""

    name: str
    """Absolute and dotted, as far as the source tells."""
    line: int
    lazy: bool
    """Whether it stands inside a function."""


class Module(NamedTuple):
    """A file of the package."""

    name: str
    """Dotted: msdwarp.engine.model.model."""
    path: Path
    imports: list[Import]

    @property
    def room(self) -> str:
        """The room that it lies in."""
        return room_of(self.name)


def room_of(dotted: str) -> str:
    """Return the room of a dotted name within the package."""
    parts = dotted.split(".")
    return parts[1] if len(parts) > 1 and parts[1] in rooms_there() else TOP


@functools.cache
def rooms_there() -> set[str]:
    """Return the names of the packages and modules directly below msdwarp."""
    found = {path.parent.name for path in (ROOT / TOP).glob("*/__init__.py")}
    return found | {path.stem for path in (ROOT / TOP).glob("*.py")} - {"__init__"}


def imports(source: str, package: str) -> list[Import]:
    """Return the imports of a module that lies in `package`."""
    found: list[Import] = []

    def visit(node: ast.AST, late: bool) -> None:
        names = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            parents = package.split(".")[: len(package.split(".")) + 1 - node.level] if node.level else []
            module = ".".join([*parents, *([node.module] if node.module else [])])
            names = [f"{module}.{alias.name}" for alias in node.names]
        found.extend(Import(name, node.lineno, late) for name in names)
        late = late or isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda)
        for inner in ast.iter_child_nodes(node):
            if isinstance(inner, ast.stmt | ast.excepthandler | ast.match_case):  # no expression holds an import
                visit(inner, late)

    visit(ast.parse(source), False)
    return found


@functools.cache
def modules() -> dict[str, Module]:
    """Return the modules of the package by their dotted names; reading them all takes a second."""
    found = {}
    for folder, package in (("msdwarp", TOP), ("kernels", f"{TOP}.kernels"), ("scenes", f"{TOP}.scenes")):
        for path in sorted((ROOT / folder).rglob("*.py")):
            inside = path.relative_to(ROOT / folder).with_suffix("").parts
            if folder == "msdwarp" and inside[0] in ("kernels", "scenes"):
                continue  # links to the folders at the top
            own_package = ".".join((package, *inside[:-1]))
            name = own_package if inside[-1] == "__init__" else f"{own_package}.{inside[-1]}"
            found[name] = Module(name, path, imports(path.read_text(encoding="utf-8"), own_package))
    return found


@functools.cache
def arrows() -> dict[str, set[str]]:
    """Return the other rooms that each room imports, itself or in a function; scenes are what uses the package."""
    found: dict[str, set[str]] = {module.room: set() for module in modules().values()}
    for module in modules().values():
        if module.room == "scenes" and module.name != f"{TOP}.scenes":
            continue  # each uses the package as anybody's script does
        within = (item for item in module.imports if item.name.split(".")[0] == TOP)
        found[module.room] |= {room_of(item.name) for item in within} - {module.room}
    return found


def levels() -> dict[str, int]:
    """Return the level of each room, one more than the highest that it imports; raise where imports go round.

    Rooms on one level know nothing of each other.
    """
    found: dict[str, int] = {}
    left = dict(arrows())
    while left:
        done = {room: others for room, others in left.items() if others <= found.keys()}
        if not done:
            raise ValueError(f"these rooms import each other: {', '.join(sorted(left))}")
        for room, others in done.items():
            found[room] = 1 + max((found[other] for other in others), default=0)
            del left[room]
    return found


def file_imports() -> dict[str, set[str]]:
    """Return the files that each file of the package imports, those for types and those in functions included.

    The face of the package itself imports all; it is left out.
    """
    found: dict[str, set[str]] = {}
    for name, module in modules().items():
        found[name] = set()
        for item in module.imports:
            other = item.name
            while other and other not in modules():
                other = other.rpartition(".")[0]
            if other and other not in (name, TOP):
                found[name].add(other)
    return found


def file_circles() -> list[list[str]]:
    """Return the groups of files that import each other, directly or by way of others."""
    left, needs = {}, file_imports()
    for name in needs:  # all that each needs, directly or not
        left[name], due = set(), [name]
        while due:
            for other in needs[due.pop()] - left[name]:
                left[name].add(other)
                due.append(other)
    circles = {tuple(sorted(two for two in left[one] if one in left[two])) for one in left if one in left[one]}
    return [list(one) for one in sorted(circles)]


def folders() -> dict[str, list[Module]]:
    """Return the files of each folder of the package, but for its face, by its dotted name."""
    found: dict[str, list[Module]] = {}
    for name, module in modules().items():
        if module.path.stem != "__init__":
            found.setdefault(name.rpartition(".")[0], []).append(module)
    return found


def main() -> None:
    """Print the rooms, from what knows least to what knows most, and the folders within them."""
    of, files = levels(), modules().values()
    for room in sorted(of, key=lambda room: (of[room], room)):
        lines = [
            len(module.path.read_text(encoding="utf-8").splitlines()) for module in files if module.room == room
        ]
        needs = ", ".join(sorted(arrows()[room])) or "nothing"
        print(f"level {of[room]}  {room:12} {len(lines):3} files {sum(lines):5} lines  imports {needs}")
        for folder, inside in sorted(folders().items()):
            if folder.startswith(f"{TOP}.{room}."):
                lines = [len(module.path.read_text(encoding="utf-8").splitlines()) for module in inside]
                print(f"           {folder.split('.')[-1]:14} {len(lines):3} files {sum(lines):5} lines")
    count = sum(map(len, arrows().values()))
    apart = sum(len(others - {"kernels"}) for others in arrows().values())
    print(f"{len(of)} rooms, {max(of.values())} levels, {count} arrows, {apart} without those to kernels")
    print("files that import each other:", file_circles() or "none")


if __name__ == "__main__":
    main()
