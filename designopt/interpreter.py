"""Programs that JAX has traced, computed by NumPy: an answer before anything is compiled.

Tracing a program takes a fraction of the time that compiling it takes. What NumPy has no
counterpart for, JAX computes, one operation at a time.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.extend.core import ClosedJaxpr, Jaxpr, JaxprEqn, Literal

Operation = Callable[..., Any]
"""Of arrays; returns an array, or several if its primitive does."""

Integers = Sequence[Any]
"""Of JAX, or of NumPy, as a program has them."""

Rule = Callable[[JaxprEqn], Operation]
"""What computes an equation."""


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
        self._steps = _Steps(traced.jaxpr)
        self._types = [var.aval.dtype for var in traced.jaxpr.jaxpr.invars]
        self._tree = jax.tree.structure(traced.out_info)

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        """What the function returns, in NumPy arrays."""
        leaves = jax.tree.leaves((args, kwargs))
        given = [np.asarray(one, dtype) for one, dtype in zip(leaves, self._types, strict=True)]
        with np.errstate(all="ignore"):
            found = self._steps(*given)
        return jax.tree.unflatten(self._tree, [np.asarray(one) for one in found])


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


class _Steps:
    """The equations of a program in their order, between places of one list."""

    def __init__(self, program: ClosedJaxpr) -> None:
        jaxpr = program.jaxpr
        self._first: list[Any] = []
        places: dict[Any, int] = {}

        def place(var: Any, value: Any = None) -> int:
            if isinstance(var, Literal):
                kind: Any = var.aval
                self._first.append(np.asarray(var.val, kind.dtype))
                return len(self._first) - 1
            if var not in places:
                places[var] = len(self._first)
                self._first.append(value)
            return places[var]

        for var, value in zip(jaxpr.constvars, program.consts, strict=True):
            place(var, np.asarray(value))
        self._given = [place(var) for var in jaxpr.invars]
        self._steps = [
            (
                RULES.get(one.primitive.name, _by_jax)(one),
                [place(var) for var in one.invars],
                [place(var) for var in one.outvars],
                one.primitive.multiple_results,
            )
            for one in jaxpr.eqns
        ]
        self._found = [place(var) for var in jaxpr.outvars]

    def __call__(self, *given: Any) -> list[Any]:
        values = self._first.copy()
        for place, value in zip(self._given, given, strict=True):
            values[place] = value
        for operation, sources, targets, is_many in self._steps:
            found = operation(*[values[place] for place in sources])
            if not is_many:
                values[targets[0]] = found
                continue
            for place, one in zip(targets, found, strict=True):
                values[place] = one
        return [values[place] for place in self._found]


def _by_jax(equation: JaxprEqn) -> Operation:
    """Whatever has no rule."""
    primitive, params = equation.primitive, equation.params

    def operation(*args: Any) -> Any:
        given = primitive.get_bind_params(params)
        # Functions apart, in versions of JAX that do not count them among the parameters.
        functions, named = given if isinstance(given, tuple) else ((), given)
        found = primitive.bind(*functions, *map(jnp.asarray, args), **named)
        return jax.tree.map(np.asarray, found)

    return operation


def _result_of(equation: JaxprEqn) -> Any:
    """Shape and type of what an equation gives first."""
    return equation.outvars[0].aval


def _plain(operation: Operation) -> Rule:
    """Of a primitive without parameters that count here."""
    return lambda _: operation


def _given(make: Callable[..., Operation], *names: str) -> Rule:
    """What is made of some of a primitive's parameters."""
    return lambda equation: make(*(equation.params[name] for name in names))


def _of(*names: str) -> Callable[[Callable[..., Operation]], Callable[..., Operation]]:
    """Lets a function of some of a primitive's parameters be its rule; it has its name."""

    def decorated(make: Callable[..., Operation]) -> Callable[..., Operation]:
        RULES[make.__name__.strip("_")] = _given(make, *names)
        return make

    return decorated


def _same(value: Any) -> Any:
    return value


def _spread(value: Any, axes: Integers, count: int) -> Any:
    """An array's axes as some of so many; it is 1 long along the others."""
    sizes = [1] * count
    for axis, size in zip(axes, np.shape(value), strict=True):
        sizes[axis] = size
    return np.reshape(value, sizes)


