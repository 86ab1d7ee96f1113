"""The vector machine: the numbers of CasADi's own interpreter to the last bit, for all that CasADi can emit."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pkmsea.bridge import _bridge
from pkmsea.errors import BridgeError
from pkmsea.kernels import Batch, Pipeline, program

COUNT = 37  # instants; no multiple of any vector's width
ULP = 2.0  # of sin, cos and exp beside libm's; all else is exact
UNARY = (
    "neg", "log", "sqrt", "sq", "twice", "tan", "asin", "acos", "atan", "not", "floor", "ceil", "fabs", "sign", "erf",
    "inv", "sinh", "cosh", "tanh", "asinh", "acosh", "atanh", "erfinv", "log1p", "expm1",
)  # fmt: skip
BINARY = (
    "add", "sub", "mul", "div", "pow", "constpow", "lt", "le", "eq", "ne", "and", "or", "fmod", "copysign",
    "if_else_zero", "fmin", "fmax", "atan2", "hypot", "remainder",
)  # fmt: skip
APPROXIMATE = ("sin", "cos", "exp")
SPECIAL = (0.0, -0.0, 1.0, -1.0, 0.5, np.inf, -np.inf, np.nan, 1e-310, 1e300, 3.0, -2.5)

OPERATIONS = {
    "neg": lambda x: -x, "sq": lambda x: x**2, "twice": lambda x: 2 * x,
    "if_else_zero": lambda x, y: ca.if_else(x, y, 0), "not": ca.logic_not, "inv": lambda x: 1 / x,
    "add": lambda x, y: x + y, "sub": lambda x, y: x - y,
    "mul": lambda x, y: x * y, "div": lambda x, y: x / y, "pow": lambda x, y: x**y, "constpow": lambda x, y: x**2.7,
    "lt": lambda x, y: x < y, "le": lambda x, y: x <= y, "eq": lambda x, y: x == y, "ne": lambda x, y: x != y,
    "and": ca.logic_and, "or": ca.logic_or,
}  # fmt: skip


def operation(name: str):
    return OPERATIONS.get(name) or getattr(ca, name)


def mapped(function: ca.Function, arguments: list[np.ndarray]) -> list[np.ndarray]:
    """Nonzeros (rows, instants) of each output by CasADi's own map."""
    k = max(x.shape[1] for x in arguments)
    spread = [np.broadcast_to(x, (x.shape[0], k)) for x in arguments]
    found = function.map(k).call([ca.DM(x) for x in spread])
    return [np.array(y.nonzeros()).reshape(k, -1).T for y in found]


def by_machine(
    function: ca.Function, arguments: list[np.ndarray], lanes: str = "", uniform: tuple[str, ...] = (), threads: int = 1
) -> list[np.ndarray]:
    k = max(x.shape[1] for x in arguments)
    outputs = [np.full((function.nnz_out(i), k), 7.0) for i in range(function.n_out())]
    given_ = [
        x[:, 0].copy() if name in uniform else np.broadcast_to(x, (x.shape[0], k)).copy()
        for name, x in zip(function.name_in(), arguments, strict=True)
    ]
    pipeline = Pipeline(k, lanes)
    pipeline.call(program(function, tuple(uniform)), given_, outputs)
    pipeline.run(threads)
    return outputs


def assert_same_bits(found: list[np.ndarray], expected: list[np.ndarray]) -> None:
    for a, b in zip(found, expected, strict=True):
        same = (a.view(np.int64) == b.view(np.int64)) | (np.isnan(a) & np.isnan(b))
        assert np.all(same), (a[~same][:3], b[~same][:3])


