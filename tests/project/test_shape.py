"""Functions stay small enough to read: at most ten parameters, four levels of nesting, files of some 400 lines."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = ("twin", "detectors", "service")
MOST_PARAMETERS, DEEPEST_NESTING, LONGEST_FILE = 10, 4, 400
NESTING = (ast.For, ast.AsyncFor, ast.While, ast.If, ast.With, ast.AsyncWith, ast.Try, ast.TryStar, ast.Match)
SCOPES = (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef, ast.Lambda)

# Older than the rule: what is mended leaves the list, nothing may join it.
MANY_PARAMETERS = {"fill", "advance", "run_loop", "film", "solve_step", "_jacobian", "isolability", "watch"}
DEEPLY_NESTED = {"run_loop"}

# Names for JSON of others, rows and foreign metadata; namespaces of functions; columns of a library; a caller's arguments.
SHAPELESS = {
    ("service/answers/documents.py", 2),
    ("service/ingest/raw.py", 1),
    ("service/ingest/parquet_format.py", 1),
    ("service/studies/fmu/translation.py", 2),
    ("service/web/answer_route.py", 1),
}

Function = ast.FunctionDef | ast.AsyncFunctionDef


def n_parameters(function: Function) -> int:
    """Parameters with self and cls counted out."""
    a = function.args
    names = [p.arg for p in (*a.posonlyargs, *a.args, *a.kwonlyargs, a.vararg, a.kwarg) if p is not None]
    return len([name for name in names if name not in ("self", "cls")])


def nesting(node: ast.AST, depth: int = 0) -> int:
    """Deepest level of a function's own statements; an ``elif`` is no level deeper than its ``if``."""
    deepest = depth
    for child in ast.iter_child_nodes(node):
        if isinstance(child, SCOPES):
            continue
        chained = isinstance(child, ast.If) and isinstance(node, ast.If) and node.orelse == [child]
        deepest = max(deepest, nesting(child, depth + (isinstance(child, NESTING) and not chained)))
    return deepest


def files() -> list[Path]:
    return [path for package in PACKAGES for path in sorted((ROOT / package).rglob("*.py"))]


def functions() -> Iterator[tuple[str, Function]]:
    for path in files():
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, Function):
                yield f"{path.relative_to(ROOT)}: {node.name}", node


def test_no_function_has_more_than_ten_parameters() -> None:
    many = {where for where, f in functions() if f.name not in MANY_PARAMETERS and n_parameters(f) > MOST_PARAMETERS}
    assert many == set()


def test_nothing_is_nested_deeper_than_four_levels() -> None:
    deep = {where for where, f in functions() if f.name not in DEEPLY_NESTED and nesting(f) > DEEPEST_NESTING}
    assert deep == set()


def test_no_file_is_longer_than_400_lines() -> None:
    lengths = {str(p.relative_to(ROOT)): len(p.read_text(encoding="utf-8").splitlines()) for p in files()}
    assert {path: n for path, n in lengths.items() if n > LONGEST_FILE} == {}


def test_only_what_has_names_of_its_own_is_a_dictionary_of_anything() -> None:
    found = {
        (str(path.relative_to(ROOT)), n)
        for path in files()
        if path.relative_to(ROOT).parts[0] == "service"
        for n in [path.read_text(encoding="utf-8").count("dict[str, Any]")]
        if n
    }
    assert found == SHAPELESS


@pytest.mark.parametrize(
    ("source", "depth"),
    [
        ("def f():\n    return 1", 0),
        ("def f(x):\n    if x:\n        pass\n    elif not x:\n        pass", 1),
        ("def f(x):\n    for a in x:\n        try:\n            with a:\n                pass\n        except E:\n            pass", 3),
        ("def f(x):\n    if x:\n        pass\n    else:\n        for a in x:\n            pass", 2),
        ("def f(x):\n    if x:\n        def g():\n            while x:\n                pass", 1),
    ],
)  # fmt: skip
def test_levels_are_counted_as_a_reader_sees_them(source: str, depth: int) -> None:
    (function,) = ast.parse(source).body
    assert nesting(function) == depth


def test_parameters_of_every_sort_count() -> None:
    (function,) = ast.parse("def f(self, a, /, b, *c, d, **e): ...").body
    assert isinstance(function, ast.FunctionDef)
    assert n_parameters(function) == 5
