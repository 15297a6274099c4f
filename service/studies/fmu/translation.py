"""The pump's own kernels as C99: a translator for the small part of Python that kernels are written in.

Kernels are functions of floats, tuples of floats with names, and arrays, all annotated; that is enough to know every type.
What a kernel may not say in Python it may not say here either: anything unknown is an error that names the line.
"""

import ast
import inspect
import math
import textwrap
from collections.abc import Callable
from typing import Any, get_type_hints

import numpy as np

from service.studies.fmu.packing import template
from twin.laws.compressibility import power

_OPERATORS = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*"}
_COMPARISONS = {ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!="}
_MATHS = ("sqrt", "sin", "cos", "tan", "tanh", "exp", "log", "atan", "acos", "pow", "copysign")
_PLAIN = {float: "double", int: "int", bool: "int", type(None): "void"}


class UntranslatableError(ValueError):
    """A kernel says something that has no C here."""


class Translation:
    """C of kernels and of all that they call; ``text`` holds structs, prototypes and functions."""

    def __init__(self) -> None:
        self._structs: dict[str, str] = {}
        self._prototypes: list[str] = []
        self._bodies: list[str] = []
        self._names: dict[Callable[..., Any], str] = {}

    @property
    def text(self) -> str:
        """The C source."""
        return "\n".join([template("prelude.h"), *self._structs.values(), *self._prototypes, *self._bodies])

    def add(self, kernel: Callable[..., Any]) -> str:
        """Translate a kernel with all that it calls; returns its name in C."""
        function = getattr(kernel, "py_func", kernel)
        if function in self._names:
            return self._names[function]
        name = f"{function.__module__.rsplit('.', 1)[1]}_{function.__name__.lstrip('_')}"
        while name in self._names.values():
            name += "_"
        self._names[function] = name
        writer = _Function(self, function)
        head, body = writer.written(name)
        self._prototypes.append(f"{head};")
        self._bodies.append(f"{head} {{\n{body}}}\n")
        return name

    def struct(self, kind: type) -> str:
        """Name in C of a tuple with names, its struct declared before."""
        name = f"T_{kind.__module__.rsplit('.', 1)[1]}_{kind.__name__}"
        if name not in self._structs:
            fields = [f"{self.field(kind, n)} {_safe(n)};" for n in kind._fields]  # type: ignore[attr-defined]
            self._structs[name] = f"typedef struct {{ {' '.join(fields)} }} {name};"
        return name

    def field(self, kind: type, name: str) -> str:
        """Type in C of a field of a tuple with names."""
        found = self.type_of(get_type_hints(kind)[name])
        if found != "Array":
            return found
        tree = ast.parse(textwrap.dedent(inspect.getsource(kind))).body[0]
        assert isinstance(tree, ast.ClassDef)
        said = {ast.unparse(n.target): n.annotation for n in tree.body if isinstance(n, ast.AnnAssign)}
        return "Mat" if _is_matrix(said[name]) else "Vec"

    def several(self, kinds: tuple[Any, ...]) -> str:
        """Name in C of a plain tuple."""
        inner = [self.type_of(kind) for kind in kinds]
        name = "T_" + "_".join(inner)
        if name not in self._structs:
            fields = [f"{t} f{i};" for i, t in enumerate(inner)]
            self._structs[name] = f"typedef struct {{ {' '.join(fields)} }} {name};"
        return name

    def type_of(self, kind: Any) -> str:
        """Type in C of an annotation."""
        if kind in _PLAIN:
            return _PLAIN[kind]
        if hasattr(kind, "_fields"):
            return self.struct(kind)
        if getattr(kind, "__origin__", None) is tuple:
            return self.several(kind.__args__)
        if "ndarray" in str(kind):
            return "Array"
        raise UntranslatableError(f"no type in C for {kind}")


class _Function:
    """One kernel on its way to C."""

    def __init__(self, whole: Translation, function: Callable[..., Any]) -> None:
        self.whole, self.function = whole, function
        self.globals: dict[str, Any] = function.__globals__
        self.types: dict[str, str] = {}
        self.kinds: dict[str, Any] = {}
        self.given: set[str] = set()
        self.count = 0
        self.lines: list[str] = []
        self.result: Any = None

    def written(self, name: str) -> tuple[str, str]:
        tree = ast.parse(textwrap.dedent(inspect.getsource(self.function))).body[0]
        assert isinstance(tree, ast.FunctionDef)
        hints = get_type_hints(self.function)
        self.result = hints.pop("return")
        arguments = []
        for argument in tree.args.args:
            kind = hints[argument.arg]
            c_type = self.whole.type_of(kind)
            if c_type == "Array":
                c_type = "Mat" if _is_matrix(argument.annotation) else "Vec"
            self._know(argument.arg, c_type, kind)
            self.given.add(argument.arg)
            arguments.append(f"{c_type} {_safe(argument.arg)}")
        self._block(tree.body)
        declared = [f"    {t} {_safe(n)};" for n, t in self.types.items() if n not in self.given]
        head = f"static {self.whole.type_of(self.result)} {name}({', '.join(arguments)})"
        return head, "\n".join([*declared, *self.lines]) + "\n"

    def _know(self, name: str, c_type: str, kind: Any = None) -> None:
        old = self.types.get(name)
        if old is not None and old != c_type and {old, c_type} != {"int", "double"}:
            raise UntranslatableError(f"{self.function.__name__}: {name} is {old} and {c_type}")
        self.types[name] = c_type if old is None else "double" if old != c_type else old
        if kind is not None:
            self.kinds[name] = kind

    def _say(self, line: str) -> None:
        self.lines.append(f"    {line}")

    # statements

    def _block(self, body: list[ast.stmt]) -> None:
        for statement in body:
            written = getattr(self, f"_{type(statement).__name__.lower()}", None)
            if written is None:
                raise UntranslatableError(f"{self.function.__name__}: {ast.unparse(statement)}")
            written(statement)

    def _expr(self, s: ast.Expr) -> None:
        if not isinstance(s.value, ast.Constant):
            self._say(f"{self.of(s.value)[0]};")

    def _return(self, s: ast.Return) -> None:
        if s.value is None:
            self._say("return;")
        elif isinstance(s.value, ast.Tuple):
            inner = ", ".join(self.of(e)[0] for e in s.value.elts)
            self._say(f"return ({self.whole.type_of(self.result)}){{{inner}}};")
        else:
            self._say(f"return {self.of(s.value)[0]};")

    def _break(self, _: ast.Break) -> None:
        self._say("break;")

    def _if(self, s: ast.If) -> None:
        self._say(f"if ({self.of(s.test)[0]}) {{")
        self._block(s.body)
        if s.orelse:
            self._say("} else {")
            self._block(s.orelse)
        self._say("}")

    def _for(self, s: ast.For) -> None:
        assert isinstance(s.target, ast.Name)
        assert isinstance(s.iter, ast.Call)
        ends = [self.of(a)[0] for a in s.iter.args]
        low, high = ("0", ends[0]) if len(ends) == 1 else ends
        name = s.target.id
        if name == "_":
            self.count += 1
            name = f"i_{self.count}"
        self._know(name, "int")
        n = _safe(name)
        self._say(f"for ({n} = {low}; {n} < {high}; {n}++) {{")
        self._block(s.body)
        self._say("}")

    def _while(self, s: ast.While) -> None:
        self._say(f"while ({self.of(s.test)[0]}) {{")
        self._block(s.body)
        self._say("}")

    def _augassign(self, s: ast.AugAssign) -> None:
        target = self.of(s.target)[0]
        self._say(f"{target} = {self.of(ast.BinOp(s.target, s.op, s.value))[0]};")

    def _assign(self, s: ast.Assign) -> None:
        value = s.value
        if isinstance(s.targets[0], ast.Tuple) and len(s.targets) == 1:
            self._unpack(s.targets[0], value)
            return
        if isinstance(s.targets[0], ast.Subscript) and isinstance(s.targets[0].slice, ast.Slice):
            a, b = self.of(s.targets[0].value)[0], self.of(value)[0]
            self._say(f"memcpy({a}.p, {b}.p, sizeof(double) * {a}.n);")
            return
        code, c_type, kind = self._typed(value)
        for target in reversed(s.targets):
            if isinstance(target, ast.Tuple):
                raise UntranslatableError(f"{self.function.__name__}: {ast.unparse(s)}")
            self._put(target, code, c_type, kind)
            code = self.of(target)[0]

    def _put(self, target: ast.expr, code: str, c_type: str, kind: Any = None) -> None:
        if isinstance(target, ast.Name):
            self._know(target.id, c_type, kind)
        self._say(f"{self.of(target)[0]} = {code};")

    def _unpack(self, targets: ast.Tuple, value: ast.expr) -> None:
        if isinstance(value, ast.IfExp) and isinstance(value.body, ast.Tuple) and isinstance(value.orelse, ast.Tuple):
            pairs = zip(value.body.elts, value.orelse.elts, strict=True)
            value = ast.Tuple([ast.IfExp(value.test, a, b) for a, b in pairs], ast.Load())
        if isinstance(value, ast.Tuple):
            held = []
            for element in value.elts:
                code, c_type, kind = self._typed(element)
                held.append((self._held(code, c_type), c_type, kind))
            for target, (code, c_type, kind) in zip(targets.elts, held, strict=True):
                self._put(target, code, c_type, kind)
            return
        code, c_type, kind = self._typed(value)
        whole = self._held(code, c_type)
        if hasattr(kind, "_fields"):
            parts = [(f"{whole}.{_safe(n)}", *self._field(kind, n)) for n in kind._fields]
        else:
            parts = [(f"{whole}.f{i}", self.whole.type_of(t), t) for i, t in enumerate(kind.__args__)]
        for target, (part, part_type, part_kind) in zip(targets.elts, parts, strict=True):
            self._put(target, part, part_type, part_kind)

    def _held(self, code: str, c_type: str) -> str:
        self.count += 1
        name = f"held_{self.count}"
        self._know(name, c_type)
        self._say(f"{_safe(name)} = {code};")
        return _safe(name)

    # expressions

    def of(self, e: ast.expr) -> tuple[str, str]:
        """Code and type of an expression."""
        code, c_type, _ = self._typed(e)
        return code, c_type

    def _typed(self, e: ast.expr) -> tuple[str, str, Any]:
        written = getattr(self, f"_of_{type(e).__name__.lower()}", None)
        if written is None:
            raise UntranslatableError(f"{self.function.__name__}: {ast.unparse(e)}")
        found: tuple[str, str, Any] = written(e)
        return found

    def _constant_of(self, value: Any, e: ast.expr) -> tuple[str, str, Any]:
        if isinstance(value, bool):
            return str(int(value)), "int", bool
        if isinstance(value, int | np.integer):
            return str(int(value)), "int", int
        if isinstance(value, float | np.floating):
            if math.isinf(value):
                return ("INFINITY" if value > 0 else "-INFINITY"), "double", float
            return repr(float(value)), "double", float
        raise UntranslatableError(f"{self.function.__name__}: {ast.unparse(e)}")

    def _of_constant(self, e: ast.Constant) -> tuple[str, str, Any]:
        return self._constant_of(e.value, e)

    def _of_name(self, e: ast.Name) -> tuple[str, str, Any]:
        if e.id in self.types:
            return _safe(e.id), self.types[e.id], self.kinds.get(e.id)
        return self._constant_of(self.globals.get(e.id), e)

    def _of_attribute(self, e: ast.Attribute) -> tuple[str, str, Any]:
        if isinstance(e.value, ast.Name) and e.value.id not in self.types:
            return self._constant_of(getattr(self.globals[e.value.id], e.attr), e)
        code, _, kind = self._typed(e.value)
        return (f"{code}.{_safe(e.attr)}", *self._field(kind, e.attr))

    def _field(self, kind: Any, name: str) -> tuple[str, Any]:
        return self.whole.field(kind, name), get_type_hints(kind)[name]

    def _of_subscript(self, e: ast.Subscript) -> tuple[str, str, Any]:
        if isinstance(e.value, ast.Attribute) and e.value.attr == "shape":
            assert isinstance(e.slice, ast.Constant)
            assert isinstance(e.slice.value, int)
            return f"{self.of(e.value.value)[0]}.{'nm'[e.slice.value]}", "int", int
        code, c_type, kind = self._typed(e.value)
        if getattr(kind, "__origin__", None) is tuple and isinstance(e.slice, ast.Constant):
            assert isinstance(e.slice.value, int)
            part = kind.__args__[e.slice.value]
            return f"{code}.f{e.slice.value}", self.whole.type_of(part), part
        if isinstance(e.slice, ast.Tuple):
            i, j = (self.of(x)[0] for x in e.slice.elts)
            return f"{code}.p[({i}) * {code}.m + {j}]", "double", float
        i = self.of(e.slice)[0]
        if c_type == "Mat":
            return f"(Vec){{{code}.p + ({i}) * {code}.m, {code}.m}}", "Vec", None
        return f"{code}.p[{i}]", "double", float

    def _of_binop(self, e: ast.BinOp) -> tuple[str, str, Any]:
        a, a_type = self.of(e.left)
        b, b_type = self.of(e.right)
        both = "int" if a_type == b_type == "int" else "double"
        if isinstance(e.op, ast.Pow):
            if isinstance(e.right, ast.Constant) and isinstance(e.right.value, int):
                return "(" + " * ".join([a] * e.right.value) + ")", a_type, None
            return f"pow({a}, {b})", "double", float
        if isinstance(e.op, ast.Div):
            return f"((double)({a}) / ({b}))", "double", float
        if isinstance(e.op, ast.Mod):
            return f"floored({a}, {b})", "double", float
        return f"({a} {_OPERATORS[type(e.op)]} {b})", both, None

    def _of_unaryop(self, e: ast.UnaryOp) -> tuple[str, str, Any]:
        code, c_type = self.of(e.operand)
        if isinstance(e.op, ast.Not):
            return f"(!{code})", "int", bool
        return f"(-{code})", c_type, None

    def _of_boolop(self, e: ast.BoolOp) -> tuple[str, str, Any]:
        sign = " && " if isinstance(e.op, ast.And) else " || "
        return "(" + sign.join(self.of(v)[0] for v in e.values) + ")", "int", bool

    def _of_compare(self, e: ast.Compare) -> tuple[str, str, Any]:
        sides = [self.of(s)[0] for s in (e.left, *e.comparators)]
        parts = [f"({a} {_COMPARISONS[type(op)]} {b})" for a, op, b in zip(sides, e.ops, sides[1:], strict=False)]
        return "(" + " && ".join(parts) + ")", "int", bool

    def _of_ifexp(self, e: ast.IfExp) -> tuple[str, str, Any]:
        test, (a, a_type), (b, b_type) = self.of(e.test)[0], self.of(e.body), self.of(e.orelse)
        return f"({test} ? {a} : {b})", a_type if a_type == b_type else "double", None

    def _of_call(self, e: ast.Call) -> tuple[str, str, Any]:
        if isinstance(e.func, ast.Attribute) and self.globals.get(getattr(e.func.value, "id", "")) is math:
            return self._maths(e.func.attr, [self.of(a) for a in e.args])
        if isinstance(e.func, ast.Name) and e.func.id in ("max", "min", "abs", "float", "int"):
            return self._builtin(e.func.id, [self.of(a) for a in e.args])
        called = self._called(e.func)
        if called is power:  # C has the exact one
            return self._maths("pow", [self.of(a) for a in e.args])
        if hasattr(called, "_fields"):
            given = dict(zip(called._fields, e.args, strict=False)) | {k.arg: k.value for k in e.keywords}
            inner = ", ".join(self.of(given[name])[0] for name in called._fields)
            name = self.whole.struct(called)
            return f"({name}){{{inner}}}", name, called
        function = getattr(called, "py_func", called)
        result = get_type_hints(function)["return"]
        inner = ", ".join(self.of(a)[0] for a in e.args)
        return f"{self.whole.add(called)}({inner})", self.whole.type_of(result), result

    def _called(self, e: ast.expr) -> Any:
        """What a call names: a function or a tuple's class, by itself or in a module."""
        found = self.globals.get(e.id) if isinstance(e, ast.Name) else None
        if isinstance(e, ast.Attribute) and isinstance(e.value, ast.Name):
            found = getattr(self.globals.get(e.value.id), e.attr, None)
        if found is None:
            raise UntranslatableError(f"{self.function.__name__}: {ast.unparse(e)}")
        return found

    def _maths(self, name: str, args: list[tuple[str, str]]) -> tuple[str, str, Any]:
        codes = ", ".join(code for code, _ in args)
        if name == "ceil":
            return f"(int)ceil({codes})", "int", int
        if name == "isfinite":
            return f"(isfinite({codes}) != 0)", "int", bool
        if name not in _MATHS:
            raise UntranslatableError(f"{self.function.__name__}: math.{name}")
        return f"{name}({codes})", "double", float

    def _builtin(self, name: str, args: list[tuple[str, str]]) -> tuple[str, str, Any]:
        whole = all(t == "int" for _, t in args)
        code = args[0][0]
        if name in ("float", "int"):
            return f"(({'double' if name == 'float' else 'int'})({code}))", "double" if name == "float" else "int", None
        if name == "abs":
            return f"fabs({code})", "double", float
        how = {"max": "most", "min": "least"}[name] + ("_int" if whole and name == "max" else "")
        for other, _ in args[1:]:
            code = f"{how}({code}, {other})"
        return code, "int" if whole else "double", None


def _is_matrix(annotation: ast.expr | None) -> bool:
    return annotation is not None and ast.unparse(annotation).endswith("Matrix")


def _safe(name: str) -> str:
    """A local name that is no word or function of C."""
    return f"v_{name}"