@st.composite
def programs(draw: st.DrawFn) -> ca.Function:
    """Random SX Functions of lanes x and uniform p, over all exact operations, with shared and unused values."""
    x, p = ca.SX.sym("x", 3), ca.SX.sym("p", 2)
    values = [*ca.vertsplit(x), *ca.vertsplit(p), ca.SX(draw(st.sampled_from(SPECIAL)))]
    for _ in range(draw(st.integers(1, 40))):
        name = draw(st.sampled_from((*UNARY, *BINARY, "add", "sub", "mul", "mul", "sub")))
        arity = 2 if name in BINARY else 1
        # CasADi's simplification of f(f(x)) and x - x happens before, so both sides see the same instructions
        values.append(operation(name)(*(draw(st.sampled_from(values)) for _ in range(arity))))
    outputs = [ca.vertcat(*draw(st.lists(st.sampled_from(values), min_size=1, max_size=4))) for _ in range(2)]
    return ca.Function("random", [x, p], [ca.sparsify(y) for y in outputs], ["x", "p"], ["first", "second"])


numbers = st.one_of(st.sampled_from(SPECIAL), st.floats(-5, 5), st.floats(allow_nan=True, allow_infinity=True))


@settings(max_examples=200, deadline=None)
@given(programs(), st.lists(numbers, min_size=30, max_size=30), st.sampled_from(_bridge.lanes()), st.booleans())
def test_random_programs_equal_casadis_map_to_the_last_bit(
    function: ca.Function, drawn: list[float], lanes: str, uniform: bool
) -> None:
    x = np.resize(np.array(drawn), (3, COUNT))
    p = np.array(drawn[:2])[:, None]
    found = by_machine(function, [x, p], lanes, ("p",) if uniform else ())
    assert_same_bits(found, mapped(function, [x, p]))


@pytest.mark.parametrize("name", APPROXIMATE)
@pytest.mark.parametrize("lanes", _bridge.lanes())
def test_transcendental_functions_are_within_two_ulp(name: str, lanes: str) -> None:
    t = ca.SX.sym("t")
    function = ca.Function("f", [t], [operation(name)(t)])
    rng = np.random.default_rng(0)
    quarters = np.round(rng.uniform(-6e5, 6e5, 3000)) * np.pi / 2 * (1 + rng.integers(-2, 3, 3000) * 2.0**-52)
    spread = np.exp(rng.uniform(-600, 600, 3000)) * rng.choice([-1, 1], 3000)
    x = np.concatenate([SPECIAL, rng.uniform(-10, 10, 3000), rng.uniform(-750, 750, 3000), quarters, spread])[None]
    (found,), (expected,) = by_machine(function, [x], lanes), mapped(function, [x])
    finite = np.isfinite(expected)
    assert np.array_equal(finite, np.isfinite(found))
    assert np.array_equal(found[~finite], expected[~finite], equal_nan=True)
    error = np.abs(found[finite] - expected[finite]) / np.spacing(np.abs(expected[finite]))
    assert error.max() <= ULP
    assert np.array_equal(np.signbit(found[finite]), np.signbit(expected[finite]))


def test_all_instruction_sets_give_the_same_bits() -> None:
    x = ca.SX.sym("x", 3)
    angles = ca.vertcat(ca.sin(x) * ca.cos(x), ca.exp(x) * x, ca.sqrt(ca.fabs(x)) / x, ca.cos(x[0]))
    function = ca.Function("f", [x], [ca.jacobian(angles, x)])
    arguments = [np.random.default_rng(0).normal(size=(3, 500))]
    plain, *others = (by_machine(function, arguments, lanes) for lanes in reversed(_bridge.lanes()))
    for other in others:
        assert_same_bits(other, plain)


@pytest.mark.parametrize("count", [1, 7, 8, 9, 64, 1000])
def test_any_number_of_instants_and_threads(count: int) -> None:
    x, p = ca.SX.sym("x", 3), ca.SX.sym("p", 2)
    function = ca.Function("f", [x, p], [x * p[0] - x[0] * x[1], ca.SX(3.5), p], ["x", "p"], ["a", "b", "c"])
    rng = np.random.default_rng(0)
    arguments = [rng.normal(size=(3, count)), rng.normal(size=(2, 1))]
    for threads in (1, 2, 5):
        assert_same_bits(by_machine(function, arguments, uniform=("p",), threads=threads), mapped(function, arguments))


