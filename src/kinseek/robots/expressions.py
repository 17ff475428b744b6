"""Evaluate expressions of xacro files without Python's `eval`: arithmetic, comparisons, conditionals, and listed functions.

xacro passes the content of ``${…}`` and ``$(eval …)`` to Python, and its restrictions can be circumvented (Batchelder 2012,
"Eval really is dangerous"). Therefore this module evaluates the expressions of untrusted files. It supports what
descriptions of real robots use: numbers, texts, lists, properties and entries of YAML files. Names that begin with an
underscore are rejected.
"""

from __future__ import annotations

import ast
import math
import operator
import unicodedata
from collections.abc import Callable, Mapping
from typing import Any

MOST_DIGITS = 400
"""Most digits of a float before or after its point."""

MOST_ENTRIES = 100_000
"""Most entries of a value or of a YAML file, as `entries` counts them."""

MOST_LETTERS = 10_000
"""Most characters of one expression, and of a text or list that it creates."""
LARGEST = 1e300
"""Largest whole number, including results of powers."""

_OPERATORS: dict[type[ast.AST], Callable[..., Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.FloorDiv: operator.floordiv,
    ast.Mod: operator.mod,
    ast.Pow: operator.pow,
    ast.UAdd: operator.pos,
    ast.USub: operator.neg,
    ast.Not: operator.not_,
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.In: lambda a, b: a in b,
    ast.NotIn: lambda a, b: a not in b,
    ast.Is: operator.is_,
    ast.IsNot: operator.is_not,
}

_MATH = (
    *("acos", "asin", "atan", "atan2", "cos", "sin", "tan", "degrees", "radians", "hypot"),
    *("ceil", "copysign", "exp", "fabs", "floor", "fmod", "log", "sqrt"),
)


def _round(value: Any, digits: Any = None) -> Any:
    """Round like `round`, with a limit on the digits, since `round` computes a power of ten for them."""
    if isinstance(digits, int) and abs(digits) > MOST_DIGITS:
        raise Refused(f"round to {digits:,} digits, expected at most {MOST_DIGITS}")
    return round(value, digits)


FUNCTIONS: dict[str, Callable[..., Any]] = {
    **{name: getattr(math, name) for name in _MATH},
    **{function.__name__: function for function in (abs, bool, float, int, len, max, min, str)},
    "round": _round,
}
"""Functions that may be called. None of them creates a large value from a small one."""

CONSTANTS: dict[str, Any] = {"pi": math.pi, "tau": math.tau, "e": math.e, "inf": math.inf, "nan": math.nan}
_ROOMS = ("math", "python")
"""Namespaces of xacro that contain functions: ``math.sin``."""


def entries(content: Any, most: int) -> int:
    """Count the values and keys of fully expanded content, and stop slightly beyond `most`.

    64 characters of a text count as one more value.
    """
    left, count = [content], 0
    while left and count <= most:
        one = left.pop()
        count += 1
        if isinstance(one, dict | list | tuple):
            left.extend(one)
            left.extend(one.values() if isinstance(one, dict) else ())
        elif isinstance(one, str):
            count += len(one) // 64
    return count


class Refused(Exception):
    """Raised for an expression that is not supported; the message says which part."""


def evaluate(
    expression: str,
    names: Mapping[str, Any],
    functions: Mapping[str, Callable[..., Any]] | None = None,
    spend: Callable[[int], None] = lambda units: None,
) -> Any:
    """Evaluate an expression.

    Args:
        expression: The expression as xacro writes it.
        names: Values of properties; looked up one by one.
        functions: Further functions that may be called, by name or dotted name.
        spend: Called with units of work, of some 0.1 µs each, for operations that traverse a long value; may raise.

    Raises:
        Refused: The expression contains something that is not supported.
        NameError: A name is not defined.
        SyntaxError, ArithmeticError, TypeError, ValueError, LookupError: As the same in Python.
    """
    if len(expression) > MOST_LETTERS:
        raise Refused(f"{len(expression):,} letters in one expression, expected at most {MOST_LETTERS:,}")
    if any(unicodedata.category(letter) == "Cc" and letter not in "\t\n\r" for letter in expression):
        raise Refused("a control character in an expression")  # Otherwise Python would print its warnings.
    try:
        tree = ast.parse(expression.strip(), mode="eval")
        return _Reader(names, FUNCTIONS | dict(functions or {}), spend).value(tree.body)
    except (RecursionError, MemoryError):
        raise Refused("too many brackets or signs") from None


class _Reader:
    def __init__(
        self,
        names: Mapping[str, Any],
        functions: Mapping[str, Callable[..., Any]],
        spend: Callable[[int], None],
    ) -> None:
        self.names, self.functions, self.spend = names, functions, spend

    def value(self, node: ast.expr) -> Any:
        read = getattr(self, f"_{type(node).__name__.lower()}", None)
        if read is None:
            raise Refused(f"{ast.unparse(node)[:60]!r} is not computed ({type(node).__name__})")
        return self._small(read(node))

    def _small(self, value: Any) -> Any:
        """Check that a value stays within the limits."""
        if isinstance(value, str | list | tuple) and len(value) > MOST_LETTERS:
            raise Refused(f"a value of {len(value):,} letters or entries, expected at most {MOST_LETTERS:,}")
        if isinstance(value, int) and abs(value) > LARGEST:
            raise Refused(f"a whole number beyond {LARGEST:g}")
        return value

    def _counted(self, value: Any) -> Any:
        """Check that nested lists stay within the limits, and count the work of traversing them."""
        if isinstance(value, dict | list | tuple):
            count = entries(value, MOST_ENTRIES)
            self.spend(4 * count)
            if count > MOST_ENTRIES:
                raise Refused(f"a value of more than {MOST_ENTRIES:,} entries")
        elif isinstance(value, str):
            self.spend(len(value))  # Searching for one text in another takes that long.
        return value

    def _constant(self, node: ast.Constant) -> Any:
        return node.value

    def _name(self, node: ast.Name) -> Any:
        if node.id.startswith("_"):
            raise Refused(f"the name {node.id!r}")
        try:
            value = self.names[node.id]
        except KeyError:
            if node.id in CONSTANTS:
                return CONSTANTS[node.id]
            raise NameError(f"name {node.id!r} is not defined") from None
        if not isinstance(value, bool | int | float | str | list | tuple | dict | type(None)):
            raise Refused(f"{node.id!r}, which is not a value")
        return value

    def _binop(self, node: ast.BinOp) -> Any:
        a, b = self.value(node.left), self.value(node.right)
        numbers = isinstance(a, bool | int | float) and isinstance(b, bool | int | float)
        if isinstance(node.op, ast.Pow) and numbers:
            return float(a) ** float(b) if abs(b) > 64 else a**b
        if not numbers and not (isinstance(node.op, ast.Add) and type(a) is type(b)):
            raise TypeError(f"{ast.unparse(node)[:60]!r}: not of {type(a).__name__} and {type(b).__name__}")
        return self._counted(self._apply(node.op, a, b))

    def _unaryop(self, node: ast.UnaryOp) -> Any:
        return self._apply(node.op, self.value(node.operand))

    def _boolop(self, node: ast.BoolOp) -> Any:
        decisive = isinstance(node.op, ast.Or)
        value: Any = None
        for part in node.values:
            value = self.value(part)
            if bool(value) is decisive:
                break
        return value

    def _compare(self, node: ast.Compare) -> bool:
        left = self._counted(self.value(node.left))
        for sign, part in zip(node.ops, node.comparators, strict=True):
            right = self._counted(self.value(part))
            if not self._apply(sign, left, right):
                return False
            left = right
        return True

    def _apply(self, sign: ast.AST, *values: Any) -> Any:
        if type(sign) not in _OPERATORS:
            raise Refused(f"the sign {type(sign).__name__}")
        return _OPERATORS[type(sign)](*values)

    def _ifexp(self, node: ast.IfExp) -> Any:
        return self.value(node.body if self.value(node.test) else node.orelse)

    def _list(self, node: ast.List) -> Any:
        return self._counted([self.value(part) for part in node.elts])

    def _tuple(self, node: ast.Tuple) -> Any:
        return self._counted(tuple(self.value(part) for part in node.elts))

    def _subscript(self, node: ast.Subscript) -> Any:
        whole, key = self.value(node.value), self.value(node.slice)
        if not isinstance(whole, str | list | tuple | dict):
            raise TypeError(f"{ast.unparse(node.value)[:60]!r} has no entries")
        return self._entry(whole, key)

    def _attribute(self, node: ast.Attribute) -> Any:
        if node.attr.startswith("_"):
            raise Refused(f"the name {node.attr!r}")
        if isinstance(node.value, ast.Name) and node.value.id in _ROOMS and node.attr in CONSTANTS:
            return CONSTANTS[node.attr]
        whole = self.value(node.value)
        if not isinstance(
            whole, dict
        ):  # Entries of YAML files are written this way; nothing else has attributes here.
            raise Refused(f"{ast.unparse(node)[:60]!r}")
        return self._entry(whole, node.attr)

    def _entry(self, whole: Any, key: Any) -> Any:
        if isinstance(whole, dict) and key not in whole:
            raise LookupError(f"there is no key {str(key)[:60]!r}")
        return whole[key]

    def _call(self, node: ast.Call) -> Any:
        name = ast.unparse(node.func)
        for room in _ROOMS:
            name = name.removeprefix(f"{room}.")
        if name not in self.functions or node.keywords:
            raise Refused(f"the call of {ast.unparse(node.func)[:60]!r}")
        return self.functions[name](*(self._counted(self.value(part)) for part in node.args))
