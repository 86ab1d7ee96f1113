"""Arithmetic in study files: numbers, names, + - * / **, and a few functions; nothing else is evaluated."""

from __future__ import annotations

import ast
import math
import operator
from collections.abc import Callable, Mapping
from typing import Any

from pkmsea.errors import InputError

LONGEST = 500  # characters
LARGEST_POWER = 100.0
CONSTANTS = {"pi": math.pi}
FUNCTIONS: dict[str, Callable[..., float]] = {
    name: getattr(math, name)
    for name in ("sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sqrt", "exp", "log", "radians", "degrees")
} | {"abs": abs, "min": min, "max": max}


def _power(base: float, exponent: float) -> float:
    if abs(exponent) > LARGEST_POWER:
        raise OverflowError("the power is too high")
    return float(base**exponent)  # of a negative base it may be complex: a TypeError


OPERATORS: dict[type[ast.AST], Callable[..., float]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: _power,
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
    return {node.id for node in _nodes(expression) if isinstance(node, ast.Name)} - CONSTANTS.keys()


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
        value = float(_value(expression, known))
    except (ArithmeticError, ValueError, TypeError) as error:
        at = ", ".join(f"{name} = {known[name]:g}" for name in sorted(names_in(expression)))
        raise InputError(
            f"The expression has no value{f' at {at}' if at else ''} ({error}).", "Correct it.", value=expression
        ) from None
    if not math.isfinite(value):
        raise InputError("The expression has no finite value.", "Correct it.", value=expression)
    return value


def _nodes(expression: str) -> list[Any]:
    """The numbers, names and operations of an expression, each before its operands."""
    if len(expression) > LONGEST:
        raise InputError(f"The expression has more than {LONGEST} characters.", "Shorten it.", value=expression)
    try:
        nodes = [ast.parse(expression.strip(), mode="eval").body]
    except (RecursionError, MemoryError):
        raise InputError("The expression is nested too deeply.", "Shorten it.", value=expression) from None
    except (SyntaxError, ValueError):
        raise InputError("This is no arithmetic expression.", "Correct it.", value=expression) from None
    for node in nodes:  # grows
        nodes += _operands(node, expression)
    return nodes


def _operands(node: Any, whole: str) -> list[Any]:
    number = isinstance(node, ast.Constant) and type(node.value) in (int, float)
    if number or isinstance(node, ast.Name):
        return []
    if isinstance(node, ast.UnaryOp) and type(node.op) in OPERATORS:
        return [node.operand]
    if isinstance(node, ast.BinOp) and type(node.op) in OPERATORS:
        return [node.left, node.right]
    call = isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and not node.keywords
    if call and node.func.id in FUNCTIONS:
        return list(node.args)
    raise InputError(
        "Only numbers, names, + - * / ** and functions are arithmetic here.",
        f"The functions are {', '.join(sorted(FUNCTIONS))}.",
        value=whole,
    )


def _value(expression: str, known: Mapping[str, float]) -> float:
    nodes = _nodes(expression)
    values: dict[Any, float] = {}
    for node in reversed(nodes):
        operands = [values[operand] for operand in _operands(node, expression)]
        if isinstance(node, ast.Constant):
            values[node] = float(node.value)  # type: ignore[arg-type]
        elif isinstance(node, ast.Name):
            if node.id not in known:
                listed = ", ".join(sorted(known))
                raise InputError(f"There is nothing named '{node.id}'.", f"Use one of: {listed}.", value=expression)
            values[node] = known[node.id]
        else:
            function = OPERATORS[type(node.op)] if hasattr(node, "op") else FUNCTIONS[node.func.id]
            values[node] = float(function(*operands))
    return values[nodes[0]]
