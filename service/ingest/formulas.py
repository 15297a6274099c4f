"""Computed channels: a small arithmetic over channels and numbers, read as a syntax tree and never run as code."""

import ast
import math
import re
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from service.ingest.raw import Samples

LONGEST = 500
_MOST_NODES = 100
_LARGEST_POWER = 10.0
_LARGEST_NUMBER = 1e300
_QUOTED = re.compile(r"\{([^{}]+)\}")
_TWO: Mapping[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: np.add,
    ast.Sub: np.subtract,
    ast.Mult: np.multiply,
    ast.Div: np.divide,
    ast.Pow: np.power,
}
_ONE: Mapping[type[ast.unaryop], Callable[[Any], Any]] = {ast.USub: np.negative, ast.UAdd: np.positive}
_FUNCTIONS: Mapping[str, tuple[Callable[..., Any], int]] = {
    "min": (np.fmin, 2),
    "max": (np.fmax, 2),
    "abs": (np.abs, 1),
    "sqrt": (np.sqrt, 1),
    "clip": (lambda x, low, high: np.fmin(np.fmax(x, low), high), 3),
}
_WORDS = "numbers, names of channels (in braces where they hold blanks), + - * / ** ( ), min, max, abs, sqrt, clip"


class Formula:
    """One formula, checked when it is made.

    Parameters
    ----------
    text
        Such as ``{HYD1 P} - case_pressure_bar`` or ``max(p1, p2) * 0.1``.

    Attributes
    ----------
    names
        Channels that it needs, in the order of their first use.

    Raises
    ------
    ValueError
        when it is no such formula, naming what it may hold.
    """

    def __init__(self, text: str) -> None:
        self.text = text
        quoted: list[str] = []

        def placeholder(found: re.Match[str]) -> str:
            quoted.append(found.group(1).strip())
            return f" quoted_{len(quoted) - 1}_ "

        if len(text) > LONGEST:
            raise ValueError(f"a formula has at most {LONGEST} characters")
        try:
            self._tree = ast.parse(_QUOTED.sub(placeholder, text).strip(), mode="eval").body
        except (SyntaxError, ValueError, MemoryError, RecursionError):
            raise ValueError(f"{text!r} is no formula: it may hold {_WORDS}") from None
        self._quoted = {f"quoted_{i}_": name for i, name in enumerate(quoted)}
        if sum(1 for _ in ast.walk(self._tree)) > _MOST_NODES:
            raise ValueError(f"the formula has more than {_MOST_NODES} parts")
        found: dict[str, None] = {}
        self._check(self._tree, found)
        self.names = tuple(found)
        if not self.names:
            raise ValueError(f"the formula {text!r} names no channel: give a constant as `value`")

    def __call__(self, channels: Mapping[str, Samples]) -> Samples:
        """Its samples, shape (n,); NaN where an operand is missing or there is no number (``1 / 0``, ``sqrt(-1)``).

        ``min``, ``max`` and ``clip`` leave a missing operand out and take the other one.
        """
        with np.errstate(all="ignore"):
            result = np.asarray(self._value(self._tree, channels), dtype=np.float64)
        return np.where(np.isfinite(result), result, math.nan)

    def _check(self, node: ast.AST, names: dict[str, None]) -> None:
        parts: list[ast.AST] = []
        if isinstance(node, ast.BinOp) and type(node.op) in _TWO:
            parts = [node.left, node.right]
            if isinstance(node.op, ast.Pow) and not _is_small(node.right):
                raise ValueError(f"a power is a number from -{_LARGEST_POWER:g} to {_LARGEST_POWER:g}")
        elif isinstance(node, ast.UnaryOp) and type(node.op) in _ONE:
            parts = [node.operand]
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in _FUNCTIONS:
            n_wanted = _FUNCTIONS[node.func.id][1]
            if len(node.args) != n_wanted or node.keywords:
                raise ValueError(f"{node.func.id} takes {n_wanted} arguments")
            parts = list(node.args)
        elif isinstance(node, ast.Name):
            names[self._quoted.get(node.id, node.id)] = None
        elif _constant(node) is None:
            raise ValueError(f"the formula {self.text!r} holds {type(node).__name__}: it may hold {_WORDS}")
        for part in parts:
            self._check(part, names)

    def _value(self, node: ast.AST, channels: Mapping[str, Samples]) -> Any:
        if isinstance(node, ast.BinOp):
            return _TWO[type(node.op)](self._value(node.left, channels), self._value(node.right, channels))
        if isinstance(node, ast.UnaryOp):
            return _ONE[type(node.op)](self._value(node.operand, channels))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            return _FUNCTIONS[node.func.id][0](*(self._value(argument, channels) for argument in node.args))
        if isinstance(node, ast.Name):
            return channels[self._quoted.get(node.id, node.id)]
        return _constant(node)


def _constant(node: ast.AST) -> float | None:
    """Number that a node is; None for anything else, True and 1j among them."""
    if isinstance(node, ast.Constant) and isinstance(node.value, int | float) and not isinstance(node.value, bool):
        return float(node.value) if abs(node.value) < _LARGEST_NUMBER else None
    return None


def _is_small(node: ast.AST) -> bool:
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        node = node.operand
    number = _constant(node)
    return number is not None and number <= _LARGEST_POWER
