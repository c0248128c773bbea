"""Programs that JAX has traced, computed by NumPy: an answer before anything is compiled.

Tracing a program takes a fraction of the time that compiling it takes. What NumPy has no
counterpart for, JAX computes, one operation at a time.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.extend.core import ClosedJaxpr, Jaxpr, JaxprEqn, Literal

from designopt import numpy_program as ops
from designopt.numpy_program import NumpyProgram, Operation, Step

Rule = Callable[[JaxprEqn], Operation | None]
"""What computes an equation, in a form that can be pickled; ``None`` if that is JAX's to do."""

Call = Callable[[JaxprEqn, list[int]], tuple[ClosedJaxpr, list[int]]]
"""Of an equation and the places of its arguments the program that it calls, and that one's."""

MOST_FOLDED = 1024
"""Numbers of the largest array that takes the place of the steps that compute it."""


class Interpreter:
    """A traced program, computed by NumPy.

    It has the equations of the compiled program, so that the results agree but for rounding.

    Example:
        >>> import jax.numpy as jnp
        >>> traced = jax.jit(lambda value: {"half": jnp.sqrt(value) / 2}).trace(9.0)
        >>> {name: float(one) for name, one in Interpreter(traced)(9.0).items()}
        {'half': 1.5}
    """

    def __init__(self, traced: jax.stages.Traced) -> None:
        """The program.

        Args:
            traced: as `jax.jit(function).trace(...)` returns it; no argument is static.
        """
        self._program = translate(traced.jaxpr)
        self._types = [var.aval.dtype for var in traced.jaxpr.jaxpr.invars]
        self._tree = Structure(jax.tree.structure(traced.out_info))

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        """What the function returns, in NumPy arrays."""
        leaves = jax.tree.leaves((args, kwargs))
        given = [np.asarray(one, dtype) for one, dtype in zip(leaves, self._types, strict=True)]
        with np.errstate(all="ignore"):
            found = self._program(*given)
        return jax.tree.unflatten(self._tree.definition, [np.asarray(one) for one in found])


@dataclass(frozen=True)
class Structure:
    """How a tree is nested, in a form that can be pickled where its nodes can.

    Example:
        >>> import pickle
        >>> structure = Structure(jax.tree.structure({"a": (1.5, None)}))
        >>> pickle.loads(pickle.dumps(structure)) == structure
        True
    """

    definition: Any

    def __reduce__(self) -> tuple[Any, ...]:
        # What JAX has of it cannot be pickled, but a tree of it can.
        tree = jax.tree.unflatten(self.definition, range(self.definition.num_leaves))
        return _structure_of, (tree,)


def _structure_of(tree: Any) -> Structure:
    return Structure(jax.tree.structure(tree))


def interpret(function: Callable[..., Any], *args: Any) -> Any:
    """What a function returns, by NumPy: for what is computed once, and compiled for longer.

    JAX compiles each operation of its own outside of a program.

    Args:
        function: pure.
        args: none of them static.

    Example:
        >>> float(interpret(lambda value: value / 2, 3.0))
        1.5
    """
    return Interpreter(jax.jit(function).trace(*args))(*args)


def named_program(
    function: Callable[[Any], Mapping[str, Any]], arguments: Any
) -> tuple[list[str], NumpyProgram]:
    """A function of nested arrays as a program of NumPy, and the names of what it returns.

    Args:
        function: pure; it returns an ordered dictionary of arrays.
        arguments: of the shapes and types that the program is for.

    Example:
        >>> from collections import OrderedDict
        >>> names, program = named_program(lambda x: OrderedDict(b=x, a=2 * x), np.array(3.0))
        >>> names, [float(one) for one in program(np.array(1.5))]
        (['b', 'a'], [1.5, 3.0])
    """
    is_wide = any(np.asarray(one).dtype == np.float64 for one in jax.tree.leaves(arguments))
    with jax.enable_x64(is_wide):
        traced = jax.jit(function).trace(arguments)
        return [*traced.out_info], translate(traced.jaxpr)


