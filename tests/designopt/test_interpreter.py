"""What NumPy computes of a traced program is what XLA computes of it."""

from __future__ import annotations

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax
from jax.extend.core import ClosedJaxpr, Jaxpr

from designopt.interpreter import RULES, Interpreter, interpret
from optics import find_views, read_scene
from tests.helpers import SCENES

RNG = np.random.default_rng(3)
X = RNG.normal(size=(3, 4))
Y = RNG.normal(size=(3, 4))
P = np.abs(X) + 0.1
UNIT = np.tanh(X)
ODD = np.array([-0.0, 0.0, np.nan, np.inf, -np.inf, 1.5, 2.5, -0.5])
WHOLE = np.array([-7, -1, 0, 3, 8])
OTHER = np.array([2, 3, -5, -2, 3])
LEAST = np.array([np.iinfo(int).min, np.iinfo(int).max])
BITS = np.array([True, False, True, False])


@jax.custom_jvp
def doubled(value):
    return 2 * value


doubled.defjvp(lambda primals, tangents: (doubled(*primals), 2 * tangents[0]))


@jax.custom_vjp
def tripled(value):
    return 3 * value


tripled.defvjp(lambda value: (3 * value, None), lambda _, slope: (3 * slope,))


def halvings(value):
    """How often a number can be halved until it is less than 1: another count for each."""
    start = value, 0
    return lax.while_loop(lambda s: s[0] >= 1, lambda s: (s[0] / 2, s[1] + 1), start)[1]


def summed(values, *, reverse=False):
    def step(total, one):
        return total + one, (total * one, one > 0)

    return lax.scan(step, jnp.zeros(4), values, reverse=reverse)


def gathered(mode, fill=None):
    return lambda x, i: x.at[i].get(mode=mode, fill_value=fill)


