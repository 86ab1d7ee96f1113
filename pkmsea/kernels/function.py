"""CasADi Functions as the vector machine likes them: dense, without common subexpressions, inputs and outputs named."""

from __future__ import annotations

import casadi as ca


def named_function(name: str, inputs: dict[str, ca.SX], outputs: dict[str, ca.SX]) -> ca.Function:
    """A Function with dense outputs whose common subexpressions are merged."""
    results = [ca.densify(x) for x in ca.cse(list(outputs.values()))]
    return ca.Function(name, list(inputs.values()), results, list(inputs), list(outputs))