def test_unknown_instructions_are_typed_errors() -> None:
    x = ca.SX.sym("x", 2)
    inner = ca.Function("inner", [x], [ca.sin(x)], {"never_inline": True})
    with pytest.raises(BridgeError, match=r"'outer' is operation \d+ of CasADi's.*elementary operations"):
        program(ca.Function("outer", [x], [inner(x)], {"never_inline": True}))
    with pytest.raises(BridgeError, match="is no SX Function"):
        program(ca.Function("mx", [y := ca.MX.sym("y")], [y]))
    with pytest.raises(BridgeError, match="'printing' is operation"):
        program(ca.Function("printing", [x], [x.printme(3)]))


def test_arrays_of_another_size_are_refused() -> None:
    x = ca.SX.sym("x", 2)
    pipeline, square = Pipeline(5), program(ca.Function("square", [x], [x**2]))
    with pytest.raises(ValueError, match="another size than 2 x 5"):
        pipeline.call(square, [np.zeros((2, 4))], [np.zeros((2, 5))])
    with pytest.raises(ValueError, match="another number of arrays"):
        pipeline.call(square, [np.zeros((2, 5))] * 2, [np.zeros((2, 5))])


@pytest.mark.parametrize("n", [1, 2, 5, 12])
@pytest.mark.parametrize("lanes", _bridge.lanes())
def test_linear_systems_agree_with_lapack(n: int, lanes: str) -> None:
    rng = np.random.default_rng(n)
    matrices, right = rng.normal(size=(COUNT, n, n)), rng.normal(size=(COUNT, n, 3))
    matrices[::3] = matrices[::3][:, rng.permutation(n)]  # other pivots from lane to lane
    pipeline = Pipeline(COUNT, lanes)
    columns = np.ascontiguousarray(matrices.transpose(2, 1, 0).reshape(n * n, COUNT))
    plain, transposed = (np.ascontiguousarray(right.transpose(2, 1, 0).reshape(3 * n, COUNT)) for _ in range(2))
    factors = pipeline.factor(columns)
    pipeline.solve(factors, plain)
    pipeline.solve(factors, transposed, transposed=True)
    pipeline.run()
    for found, matrix in ((plain, matrices), (transposed, matrices.transpose(0, 2, 1))):
        solution = found.reshape(3, n, COUNT).transpose(2, 1, 0)
        residual = np.abs(matrix @ solution - right).max(axis=(1, 2))
        size = np.abs(matrix).max(axis=(1, 2)) * np.abs(solution).max(axis=(1, 2))
        assert np.all(residual <= 1e-14 * n * size)
    np.testing.assert_array_equal(factors.sign, np.sign(np.linalg.det(matrices)))


def test_a_singular_matrix_has_no_sign() -> None:
    pipeline = Pipeline(2)
    factors = pipeline.factor(np.array([[1.0, 1.0], [2.0, 2.0], [2.0, 1.0], [4.0, 1.0]]))
    pipeline.run()
    np.testing.assert_array_equal(factors.sign, [0.0, -1.0])


def test_batch_takes_rows_per_instant() -> None:
    x, y = ca.SX.sym("x", 3), ca.SX.sym("y", 2)
    function = ca.Function("f", [x, y], [x[:2] * y, ca.mtimes(x, y.T)])
    rng = np.random.default_rng(0)
    X, Y = rng.normal(size=(COUNT, 3)), rng.normal(size=2)
    product, outer = Batch(function, COUNT)(X, Y)
    np.testing.assert_array_equal(product, X[:, :2] * Y)
    np.testing.assert_array_equal(outer, X[:, :, None] * Y)
