"""A law that the pump does not call says so, and one that it calls does not: an engineer who edits it knows what moves."""

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent.parent
MARK = "Not called by the pump yet"
PLACES = ("twin/laws", "twin/parts")
"""Where the pump's equations stand."""
ASIDE = ("twin/validation",)
"""What looks at the pump from outside: a call from here moves no pump."""


def modules() -> Iterator[tuple[str, ast.Module]]:
    for package in ("twin", "detectors", "service"):
        for file in sorted((ROOT / package).rglob("*.py")):
            name = file.relative_to(ROOT).as_posix()
            if not name.startswith(ASIDE):
                yield name.removesuffix(".py").replace("/", "."), ast.parse(file.read_text())


def is_law(module: str) -> bool:
    return module.startswith(tuple(place.replace("/", ".") for place in PLACES))


@cache
def laws() -> dict[tuple[str, str], ast.FunctionDef]:
    """Functions of laws and parts by module and name."""
    return {
        (module, node.name): node
        for module, tree in modules()
        if is_law(module)
        for node in tree.body
        if isinstance(node, ast.FunctionDef)
    }


def named(module: str, tree: ast.Module, body: ast.AST) -> set[tuple[str, str]]:
    """Laws that a piece of a module names: as its own, as imported, or as ``part.law``."""
    own = {name: (module, name) for name in (n.name for n in tree.body if isinstance(n, ast.FunctionDef))}
    parts: dict[str, str] = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module:
            for alias in node.names:
                own[alias.asname or alias.name] = (node.module, alias.name)
                parts[alias.asname or alias.name] = f"{node.module}.{alias.name}"
    found = set()
    for node in ast.walk(body):
        if isinstance(node, ast.Name) and node.id in own:
            found.add(own[node.id])
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id in parts:
            found.add((parts[node.value.id], node.attr))
    return found & set(laws())


@cache
def called() -> frozenset[tuple[str, str]]:
    """Laws that the pump calls, through other laws too."""
    trees = dict(modules())
    waiting = [law for module, tree in trees.items() if not is_law(module) for law in named(module, tree, tree)]
    found: set[tuple[str, str]] = set()
    while waiting:
        law = waiting.pop()
        if law not in found:
            found.add(law)
            waiting.extend(named(law[0], trees[law[0]], laws()[law]))
    return frozenset(found)


@pytest.mark.parametrize("law", sorted(laws()), ids=".".join)
def test_a_law_says_whether_the_pump_calls_it(law: tuple[str, str]) -> None:
    marked = MARK in (ast.get_docstring(laws()[law]) or "")
    assert marked != (law in called())


def test_the_pump_is_seen_to_call_its_laws() -> None:
    """The search itself: a law of the step, one behind another law, one that a part is asked for by its module's name."""
    for law in (
        ("twin.laws.compressibility", "pressure_of"),
        ("twin.laws.metering_edge", "hole_opening"),
        ("twin.parts.servo", "stroking_drag"),
    ):
        assert law in called()