def translate(program: ClosedJaxpr) -> NumpyProgram:
    """A traced program as one of NumPy.

    Calls are replaced by what they call, what depends on no argument is computed here, and what
    no result depends on is left out.

    Example:
        >>> traced = jax.jit(lambda value: jnp.sqrt(value) / 2).trace(9.0)
        >>> [float(one) for one in translate(traced.jaxpr)(np.asarray(9.0))]
        [1.5]
    """
    translation = _Translation()
    given = [translation.place(None) for _ in program.jaxpr.invars]
    constants = [translation.constant(np.asarray(one)) for one in program.consts]
    with np.errstate(all="ignore"):
        found = translation.add(program.jaxpr, constants, given)
    return translation.program(given, found)


class _Translation:
    """A program of NumPy that is being made."""

    def __init__(self) -> None:
        self._first: list[Any] = []
        self._is_constant: list[bool] = []
        self._steps: list[Step] = []

    def place(self, value: Any) -> int:
        self._first.append(value)
        self._is_constant.append(False)
        return len(self._first) - 1

    def constant(self, value: Any) -> int:
        place = self.place(value)
        self._is_constant[place] = True
        return place

    def add(self, jaxpr: Jaxpr, constants: Sequence[int], given: Sequence[int]) -> list[int]:
        """Add the equations of a program, whose results' places are returned."""
        places: dict[Any, int] = dict(zip(jaxpr.constvars, constants, strict=True))
        places |= zip(jaxpr.invars, given, strict=True)

        def place(var: Any) -> int:
            if isinstance(var, Literal):
                kind: Any = var.aval
                return self.constant(np.asarray(var.val, kind.dtype))
            return places[var]

        for equation in jaxpr.eqns:
            sources = [place(var) for var in equation.invars]
            if (call := CALLS.get(equation.primitive.name)) is not None:
                inner, sources = call(equation, sources)
                fixed = [self.constant(np.asarray(one)) for one in inner.consts]
                targets = self.add(inner.jaxpr, fixed, sources)
            else:
                targets = self._add_step(equation, sources)
            places |= zip(equation.outvars, targets, strict=True)
        return [place(var) for var in jaxpr.outvars]

    def _add_step(self, equation: JaxprEqn, sources: Sequence[int]) -> list[int]:
        rule = RULES.get(equation.primitive.name)
        operation = (rule(equation) if rule is not None else None) or _ByJax(equation)
        if operation is ops.same:
            return [*sources]
        is_many = equation.primitive.multiple_results
        sizes = [getattr(var.aval, "size", 0) for var in equation.outvars]
        if all(self._is_constant[one] for one in sources) and sum(sizes) <= MOST_FOLDED:
            found = operation(*[self._first[one] for one in sources])
            return [self.constant(np.asarray(one)) for one in (found if is_many else [found])]
        targets = [self.place(None) for _ in equation.outvars]
        self._steps.append(Step(operation, tuple(sources), tuple(targets), is_many))
        return targets

    def program(self, given: Sequence[int], found: Sequence[int]) -> NumpyProgram:
        """All of it that the results depend on, its places numbered anew."""
        needed, steps = {*found}, []
        for step in reversed(self._steps):
            if needed.isdisjoint(step.targets):
                continue
            last = tuple({*step.sources} - needed) + tuple({*step.targets} - needed)
            steps.append((step, last))
            needed |= {*step.sources, *step.targets}
        kept = sorted(needed | {*given})
        number = {place: n for n, place in enumerate(kept)}

        def numbered(places: Sequence[int]) -> tuple[int, ...]:
            return tuple(number[one] for one in places)

        return NumpyProgram(
            tuple(self._first[place] for place in kept),
            numbered(given),
            tuple(
                Step(
                    step.operation,
                    numbered(step.sources),
                    numbered(step.targets),
                    step.is_many,
                    # A constant is the program's.
                    numbered([one for one in last if not self._is_constant[one]]),
                )
                for step, last in reversed(steps)
            ),
            numbered(found),
        )


