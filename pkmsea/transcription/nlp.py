"""A nonlinear program, ready for a solver; nothing solved yet."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np


@dataclass(frozen=True)
class Variable:
    """One decision variable of an NLP: its entries in physical units, and the typical size of their changes."""

    name: str
    lower: np.ndarray
    upper: np.ndarray
    scale: np.ndarray
    guess: np.ndarray


@dataclass(frozen=True, eq=False)
class Nlp:
    """min f(x, p) subject to lower <= x <= upper, g_lower <= g(x, p) <= g_upper.

    Attributes
    ----------
    oracle : Function (x, p) -> (f, g), in physical units like all of this.
    derivatives : `grad_f`, `jac_g` and `hess_lag`, as CasADi names and arranges them, where they are put together by
        hand; else empty.
    steps : how often it is solved, each time warm-started from the last.
    parameter : (step, x) -> p of that step, given the x found so far, in physical units.
    keep : what must outlive the solve (the owner of callback Functions).
    """

    variables: tuple[Variable, ...]
    g_lower: np.ndarray
    g_upper: np.ndarray
    oracle: ca.Function
    steps: int
    parameter: Callable[[int, np.ndarray], np.ndarray]
    derivatives: dict[str, ca.Function] = field(default_factory=dict)
    keep: Any = None

    def stacked(self, key: str) -> np.ndarray:
        """`lower`, `upper`, `scale` or `guess` of all variables, one after the other."""
        return np.concatenate([getattr(variable, key) for variable in self.variables])


class Callback(ca.Callback):
    """A CasADi Function from a Python function on NumPy views; None where an output is not asked for.

    CasADi would swallow a Ctrl-C in here: it is kept, and evaluations in its thread fail until `stop_if` raises it.
    """

    _ctrl_c = threading.local()

    def __init__(
        self,
        name: str,
        inputs: list[tuple[str, ca.Sparsity]],
        outputs: list[tuple[str, ca.Sparsity]],
        function: Callable[..., None],
    ) -> None:
        ca.Callback.__init__(self)
        self.inputs, self.outputs, self.function = inputs, outputs, function
        self.construct(name, {})

    def get_n_in(self) -> int:
        return len(self.inputs)

    def get_n_out(self) -> int:
        return len(self.outputs)

    def get_name_in(self, i: int) -> str:
        return self.inputs[i][0]

    def get_name_out(self, i: int) -> str:
        return self.outputs[i][0]

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        return self.inputs[i][1]

    def get_sparsity_out(self, i: int) -> ca.Sparsity:
        return self.outputs[i][1]

    def has_eval_buffer(self) -> bool:
        return True

    def eval_buffer(self, arguments: Any, results: Any) -> int:
        if hasattr(self._ctrl_c, "came"):
            return 1
        given = [None if x is None else np.frombuffer(x, dtype=float) for x in arguments]
        wanted = [None if x is None else np.frombuffer(x, dtype=float) for x in results]
        try:
            self.function(given, wanted)
        except (np.linalg.LinAlgError, FloatingPointError):
            return 1  # the point cannot be evaluated: IPOPT shortens its step
        except KeyboardInterrupt:
            self._ctrl_c.came = True
            return 1
        return 0

    @classmethod
    def stop_if(cls) -> None:
        """Raise the KeyboardInterrupt that came in an evaluation, if one did."""
        if cls._ctrl_c.__dict__.pop("came", False):
            raise KeyboardInterrupt
