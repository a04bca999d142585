"""Constants that kernels take from around them are never what a loop changes.

Warp 1.19 gives a captured constant one variable. `best = scalar(far)` makes `best` that very variable: where a
loop then changes `best`, `far` is changed too. `best = far` makes a copy.
"""

import ast

from rooms import ROOT

KERNELS = ROOT / "kernels"


def aliases(source: str) -> list[str]:
    """Return the assignments of `name = type(constant)` whose constant comes from around the function."""
    found = []
    for function in ast.walk(ast.parse(source)):
        if isinstance(function, ast.FunctionDef):
            within = {node.id for node in ast.walk(function) if isinstance(node, ast.Name) and is_stored(node)}
            within |= {argument.arg for argument in function.args.args}
            for node in ast.walk(function):
                if isinstance(node, ast.Assign) and isinstance(node.value, ast.Call) and len(node.value.args) == 1:
                    given, of = node.value.args[0], node.value.func
                    casts = isinstance(of, ast.Name) and of.id in ("scalar", "float", "int", "bool")
                    if casts and isinstance(given, ast.Name) and given.id not in within:
                        found.append(ast.unparse(node))
    return found


def is_stored(name: ast.Name) -> bool:
    return isinstance(name.ctx, ast.Store)


def test_no_variable_is_a_captured_constant_itself():
    sources = list(KERNELS.rglob("*.py"))
    assert len(sources) > 50
    assert {str(path): found for path in sources if (found := aliases(path.read_text()))} == {}


def test_such_a_variable_would_be_found():
    assert aliases("def kernel():\n    best = scalar(far)\n    far = 1") == []
    assert aliases("def kernel():\n    best = scalar(far)\n    near = far") == ["best = scalar(far)"]