class _ByJax:
    """Whatever has no rule."""

    def __init__(self, equation: JaxprEqn) -> None:
        self._primitive, self._params = equation.primitive, equation.params

    def __reduce__(self) -> tuple[Any, ...]:
        raise TypeError(f"{self._primitive} is computed by JAX: it cannot be pickled")

    def __call__(self, *args: Any) -> Any:
        given = self._primitive.get_bind_params(self._params)
        # Functions apart, in versions of JAX that do not count them among the parameters.
        functions, named = given if isinstance(given, tuple) else ((), given)
        found = self._primitive.bind(*functions, *map(jnp.asarray, args), **named)
        return jax.tree.map(np.asarray, found)


def _calling(name: str) -> Call:
    def call(equation: JaxprEqn, sources: list[int]) -> tuple[ClosedJaxpr, list[int]]:
        called = equation.params[name]
        return called if isinstance(called, ClosedJaxpr) else ClosedJaxpr(called, ()), sources

    return call


def _solving(equation: JaxprEqn, sources: list[int]) -> tuple[ClosedJaxpr, list[int]]:
    """Of four programs with fixed arguments that which solves."""
    counts, programs = equation.params["const_lengths"], equation.params["jaxprs"]
    before, fixed = counts.matvec + counts.vecmat, counts.solve
    sides = sources[before + fixed + counts.transpose_solve :]
    return programs.solve, sources[before : before + fixed] + sides


def _implemented(equation: JaxprEqn, sources: list[int]) -> tuple[ClosedJaxpr, list[int]]:
    """A primitive of Equinox or Lineax, which is a function of JAX outside of a program."""
    function = partial(equation.primitive.impl, **equation.params)
    return jax.make_jaxpr(function)(*(var.aval for var in equation.invars)), sources


CALLS: dict[str, Call] = {
    **dict.fromkeys(("jit", "remat2"), _calling("jaxpr")),
    **dict.fromkeys(("custom_jvp_call", "custom_vjp_call"), _calling("call_jaxpr")),
    "custom_linear_solve": _solving,
    **dict.fromkeys(
        ("vprim", "linear_solve", "nonbatchable", "unvmap_any", "unvmap_all", "unvmap_max"),
        _implemented,
    ),
}
"""Primitives that call a program."""


def _result_of(equation: JaxprEqn) -> Any:
    """Shape and type of what an equation gives first."""
    return equation.outvars[0].aval


def _whole(values: Any) -> tuple[int, ...]:
    return tuple(map(int, values))


def _plain(operation: Operation) -> Rule:
    """Of a primitive without parameters that count here."""
    return lambda _: operation


def _with(operation: Operation, **named: Callable[[Any], Any]) -> Rule:
    """Of a primitive whose parameters, or what is made of them, are the operation's."""
    return lambda equation: partial(
        operation, **{name: make(equation.params) for name, make in named.items()}
    )


def _by_type(of_floats: Operation, of_integers: Operation) -> Rule:
    """Of a primitive that treats integers in a way of its own."""

    def rule(equation: JaxprEqn) -> Operation:
        dtype = _result_of(equation).dtype
        return of_floats if np.issubdtype(dtype, np.inexact) else of_integers

    return rule


def _le_to(equation: JaxprEqn) -> Operation | None:
    """In total order, in which floats have an order of their own."""
    given: Any = equation.invars[0].aval
    return np.less_equal if np.issubdtype(given.dtype, np.integer) else None