def _by_type(of_floats: Operation, of_integers: Operation) -> Rule:
    """Of a primitive that treats integers in a way of its own."""

    def rule(equation: JaxprEqn) -> Operation:
        dtype = _result_of(equation).dtype
        return of_floats if np.issubdtype(dtype, np.inexact) else of_integers

    return rule


def _quotient(first: Any, second: Any) -> Any:
    """Towards zero; all bits are set where the divisor is 0."""
    found = np.asarray(first // second)
    found += (found * second != first) & ((first < 0) != (second < 0))
    return np.where(second == 0, np.full_like(found, 0) - found.dtype.type(1), found)


def _remainder(first: Any, second: Any) -> Any:
    return np.where(second == 0, first, np.fmod(first, second))


def _chosen(which: Any, *cases: Any) -> Any:
    if len(cases) == 2:
        return np.where(np.asarray(which, bool), cases[1], cases[0])
    return np.choose(which, cases, mode="clip")


RULES: dict[str, Rule] = {
    name: _plain(operation)
    for name, operation in {
        "add": operator.add,
        "add_any": operator.add,
        "sub": operator.sub,
        "mul": operator.mul,
        "neg": operator.neg,
        "pow": lambda base, power: np.power(base, power).astype(base.dtype),
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
        "sign": lambda value: np.where(value == 0, value, np.sign(value)),
        "floor": np.floor,
        "ceil": np.ceil,
        "is_finite": np.isfinite,
        "sqrt": np.sqrt,
        "rsqrt": lambda value: 1 / np.sqrt(value),
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
        "clamp": lambda low, value, high: np.minimum(np.maximum(value, low), high),
        "select_n": _chosen,
        "copy": _same,
        "stop_gradient": _same,
        "optimization_barrier": lambda *values: values,
    }.items()
}


RULES |= {"div": _by_type(operator.truediv, _quotient), "rem": _by_type(np.fmod, _remainder)}


@_of("y")
def _integer_pow(power: int) -> Operation:
    return np.square if power == 2 else lambda value: value ** np.asarray(power, value.dtype)


@_of("rounding_method")
def _round(method: Any) -> Operation:
    if int(method) == 1:  # to the nearest even number
        return np.rint

    def away(value: Any) -> Any:
        # A half is added to what is cut off, for to numbers just below a half it gives 1.
        whole = np.trunc(value)
        return whole + np.where(np.abs(value - whole) >= 0.5, np.sign(value), 0.0)

    return away


def _convert_element_type(equation: JaxprEqn) -> Operation:
    dtype = equation.params["new_dtype"]
    given: Any = equation.invars[0].aval
    if not (np.issubdtype(given.dtype, np.floating) and np.issubdtype(dtype, np.integer)):
        return lambda value: np.asarray(value).astype(dtype)
    low, high = np.iinfo(dtype).min, np.iinfo(dtype).max

    def whole(value: Any) -> Any:
        # What does not fit becomes the nearest that does, and what is no number 0.
        fits = (value > float(low)) & (value < float(high))
        found = np.where(fits, value, 0.0).astype(dtype)
        return np.where(value >= float(high), high, np.where(value <= float(low), low, found))

    return whole


RULES["convert_element_type"] = _convert_element_type


@_of("shape", "broadcast_dimensions")
def _broadcast_in_dim(shape: Integers, kept: Integers) -> Operation:
    return lambda value: np.broadcast_to(_spread(value, kept, len(shape)), shape)


@_of("dtype", "shape", "dimension")
def _iota(dtype: Any, shape: Integers, dimension: int) -> Operation:
    sizes = [size if axis == dimension else 1 for axis, size in enumerate(shape)]
    values = np.broadcast_to(np.arange(shape[dimension], dtype=dtype).reshape(sizes), shape)
    return lambda: values


RULES |= {
    "reshape": _given(lambda shape: lambda one: np.reshape(one, shape), "new_sizes"),
    "squeeze": _given(lambda axes: lambda one: np.squeeze(one, tuple(axes)), "dimensions"),
    "transpose": _given(lambda order: lambda one: np.transpose(one, order), "permutation"),
    "rev": _given(lambda axes: lambda one: np.flip(one, tuple(axes)), "dimensions"),
    "tile": _given(lambda times: lambda one: np.tile(one, times), "reps"),
    "concatenate": _given(lambda axis: lambda *every: np.concatenate(every, axis), "dimension"),
    "stack": _given(lambda axis: lambda *every: np.stack(every, axis), "axis"),
    "unstack": _given(lambda axis: lambda one: [*np.moveaxis(one, axis, 0)], "axis"),
    "split": _given(
        lambda sizes, axis: lambda one: np.split(one, np.cumsum(sizes)[:-1], axis), "sizes", "axis"
    ),
}


@_of("start_indices", "limit_indices", "strides")
def _slice(starts: Integers, limits: Integers, strides: Integers | None) -> Operation:
    cut = tuple(map(slice, starts, limits, strides or [1] * len(starts)))
    return lambda value: value[cut]


def _window(value: Any, sizes: Integers, starts: Sequence[Any]) -> tuple[slice, ...]:
    """Where a window is, moved to where all of it is inside."""
    room = zip(starts, sizes, value.shape, strict=True)
    first = [int(np.clip(start, 0, whole - size)) for start, size, whole in room]
    return tuple(slice(a, a + size) for a, size in zip(first, sizes, strict=True))


@_of("slice_sizes")
def _dynamic_slice(sizes: Integers) -> Operation:
    return lambda value, *starts: value[_window(value, sizes, starts)]


def _dynamic_update_slice(value: Any, new: Any, *starts: Any) -> Any:
    changed = np.array(value)
    changed[_window(value, new.shape, starts)] = new
    return changed


RULES["dynamic_update_slice"] = _plain(_dynamic_update_slice)


def _pad(equation: JaxprEqn) -> Operation:
    config = [tuple(map(int, one)) for one in equation.params["padding_config"]]
    if any(low < 0 or high < 0 for low, high, _ in config):
        return _by_jax(equation)
    shape = _result_of(equation).shape
    inner = tuple(
        slice(low, size - high, between + 1)
        for (low, high, between), size in zip(config, shape, strict=True)
    )

    def operation(value: Any, filling: Any) -> Any:
        padded = np.full(shape, filling)
        padded[inner] = value
        return padded

    return operation


RULES["pad"] = _pad


def _reducing(operation: Operation, least: Callable[[Any], Any] | None = None) -> Rule:
    """Over axes; ``least`` gives of a type what is returned where there is nothing to reduce."""

    def rule(equation: JaxprEqn) -> Operation:
        axes, dtype = tuple(map(int, equation.params["axes"])), _result_of(equation).dtype
        if least is not None:
            return partial(operation, axis=axes, initial=least(dtype))
        return lambda value: operation(value, axis=axes).astype(dtype)

    return rule


def _lowest(dtype: Any) -> Any:
    if np.issubdtype(dtype, np.bool_):
        return False
    return -np.inf if np.issubdtype(dtype, np.floating) else np.iinfo(dtype).min


def _highest(dtype: Any) -> Any:
    if np.issubdtype(dtype, np.bool_):
        return True
    return np.inf if np.issubdtype(dtype, np.floating) else np.iinfo(dtype).max


RULES |= {
    "reduce_sum": _reducing(np.sum),
    "reduce_prod": _reducing(np.prod),
    "reduce_max": _reducing(np.max, _lowest),
    "reduce_min": _reducing(np.min, _highest),
    "reduce_or": _reducing(np.bitwise_or.reduce),
    "reduce_and": _reducing(np.bitwise_and.reduce),
}


def _place_of(operation: Operation) -> Rule:
    """Where along an axis something is."""
    return _given(
        lambda axes, dtype: lambda value: operation(value, int(axes[0])).astype(dtype),
        "axes",
        "index_dtype",
    )


RULES |= {"argmax": _place_of(np.argmax), "argmin": _place_of(np.argmin)}


def _along(operation: Operation) -> Rule:
    def rule(equation: JaxprEqn) -> Operation:
        axis, dtype = equation.params["axis"], _result_of(equation).dtype
        if equation.params["reverse"]:
            return lambda value: np.flip(operation(np.flip(value, axis), axis, dtype=dtype), axis)
        return lambda value: operation(value, axis, dtype=dtype)

    return rule


RULES |= {
    "cumsum": _along(np.cumsum),
    "cumprod": _along(np.cumprod),
    "cummax": _along(np.maximum.accumulate),
    "cummin": _along(np.minimum.accumulate),
}


def _sort(equation: JaxprEqn) -> Operation:
    if equation.params["num_keys"] != 1:
        return _by_jax(equation)
    axis = equation.params["dimension"]

    def operation(*values: Any) -> Any:
        order = np.argsort(values[0], axis, kind="stable")
        return [np.take_along_axis(one, order, axis) for one in values]

    return operation


RULES["sort"] = _sort


@_of("dimension_numbers", "preferred_element_type")
def _dot_general(dimensions: Any, dtype: Any) -> Operation:
    (first_summed, second_summed), (first_batch, second_batch) = dimensions

    def operation(first: Any, second: Any) -> Any:
        of_first = list(range(first.ndim))
        of_second = [first.ndim + axis for axis in range(second.ndim)]
        for pairs in ((first_summed, second_summed), (first_batch, second_batch)):
            for axis, other in zip(*pairs, strict=True):
                of_second[other] = of_first[axis]
        batch = [of_first[axis] for axis in first_batch]
        summed = [of_first[axis] for axis in first_summed]
        free = [axis for axis in (*of_first, *of_second) if axis not in (*batch, *summed)]
        found = np.einsum(first, of_first, second, of_second, [*batch, *free])
        return found if dtype is None else found.astype(dtype)

    return operation


def _indexed(
    start: Any,
    shape: Integers,
    windows: Integers,
    of_operand: Mapping[Any, int],
    kept: Sequence[bool],
    batching: tuple[Integers, Integers],
) -> list[Any]:
    """Where every element of a gather's result, or of a scatter's updates, is in the operand.

    Args:
        start: indices where windows begin, the last axis one for each indexed axis.
        shape: of the result or the updates.
        windows: axes of ``shape`` within a window; the others are those of ``start``.
        of_operand: which axis of ``start`` indexes an axis of the operand.
        kept: of the operand's axes, which ``windows`` has.
        batching: axes of the operand that go with axes of ``start``, and these.

    Returns:
        For every axis of the operand its indices, not limited to what there is.
    """
    outer = [axis for axis in range(len(shape)) if axis not in windows]
    within = iter(windows)
    grid = [
        np.arange(size).reshape([-1 if other == axis else 1 for other in range(len(shape))])
        for axis, size in enumerate(shape)
    ]
    found = []
    for axis, is_kept in enumerate(kept):
        if axis in batching[0]:
            found.append(grid[outer[batching[1][batching[0].index(axis)]]])
            continue
        index: Any = 0
        if axis in of_operand:
            index = _spread(start[..., of_operand[axis]], outer, len(shape))
        if is_kept:
            index = index + grid[next(within)]
        found.append(index)
    return found


def _gather(equation: JaxprEqn) -> Operation:
    params, shape = equation.params, _result_of(equation).shape
    numbers, sizes = params["dimension_numbers"], params["slice_sizes"]
    dropped = (*numbers.collapsed_slice_dims, *numbers.operand_batching_dims)
    kept = [axis not in dropped for axis in range(len(sizes))]
    fills = params["mode"] is jax.lax.GatherScatterMode.FILL_OR_DROP
    filling = params["fill_value"]
    if fills and filling is None:
        dtype = _result_of(equation).dtype
        filling = np.nan if np.issubdtype(dtype, np.inexact) else _lowest(dtype)
        if np.issubdtype(dtype, np.unsignedinteger):
            filling = _highest(dtype)
    batching = numbers.operand_batching_dims, numbers.start_indices_batching_dims
    of_operand = {axis: n for n, axis in enumerate(numbers.start_index_map)}

    def operation(operand: Any, start: Any) -> Any:
        most = np.array([operand.shape[axis] - sizes[axis] for axis in numbers.start_index_map])
        inside = np.clip(start, 0, most)
        places = _indexed(inside, shape, numbers.offset_dims, of_operand, kept, batching)
        found = operand[tuple(places)] if places else operand
        found = np.broadcast_to(found, shape)
        if not fills:
            return found
        there = np.all(inside == start, axis=-1)
        outer = [axis for axis in range(len(shape)) if axis not in numbers.offset_dims]
        inside = _spread(there, outer, len(shape))
        return np.where(inside, found, np.asarray(filling, operand.dtype))

    return operation


RULES["gather"] = _gather


def _scatter(equation: JaxprEqn) -> Operation:
    """Places that are set; those beyond the operand are left out, as are windows in part there."""
    params = equation.params
    numbers = params["dimension_numbers"]
    if params["mode"] is jax.lax.GatherScatterMode.CLIP or numbers.update_window_dims:
        return _by_jax(equation)
    dropped = (*numbers.inserted_window_dims, *numbers.operand_batching_dims)
    batching = numbers.operand_batching_dims, numbers.scatter_indices_batching_dims
    of_operand = {axis: n for n, axis in enumerate(numbers.scatter_dims_to_operand_dims)}
    combine = SCATTERED[equation.primitive.name]

    def operation(operand: Any, start: Any, updates: Any) -> Any:
        kept = [axis not in dropped for axis in range(operand.ndim)]
        places = _indexed(start, updates.shape, (), of_operand, kept, batching)
        places = np.broadcast_arrays(*places, updates)[:-1]
        there = np.ones(updates.shape, bool)
        for index, size in zip(places, operand.shape, strict=True):
            there &= (index >= 0) & (index < size)
        changed = np.array(operand)
        combine(changed, tuple(index[there] for index in places), updates[there])
        return changed

    return operation


SCATTERED: dict[str, Callable[[Any, Any, Any], None]] = {
    "scatter": operator.setitem,
    "scatter-add": np.add.at,
}
RULES |= dict.fromkeys(SCATTERED, _scatter)


def _called(name: str) -> Rule:
    """A primitive that calls a program."""

    def rule(equation: JaxprEqn) -> Operation:
        return _Steps(_closed(equation.params[name]))

    return rule


def _closed(program: ClosedJaxpr | Jaxpr) -> ClosedJaxpr:
    return program if isinstance(program, ClosedJaxpr) else ClosedJaxpr(program, ())


RULES |= dict.fromkeys(("jit", "remat2"), _called("jaxpr"))
RULES |= dict.fromkeys(("custom_jvp_call", "custom_vjp_call"), _called("call_jaxpr"))


@_of("branches")
def _cond(branches: Sequence[ClosedJaxpr]) -> Operation:
    programs = [_Steps(one) for one in branches]

    def operation(which: Any, *args: Any) -> Any:
        return programs[int(np.clip(which, 0, len(programs) - 1))](*args)

    return operation


@_of("cond_jaxpr", "body_jaxpr", "cond_nconsts", "body_nconsts")
def _while(condition: ClosedJaxpr, body: ClosedJaxpr, of_condition: int, of_body: int) -> Operation:
    goes_on, step = _Steps(condition), _Steps(body)

    def operation(*args: Any) -> Any:
        first, second = args[:of_condition], args[of_condition : of_condition + of_body]
        state = list(args[of_condition + of_body :])
        while np.any(going := goes_on(*first, *state)[0]):
            new = step(*second, *state)
            # Of a batch each element stays as it is from when it has ended.
            state = new if np.ndim(going) == 0 else list(map(partial(_kept, going), new, state))
        return state

    return operation


def _kept(going: Any, new: Any, old: Any) -> Any:
    return np.where(going.reshape(going.shape + (1,) * (np.ndim(new) - going.ndim)), new, old)


@_of("jaxpr", "length", "reverse", "num_consts", "num_carry")
def _scan(body: ClosedJaxpr, length: int, reverse: bool, constants: int, carried: int) -> Operation:
    step = _Steps(body)
    results = [var.aval for var in body.jaxpr.outvars[carried:]]

    def operation(*args: Any) -> Any:
        fixed, state = args[:constants], list(args[constants : constants + carried])
        rows = args[constants + carried :]
        found = [np.empty((length, *aval.shape), aval.dtype) for aval in results]
        for at in reversed(range(length)) if reverse else range(length):
            new = step(*fixed, *state, *(row[at] for row in rows))
            state = new[:carried]
            for one, value in zip(found, new[carried:], strict=True):
                one[at] = value
        return [*state, *found]

    return operation
