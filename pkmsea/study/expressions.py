"""Arithmetic in study files: numbers, names, + - * / **, and a few functions; nothing else is evaluated."""

from __future__ import annotations

import ast
import math
import operator
from collections.abc import Callable, Mapping

from pkmsea.errors import InputError

LONGEST = 500  # characters
LARGEST_POWER = 100.0
CONSTANTS = {"pi": math.pi}
FUNCTIONS: dict[str, Callable[..., float]] = {
    name: getattr(math, name)
    for name in ("sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sqrt", "exp", "log", "radians", "degrees")
} | {"abs": abs, "min": min, "max": max}
OPERATORS: dict[type[ast.AST], Callable[..., float]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.USub: operator.neg,
    ast.UAdd: operator.pos,
}


def names_in(expression: str | float) -> set[str]:
    """The names that an expression asks for.

    Raises
    ------
    InputError : it is no arithmetic.
    """
    if not isinstance(expression, str):
        return set()
    called = {node.func.id for node in ast.walk(_tree(expression)) if _is_call(node)}  # type: ignore[attr-defined]
    used = {node.id for node in ast.walk(_tree(expression)) if isinstance(node, ast.Name)}
    return used - called - CONSTANTS.keys()


def evaluate(expression: str | float, names: Mapping[str, float]) -> float:
    """The value of an expression; angles are in rad unless `radians` says otherwise.

    Raises
    ------
    InputError : it is no arithmetic, asks for an unknown name, or has no finite value.
    """
    if not isinstance(expression, str):
        return float(expression)
    known = CONSTANTS | dict(names)
    try:
        value = float(_value(_tree(expression), known, expression))
    except (ArithmeticError, ValueError, TypeError) as error:
        at = ", ".join(f"{name} = {known[name]:g}" for name in sorted(names_in(expression)))
        raise InputError(
            f"The expression has no value{f' at {at}' if at else ''} ({error}).", "Correct it.", value=expression
        ) from None
    if not math.isfinite(value):
        raise InputError("The expression has no finite value.", "Correct it.", value=expression)
    return value


def _tree(expression: str) -> ast.expr:
    if len(expression) > LONGEST:
        raise InputError(f"The expression has more than {LONGEST} characters.", "Shorten it.", value=expression)
    try:
        return ast.parse(expression.strip(), mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        raise InputError("This is no arithmetic expression.", "Correct it.", value=expression) from None


def _is_call(node: ast.AST) -> bool:
    return isinstance(node, ast.Call) and isinstance(node.func, ast.Name)


def _value(node: ast.expr, known: Mapping[str, float], whole: str) -> float:
    def inner(part: ast.expr) -> float:
        return _value(part, known, whole)

    if isinstance(node, ast.Constant) and isinstance(node.value, int | float) and not isinstance(node.value, bool):
        return float(node.value)
    if isinstance(node, ast.Name):
        if node.id not in known:
            raise InputError(
                f"There is nothing named '{node.id}'.", f"Use one of: {', '.join(sorted(known))}.", value=whole
            )
        return known[node.id]
    if isinstance(node, ast.UnaryOp) and type(node.op) in OPERATORS:
        return OPERATORS[type(node.op)](inner(node.operand))
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow):
        exponent = inner(node.right)
        if abs(exponent) > LARGEST_POWER:
            raise OverflowError("the power is too high")
        return float(inner(node.left) ** exponent)
    if isinstance(node, ast.BinOp) and type(node.op) in OPERATORS:
        return OPERATORS[type(node.op)](inner(node.left), inner(node.right))
    if _is_call(node) and node.func.id in FUNCTIONS and not node.keywords:  # type: ignore[attr-defined]
        return FUNCTIONS[node.func.id](*map(inner, node.args))  # type: ignore[attr-defined]
    raise InputError(
        "Only numbers, names, + - * / ** and functions are arithmetic here.",
        f"The functions are {', '.join(sorted(FUNCTIONS))}.",
        value=whole,
    )