RULES: dict[str, Rule] = {
    name: _plain(operation)
    for name, operation in {
        "add": np.add,
        "add_any": np.add,
        "sub": np.subtract,
        "mul": np.multiply,
        "neg": np.negative,
        "pow": ops.power,
        "square": np.square,
        "max": np.maximum,
        "min": np.minimum,
        "atan2": np.arctan2,
        "nextafter": np.nextafter,
        "and": np.bitwise_and,
        "or": np.bitwise_or,
        "xor": np.bitwise_xor,
        "not": np.invert,
        "shift_left": np.left_shift,
        "shift_right_arithmetic": np.right_shift,
        "eq": np.equal,
        "ne": np.not_equal,
        "lt": np.less,
        "le": np.less_equal,
        "gt": np.greater,
        "ge": np.greater_equal,
        "abs": np.abs,
        "sign": ops.sign,
        "floor": np.floor,
        "ceil": np.ceil,
        "is_finite": np.isfinite,
        "sqrt": np.sqrt,
        "rsqrt": ops.reciprocal_root,
        "cbrt": np.cbrt,
        "exp": np.exp,
        "expm1": np.expm1,
        "log": np.log,
        "log1p": np.log1p,
        "sin": np.sin,
        "cos": np.cos,
        "tan": np.tan,
        "asin": np.arcsin,
        "acos": np.arccos,
        "atan": np.arctan,
        "sinh": np.sinh,
        "cosh": np.cosh,
        "tanh": np.tanh,
        "clamp": ops.clamp,
        "select_n": ops.choose,
        "copy": ops.same,
        "stop_gradient": ops.same,
        "optimization_barrier": ops.same_all,
        "dynamic_update_slice": ops.set_window,
        "lu": ops.lu,
    }.items()
}
RULES |= {
    "le_to": _le_to,
    "div": _by_type(np.true_divide, ops.quotient),
    "rem": _by_type(np.fmod, ops.remainder),
    "integer_pow": lambda equation: (
        np.square
        if (power := equation.params["y"]) == 2
        else partial(ops.integer_power, exponent=power)
    ),
    # Else to the nearest even number.
    "round": lambda equation: (
        np.rint if int(equation.params["rounding_method"]) == 1 else ops.round_away
    ),
    "iota": _with(
        ops.iota,
        dtype=lambda p: np.dtype(p["dtype"]),
        shape=lambda p: p["shape"],
        dimension=lambda p: int(p["dimension"]),
    ),
    "reshape": _with(ops.reshape, shape=lambda p: p["new_sizes"]),
    "squeeze": _with(ops.squeeze, axes=lambda p: _whole(p["dimensions"])),
    "transpose": _with(ops.transpose, order=lambda p: _whole(p["permutation"])),
    "rev": _with(ops.reverse, axes=lambda p: _whole(p["dimensions"])),
    "tile": _with(ops.tile, times=lambda p: _whole(p["reps"])),
    "concatenate": _with(ops.concatenate, axis=lambda p: int(p["dimension"])),
    "stack": _with(ops.stack, axis=lambda p: int(p["axis"])),
    "unstack": _with(ops.unstack, axis=lambda p: int(p["axis"])),
    "split": _with(
        ops.split, cuts=lambda p: _whole(np.cumsum(p["sizes"])[:-1]), axis=lambda p: int(p["axis"])
    ),
    "slice": _with(
        ops.cut,
        parts=lambda p: tuple(
            map(
                slice,
                p["start_indices"],
                p["limit_indices"],
                p["strides"] or [1] * len(p["start_indices"]),
            )
        ),
    ),
    "dynamic_slice": _with(ops.window, sizes=lambda p: _whole(p["slice_sizes"])),
}


def _convert_element_type(equation: JaxprEqn) -> Operation:
    dtype = np.dtype(equation.params["new_dtype"])
    given: Any = equation.invars[0].aval
    if given.dtype == dtype:
        return ops.same
    if np.issubdtype(given.dtype, np.floating) and np.issubdtype(dtype, np.integer):
        return partial(ops.convert_to_integers, dtype=dtype)
    return partial(ops.convert, dtype=dtype)