CASES = {
    "arithmetic": (lambda x, y: (x + y, x - y, x * y, -x, x / y, lax.rem(x, y)), X, Y),
    "whole numbers": (lambda x, y: (lax.div(x, y), lax.rem(x, y), x // y, x % y), WHOLE, OTHER),
    "division by zero": (
        lambda x: (lax.div(x, jnp.zeros_like(x)), lax.rem(x, jnp.zeros_like(x))),
        WHOLE,
    ),
    "the least number": (lambda x: (lax.div(x, 2), lax.div(x, 3), lax.rem(x, -3)), LEAST),
    "what does not fit": (
        lambda x: (x.astype(jnp.int32), x.astype(int), x.astype(jnp.uint8)),
        np.array([np.nan, np.inf, -np.inf, 1e12, 300.0, -3.7, 254.9, 1e300]),
    ),
    "mixed types": (lax.pow, X.astype(np.float32), np.full((3, 4), 3)),
    "a case beyond": (
        lambda x, w: lax.select_n(w, x, -x, 2 * x),
        X[0],
        np.array([5, -3, 1, 2]),
    ),
    "bits": (
        lambda x, y: (x & y, x | y, x ^ y, ~x, x << 2, x >> 1),
        WHOLE,
        OTHER,
    ),
    "truth": (lambda x, y: (x & y, x | y, ~x, jnp.any(x), jnp.all(x)), BITS, ~BITS),
    "comparisons": (
        lambda x, y: (x == y, x != y, x < y, x <= y, x > y, x >= y),
        ODD,
        ODD[::-1].copy(),
    ),
    "powers": (lambda x, p: (x**2, x**3, p**-1, p**x, lax.square(x)), X, P),
    "roots": (lambda p: (jnp.sqrt(p), lax.rsqrt(p), jnp.cbrt(p)), P),
    "exponents": (lambda x, p: (jnp.exp(x), jnp.expm1(x), jnp.log(p), jnp.log1p(p)), X, P),
    "angles": (
        lambda x, y, u: (
            jnp.sin(x),
            jnp.cos(x),
            jnp.tan(x),
            jnp.arctan2(y, x),
            jnp.arcsin(u),
            jnp.arccos(u),
            jnp.arctan(x),
            jnp.sinh(x),
            jnp.cosh(x),
            jnp.tanh(x),
        ),
        X,
        Y,
        UNIT,
    ),
    "signs": (lambda x: (jnp.abs(x), jnp.sign(x), jnp.isfinite(x), lax.nextafter(x, 1.0)), ODD),
    "rounding": (
        lambda x: (jnp.floor(x), jnp.ceil(x), jnp.round(x), lax.round(x)),
        np.append(ODD, [0.49999999999999994, -0.49999999999999994, 4503599627370497.0]),
    ),
    "limits": (
        lambda x, y: (jnp.maximum(x, y), jnp.minimum(x, y), lax.clamp(-0.3, x, 0.4)),
        ODD,
        ODD[::-1].copy(),
    ),
    "choices": (
        lambda x, y, w: (jnp.where(x > 0, x, y), lax.select_n(w, x[0], y[0], x[1])),
        X,
        Y,
        np.array([2, 0, 1, 2]),
    ),
    "types": (lambda x, w: (x.astype(int), w.astype(jnp.float32), (w > 0).astype(float)), X, WHOLE),
    "shapes": (
        lambda x: (
            x.T,
            x.reshape(2, 6),
            x[::-1],
            x[:, 1:4:2],
            x[None, :, 0],
            jnp.squeeze(x[:1]),
            jnp.tile(x, (2, 3)),
            jnp.broadcast_to(x[:, :1], (2, 3, 5)),
            lax.broadcasted_iota(int, (2, 3), 1),
        ),
        X,
    ),
    "joining": (
        lambda x, y: (
            jnp.concatenate([x, y], axis=1),
            jnp.stack([x, y], axis=1),
            jnp.split(x, [1], axis=1),
            jnp.unstack(x, axis=1),
            jnp.pad(x, ((1, 2), (0, 1))),
            lax.pad(x, 0.5, ((0, 1, 2), (1, 0, 0))),
            lax.pad(x, 0.5, ((-1, 0, 0), (0, 0, 0))),
        ),
        X,
        Y,
    ),
    "moving windows": (
        lambda x, i: (
            lax.dynamic_slice(x, (i, -1), (2, 3)),
            lax.dynamic_update_slice(x, jnp.ones((2, 2)), (i, i)),
        ),
        X,
        np.array(2),
    ),
    "reductions": (
        lambda x: (
            jnp.sum(x, axis=0),
            jnp.prod(x, axis=1),
            jnp.max(x, axis=(0, 1)),
            jnp.min(x, axis=0),
            jnp.argmax(x, axis=1),
            jnp.argmin(x, axis=0),
            jnp.max(x > 0, axis=0),
            jnp.max(x.astype(int)),
            jnp.min(jnp.zeros((0, 2)), axis=0, initial=3.0),
        ),
        X,
    ),
    "of numbers that are none": (lambda x: (jnp.max(x), jnp.min(x), jnp.argmax(x)), ODD),
    "along an axis": (
        lambda x: (
            jnp.cumsum(x, axis=0),
            jnp.cumprod(x, axis=1),
            lax.cummax(x, axis=1),
            lax.cummin(x, axis=0, reverse=True),
            lax.cumsum(x, axis=1, reverse=True),
        ),
        X,
    ),
    "order": (
        lambda x, w: (
            jnp.sort(x, axis=0),
            jnp.argsort(x, axis=1),
            lax.sort((w, w + 1, w * w), num_keys=2),
        ),
        X,
        WHOLE,
    ),
    "with numbers that are none in order": (jnp.argsort, ODD),
    "places in order": (
        lambda x, w: (
            jnp.searchsorted(jnp.cumsum(w * w), jnp.arange(6), method="scan_unrolled"),
            jnp.searchsorted(jnp.sort(x.reshape(-1)), x[0]),
        ),
        X,
        WHOLE,
    ),
    "products": (
        lambda x, y, z: (x @ y.T, jnp.einsum("ij,ij->i", x, y), jnp.einsum("bij,bjk->bik", z, z)),
        X,
        Y,
        RNG.normal(size=(2, 3, 3)),
    ),
    "indices": (gathered("promise_in_bounds"), X, np.array([2, 0, 2])),
    "indices beyond": (gathered("fill"), X, np.array([2, 7, -9])),
    "whole numbers beyond": (gathered("fill"), WHOLE, np.array([[2, 7], [-9, 1]])),
    "filled": (gathered("fill", -1.0), X, np.array([5, 1])),
    "clipped": (gathered("clip"), X, np.array([5, -9, 1])),
    "indices of both axes": (lambda x, i: x[i, i], X, np.array([[2, 0], [1, 1]])),
    "indices of a batch": (
        jax.vmap(lambda x, i: (x[i], x.at[i].set(0.0))),
        X,
        np.array([[0, 3], [1, 1], [2, -1]]),
    ),
    "rows of a batch": (
        jax.vmap(lambda x, i: lax.dynamic_slice(x, (i, 1), (2, 3))),
        RNG.normal(size=(3, 4, 5)),
        np.array([0, 3, 1]),
    ),
    "set": (lambda x, i: x.at[i, 1].set(7.0), X, np.array([0, 2])),
    "set beyond": (lambda x, i: x.at[i, 1].set(7.0, mode="drop"), X, np.array([0, 9])),
    "set rows": (lambda x, i: x.at[i].set(7.0), X, np.array([0, 2])),
    "added": (lambda x, i: x.at[i, i].add(x[0, :3]), X, np.array([0, 2, 2])),
    "calls": (
        lambda x: (
            doubled(x),
            tripled(x),
            lax.stop_gradient(x),
            lax.optimization_barrier(x),
            jax.checkpoint(jnp.sin)(x),
            jax.jit(jnp.copy)(x),
        ),
        X,
    ),
    "slopes": (jax.vmap(jax.grad(lambda x: jnp.sum(jnp.sin(x) * x**2) + x[0])), X),
    "branches": (
        lambda x, i: lax.switch(i, [jnp.sin, lambda v: -v, jnp.exp], x),
        X,
        np.array(1),
    ),
    "a branch beyond": (lambda x, i: lax.switch(i, [jnp.sin, jnp.cos], x), X, np.array(9)),
    "steps": (summed, X),
    "steps backwards": (lambda x: summed(x, reverse=True), X),
    "rounds": (lambda x: lax.fori_loop(0, 5, lambda i, s: s + i * x, x), X),
    "until it ends": (halvings, 37.0),
    "until each ends": (jax.vmap(halvings), np.array([37.0, 0.2, 5.0])),
    "no rule": (lambda x: (jax.scipy.special.gammaln(x), jnp.linalg.qr(x)[1]), P),
    "linear equations": (
        lambda a, b: (
            jnp.linalg.solve(a, b),
            jnp.linalg.solve(a[0], b[0, :, 0]),
            jnp.linalg.solve(a[0].T, b[1]),
            lax.linalg.lu(a)[1:],
            lax.linalg.lu(b)[0],
            lax.linalg.lu_pivots_to_permutation(lax.linalg.lu(b)[1], 4),
        ),
        RNG.normal(size=(3, 4, 4)),
        RNG.normal(size=(3, 4, 2)),
    ),
    "triangular equations": (
        lambda a, b: [
            lax.linalg.triangular_solve(
                a,
                b if left else b.mT,
                left_side=left,
                lower=lower,
                transpose_a=transpose,
                unit_diagonal=unit,
            )
            for left, lower, transpose, unit in itertools.product([False, True], repeat=4)
        ],
        RNG.normal(size=(3, 4, 4)) + 4 * np.eye(4),
        RNG.normal(size=(3, 4, 2)),
    ),
    "a matrix without an inverse": (
        lambda a: (lax.linalg.lu(a)[0], jnp.linalg.solve(a, jnp.ones(3))),
        np.array([[0.0, 2.0, 1.0], [0.0, 1.0, 5.0], [0.0, 4.0, 2.0]]),
    ),
    "singular values": (
        lambda a: (
            jnp.linalg.svd(a, compute_uv=False),
            [jnp.abs(one) for one in jnp.linalg.svd(a, full_matrices=False)],
            jnp.linalg.svd(a.at[1, 0, 0].set(jnp.nan), compute_uv=False),
            jnp.abs(jnp.linalg.svd(a.at[1, 0, 0].set(jnp.nan), full_matrices=False)[0]),
        ),
        RNG.normal(size=(3, 4, 3)),
    ),
    "single precision": (lambda x: jnp.cos(x) / 3 + x**2, X.astype(np.float32)),
}


@pytest.mark.parametrize("name", CASES)
def test_numpy_computes_what_xla_computes(name):
    function, *args = CASES[name]
    wanted = jax.jit(function)(*args)
    found = interpret(function, *args)
    assert jax.tree.structure(found) == jax.tree.structure(wanted)
    for one, other in zip(jax.tree.leaves(found), jax.tree.leaves(wanted), strict=True):
        assert isinstance(one, np.ndarray)
        assert (one.shape, one.dtype) == (other.shape, other.dtype)
        tolerance = 1e-6 if one.dtype == np.float32 else 1e-13
        np.testing.assert_allclose(one, other, rtol=tolerance, atol=tolerance)
        if name == "signs":
            np.testing.assert_array_equal(np.signbit(one), np.signbit(other))


def primitives(program):
    """Names of all primitives of a program, and of those that it calls."""
    names = set()
    for equation in program.eqns:
        names.add(equation.primitive.name)
        for given in equation.params.values():
            for one in given if isinstance(given, tuple | list) else [given]:
                if isinstance(one, ClosedJaxpr | Jaxpr):
                    names |= primitives(one.jaxpr if isinstance(one, ClosedJaxpr) else one)
    return names


def test_every_rule_is_compared():
    used = {
        name
        for function, *args in CASES.values()
        for name in primitives(jax.jit(function).trace(*args).jaxpr.jaxpr)
    }
    assert not RULES.keys() - used


def test_views_are_those_of_the_compiled_search():
    scene = read_scene(SCENES / "finger.toml")
    angles = jnp.radians(jnp.array([40.0, 25.0]))
    wanted = find_views(scene, angles)
    traced = jax.jit(find_views).trace(scene, angles)
    found = Interpreter(traced)(scene, angles)
    assert np.sum(found.value.present) >= 3
    for one, other in zip(jax.tree.leaves(found), jax.tree.leaves(wanted), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-12)


def test_a_program_is_interpreted_again_with_other_numbers():
    traced = jax.jit(lambda x, *, y: x @ y).trace(X, y=Y.T)
    program = Interpreter(traced)
    np.testing.assert_allclose(program(X, y=Y.T), X @ Y.T)
    np.testing.assert_allclose(program(2 * X, y=X.T), 2 * X @ X.T)
