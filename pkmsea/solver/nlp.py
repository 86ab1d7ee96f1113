"""An NLP as a solver sees it: each variable divided by its scale, so that typical changes are of one size."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from pkmsea.transcription.nlp import Callback, Nlp


@dataclass(frozen=True, eq=False)
class ScaledNlp:
    """min f(S z, p) subject to lower <= z <= upper, g_lower <= g(S z, p) <= g_upper; x = S z, S = diag(scale).

    Attributes
    ----------
    scale, lower, upper : of all variables (n,); the bounds are those of z.
    oracle, derivatives : as those of `Nlp`, of z: grad_f, columns of jac_g, rows and columns of hess_lag times S.
    """

    scale: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    oracle: ca.Function
    derivatives: dict[str, ca.Function]


def scaled(nlp: Nlp) -> ScaledNlp:
    """Divide an NLP's variables by their scales."""
    scale = nlp.stacked("scale")
    oracle, derivatives = nlp.oracle, nlp.derivatives
    if not np.all(scale == 1.0):
        oracle = _of(oracle, scale)
        derivatives = {name: _of(function, scale) for name, function in derivatives.items()}
    return ScaledNlp(scale, nlp.stacked("lower") / scale, nlp.stacked("upper") / scale, oracle, derivatives)


def _of(function: ca.Function, scale: np.ndarray) -> ca.Function:
    """A Function whose first input is x, as one of z; first and second derivatives in x are multiplied by S."""
    if isinstance(function, Callback):
        factors = [_factor(*output, scale) for output in function.outputs]
        return Callback(function.name(), function.inputs, function.outputs, _scaling(function.function, factors, scale))
    inputs = function.mx_in()
    results = function.call([inputs[0] * scale, *inputs[1:]])
    outputs = []
    for i, (name, result) in enumerate(zip(function.name_out(), results, strict=True)):
        factor = _factor(name, function.sparsity_out(i), scale)
        outputs.append(result if factor is None else result * ca.DM(function.sparsity_out(i), factor))
    return ca.Function(function.name(), inputs, outputs, function.name_in(), function.name_out())


def _factor(name: str, sparsity: ca.Sparsity, scale: np.ndarray) -> np.ndarray | None:
    """Of the nonzeros of an output: CasADi names derivatives in x so that they end in _x, second ones in _x_x."""
    rows, columns = (np.array(indices, int) for indices in sparsity.get_triplet())
    if name.endswith("_x_x"):
        return np.asarray(scale[rows] * scale[columns])
    if name.startswith("jac_") and name.endswith("_x"):
        return np.asarray(scale[columns])
    return np.asarray(scale[rows]) if name.endswith("_x") else None


def _scaling(
    function: Callable[..., None], factors: list[np.ndarray | None], scale: np.ndarray
) -> Callable[[list[Any], list[Any]], None]:
    def of_z(given: list[Any], wanted: list[Any]) -> None:
        function([given[0] * scale, *given[1:]], wanted)
        for values, factor in zip(wanted, factors, strict=True):
            if values is not None and factor is not None:
                values *= factor

    return of_z