def _broadcast_in_dim(equation: JaxprEqn) -> Operation:
    shape, kept = _whole(equation.params["shape"]), equation.params["broadcast_dimensions"]
    given: Any = equation.invars[0].aval
    between = [1] * len(shape)
    for axis, size in zip(kept, given.shape, strict=True):
        between[axis] = size
    if tuple(between) == shape:
        return partial(ops.reshape, shape=shape)
    return partial(ops.broadcast, between=tuple(between), shape=shape)


def _pad(equation: JaxprEqn) -> Operation | None:
    config = [tuple(map(int, one)) for one in equation.params["padding_config"]]
    if any(low < 0 or high < 0 for low, high, _ in config):
        return None
    shape = _result_of(equation).shape
    inner = tuple(
        slice(low, size - high, between + 1)
        for (low, high, between), size in zip(config, shape, strict=True)
    )
    return partial(ops.pad, inner=inner, shape=shape)


def _reducing(operation: Operation, least: Callable[[Any], Any] | None = None) -> Rule:
    """Over axes; ``least`` gives of a type what is returned where there is nothing to reduce."""

    def rule(equation: JaxprEqn) -> Operation:
        axes, dtype = _whole(equation.params["axes"]), _result_of(equation).dtype
        if least is not None:
            return partial(operation, axis=axes, initial=least(dtype))
        return partial(ops.reduce, function=operation, axes=axes, dtype=dtype)

    return rule


def _lowest(dtype: Any) -> Any:
    if np.issubdtype(dtype, np.bool_):
        return False
    return -np.inf if np.issubdtype(dtype, np.floating) else np.iinfo(dtype).min


def _highest(dtype: Any) -> Any:
    if np.issubdtype(dtype, np.bool_):
        return True
    return np.inf if np.issubdtype(dtype, np.floating) else np.iinfo(dtype).max


def _place_of(operation: Operation) -> Rule:
    return _with(
        ops.place_of,
        function=lambda _: operation,
        axis=lambda p: int(p["axes"][0]),
        dtype=lambda p: np.dtype(p["index_dtype"]),
    )


def _along(operation: Operation) -> Rule:
    return lambda equation: partial(
        ops.accumulate,
        function=operation,
        axis=int(equation.params["axis"]),
        dtype=_result_of(equation).dtype,
        backwards=equation.params["reverse"],
    )


def _sort(equation: JaxprEqn) -> Operation | None:
    if equation.params["num_keys"] != 1:
        return None
    return partial(ops.sort, axis=int(equation.params["dimension"]))


def _dot_general(equation: JaxprEqn) -> Operation:
    numbers, dtype = (
        equation.params[name] for name in ("dimension_numbers", "preferred_element_type")
    )
    (first_summed, second_summed), (first_batch, second_batch) = numbers
    given: Any = [var.aval for var in equation.invars]
    first, second = (one.ndim for one in given)
    of_first = list(range(first))
    of_second = [first + axis for axis in range(second)]
    for pairs in ((first_summed, second_summed), (first_batch, second_batch)):
        for axis, other in zip(*pairs, strict=True):
            of_second[other] = of_first[axis]
    batch = [of_first[axis] for axis in first_batch]
    summed = [of_first[axis] for axis in first_summed]
    free = [axis for axis in (*of_first, *of_second) if axis not in (*batch, *summed)]
    return partial(
        ops.sum_of_products,
        labels=(of_first, of_second, [*batch, *free]),
        dtype=None if dtype is None else np.dtype(dtype),
    )


def _gather(equation: JaxprEqn) -> Operation:
    params, result = equation.params, _result_of(equation)
    numbers, dtype = params["dimension_numbers"], result.dtype
    filling = None
    if params["mode"] is jax.lax.GatherScatterMode.FILL_OR_DROP:
        filling = params["fill_value"]
        if filling is None and np.issubdtype(dtype, np.unsignedinteger):
            filling = _highest(dtype)
        elif filling is None:
            filling = np.nan if np.issubdtype(dtype, np.inexact) else _lowest(dtype)
    return partial(
        ops.gather,
        shape=result.shape,
        sizes=_whole(params["slice_sizes"]),
        offsets=_whole(numbers.offset_dims),
        dropped=_whole((*numbers.collapsed_slice_dims, *numbers.operand_batching_dims)),
        batching=(
            _whole(numbers.operand_batching_dims),
            _whole(numbers.start_indices_batching_dims),
        ),
        indexed=_whole(numbers.start_index_map),
        filling=filling,
    )


SCATTERED = {"scatter": ops.set_at, "scatter-add": ops.add_at}


def _scatter(equation: JaxprEqn) -> Operation | None:
    """Places that are set; those beyond the operand are left out, as are windows in part there."""
    params = equation.params
    numbers = params["dimension_numbers"]
    if params["mode"] is jax.lax.GatherScatterMode.CLIP or numbers.update_window_dims:
        return None
    return partial(
        ops.scatter,
        dropped=_whole((*numbers.inserted_window_dims, *numbers.operand_batching_dims)),
        batching=(
            _whole(numbers.operand_batching_dims),
            _whole(numbers.scatter_indices_batching_dims),
        ),
        indexed=_whole(numbers.scatter_dims_to_operand_dims),
        combine=SCATTERED[equation.primitive.name],
    )


def _svd(equation: JaxprEqn) -> Operation | None:
    if equation.params["subset_by_index"] is not None:
        return None
    names = ("full_matrices", "compute_uv")
    return partial(ops.svd, **{name: equation.params[name] for name in names})


def _triangular_solve(equation: JaxprEqn) -> Operation | None:
    names = ("left_side", "lower", "transpose_a", "unit_diagonal")
    return partial(ops.triangular_solve, **{name: equation.params[name] for name in names})


def _scan(equation: JaxprEqn) -> Operation:
    params = equation.params
    body, carried = params["jaxpr"], params["num_carry"]
    return partial(
        ops.scan,
        body=translate(body),
        length=params["length"],
        backwards=params["reverse"],
        constants=params["num_consts"],
        carried=carried,
        results=[(var.aval.shape, var.aval.dtype) for var in body.jaxpr.outvars[carried:]],
    )


RULES |= {
    "convert_element_type": _convert_element_type,
    "broadcast_in_dim": _broadcast_in_dim,
    "pad": _pad,
    "reduce_sum": _reducing(np.sum),
    "reduce_prod": _reducing(np.prod),
    "reduce_max": _reducing(np.max, _lowest),
    "reduce_min": _reducing(np.min, _highest),
    "reduce_or": _reducing(np.bitwise_or.reduce),
    "reduce_and": _reducing(np.bitwise_and.reduce),
    "argmax": _place_of(np.argmax),
    "argmin": _place_of(np.argmin),
    "cumsum": _along(np.cumsum),
    "cumprod": _along(np.cumprod),
    "cummax": _along(np.maximum.accumulate),
    "cummin": _along(np.minimum.accumulate),
    "sort": _sort,
    "dot_general": _dot_general,
    "gather": _gather,
    **dict.fromkeys(SCATTERED, _scatter),
    "cond": _with(ops.branch, programs=lambda p: [translate(one) for one in p["branches"]]),
    "while": _with(
        ops.repeat_while,
        condition=lambda p: translate(p["cond_jaxpr"]),
        body=lambda p: translate(p["body_jaxpr"]),
        of_condition=lambda p: p["cond_nconsts"],
        of_body=lambda p: p["body_nconsts"],
    ),
    "scan": _scan,
    "svd": _svd,
    "triangular_solve": _triangular_solve,
    "lu_pivots_to_permutation": _with(ops.permutation, size=lambda p: p["permutation_size"]),
}
