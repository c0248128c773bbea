"""Programs of NumPy: steps between places of one list, which run without JAX and can be kept.

Every step's operation can be pickled: a function of NumPy, or one of this module with what a
program fixes of it. What they compute is what the operations of JAX's `lax` of the same names do.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

Operation = Callable[..., Any]
"""Of arrays; returns an array, or several."""

Integers = Sequence[Any]


@dataclass(frozen=True)
class Step:
    """One operation of a program.

    Attributes:
        operation: what is computed.
        sources: places of its arguments.
        targets: places of its results.
        is_many: whether it returns several.
        last_used: places that no later step and no result needs.
    """

    operation: Operation
    sources: tuple[int, ...]
    targets: tuple[int, ...]
    is_many: bool
    last_used: tuple[int, ...] = ()


@dataclass(frozen=True)
class NumpyProgram:
    """Operations in their order.

    Attributes:
        first: what every place holds at the start: a constant, or nothing.
        given: places of the arguments.
        steps: the operations.
        found: places of the results.
    """

    first: tuple[Any, ...]
    given: tuple[int, ...]
    steps: tuple[Step, ...]
    found: tuple[int, ...]

    def __call__(self, *arguments: Any) -> list[Any]:
        """The results; arguments have the types that the program was made for."""
        values = list(self.first)
        for place, value in zip(self.given, arguments, strict=True):
            values[place] = value
        for step in self.steps:
            found = step.operation(*[values[place] for place in step.sources])
            if step.is_many:
                for place, one in zip(step.targets, found, strict=True):
                    values[place] = one
            else:
                values[step.targets[0]] = found
            for place in step.last_used:  # what fits into the cache is not written to memory
                values[place] = None
        return [values[place] for place in self.found]


def same(value: Any) -> Any:
    """The argument."""
    return value


def same_all(*values: Any) -> tuple[Any, ...]:
    """The arguments."""
    return values


def spread(value: Any, axes: Integers, count: int) -> Any:
    """An array's axes as some of so many; it is 1 long along the others."""
    sizes = [1] * count
    for axis, size in zip(axes, np.shape(value), strict=True):
        sizes[axis] = size
    return np.reshape(value, sizes)


def quotient(first: Any, second: Any) -> Any:
    """Of integers, towards zero; all bits are set where the divisor is 0."""
    found = np.asarray(first // second)
    found += (found * second != first) & ((first < 0) != (second < 0))
    return np.where(second == 0, np.full_like(found, 0) - found.dtype.type(1), found)


def remainder(first: Any, second: Any) -> Any:
    """Of integers."""
    return np.where(second == 0, first, np.fmod(first, second))


def choose(which: Any, *cases: Any) -> Any:
    """One of several cases, by number or truth; beyond the last number the last."""
    if len(cases) == 2:
        return np.where(which if which.dtype == bool else which != 0, cases[1], cases[0])
    return np.choose(which, cases, mode="clip")


def power(base: Any, exponent: Any) -> Any:
    """In the type of the base."""
    return np.power(base, exponent).astype(base.dtype)


def integer_power(value: Any, *, exponent: int) -> Any:
    """With a fixed exponent."""
    return value ** np.asarray(exponent, value.dtype)


def sign(value: Any) -> Any:
    """With that of zero, and NaN."""
    return np.where(value == 0, value, np.sign(value))


def reciprocal_root(value: Any) -> Any:
    """1 / √value."""
    return 1 / np.sqrt(value)


def clamp(low: Any, value: Any, high: Any) -> Any:
    """Between limits."""
    return np.minimum(np.maximum(value, low), high)


def round_away(value: Any) -> Any:
    """To the nearest integer, a half away from zero."""
    # A half is added to what is cut off, for to numbers just below a half it gives 1.
    whole = np.trunc(value)
    return whole + np.where(np.abs(value - whole) >= 0.5, np.sign(value), 0.0)


def convert(value: Any, *, dtype: Any) -> Any:
    """To another type."""
    return np.asarray(value).astype(dtype)


def convert_to_integers(value: Any, *, dtype: Any) -> Any:
    """What does not fit becomes the nearest that does, and what is no number 0."""
    low, high = np.iinfo(dtype).min, np.iinfo(dtype).max
    fits = (value > float(low)) & (value < float(high))
    found = np.where(fits, value, 0.0).astype(dtype)
    return np.where(value >= float(high), high, np.where(value <= float(low), low, found))


def broadcast(value: Any, *, between: Integers, shape: Integers) -> Any:
    """To a shape, by way of one with as many axes, each of which is 1 long or as it was."""
    return np.broadcast_to(np.reshape(value, between), shape)


def iota(*, dtype: Any, shape: Integers, dimension: int) -> Any:
    """Numbers that count along an axis."""
    sizes = [size if axis == dimension else 1 for axis, size in enumerate(shape)]
    return np.broadcast_to(np.arange(shape[dimension], dtype=dtype).reshape(sizes), shape)


def reshape(value: Any, *, shape: Integers) -> Any:
    """As `numpy.reshape`."""
    return np.reshape(value, shape)


def squeeze(value: Any, *, axes: Integers) -> Any:
    """As `numpy.squeeze`."""
    return np.squeeze(value, axes)


def transpose(value: Any, *, order: Integers) -> Any:
    """As `numpy.transpose`."""
    return np.transpose(value, order)


def reverse(value: Any, *, axes: tuple[int, ...]) -> Any:
    """As `numpy.flip`."""
    return np.flip(value, axes)


def tile(value: Any, *, times: Integers) -> Any:
    """As `numpy.tile`."""
    return np.tile(value, times)


def concatenate(*values: Any, axis: int) -> Any:
    """As `numpy.concatenate`."""
    return np.concatenate(values, axis)


def stack(*values: Any, axis: int) -> Any:
    """As `numpy.stack`."""
    return np.stack(values, axis)


def unstack(value: Any, *, axis: int) -> list[Any]:
    """The parts of an array along an axis."""
    return [*np.moveaxis(value, axis, 0)]


def split(value: Any, *, cuts: Integers, axis: int) -> Any:
    """As `numpy.split`."""
    return np.split(value, cuts, axis)


def cut(value: Any, *, parts: tuple[slice, ...]) -> Any:
    """A fixed part of an array."""
    return value[parts]


def _window(value: Any, sizes: Integers, starts: Sequence[Any]) -> tuple[slice, ...]:
    """Where a window is, moved to where all of it is inside."""
    room = zip(starts, sizes, value.shape, strict=True)
    first = [int(np.clip(start, 0, whole - size)) for start, size, whole in room]
    return tuple(slice(a, a + size) for a, size in zip(first, sizes, strict=True))


def window(value: Any, *starts: Any, sizes: Integers) -> Any:
    """A part of fixed size, moved to where all of it is inside."""
    return value[_window(value, sizes, starts)]


def set_window(value: Any, new: Any, *starts: Any) -> Any:
    """An array with a part replaced, which is moved to where all of it is inside."""
    changed = np.array(value)
    changed[_window(value, new.shape, starts)] = new
    return changed


def pad(value: Any, filling: Any, *, inner: tuple[slice, ...], shape: Integers) -> Any:
    """An array within another of one value."""
    padded = np.full(shape, filling)
    padded[inner] = value
    return padded


def reduce(value: Any, *, function: Operation, axes: tuple[int, ...], dtype: Any) -> Any:
    """Over axes, in a type."""
    return function(value, axis=axes).astype(dtype)


def place_of(value: Any, *, function: Operation, axis: int, dtype: Any) -> Any:
    """Where along an axis something is."""
    return function(value, axis).astype(dtype)


def accumulate(value: Any, *, function: Operation, axis: int, dtype: Any, backwards: bool) -> Any:
    """Along an axis, from either end."""
    if backwards:
        return np.flip(function(np.flip(value, axis), axis, dtype=dtype), axis)
    return function(value, axis, dtype=dtype)


def sort(*values: Any, axis: int) -> list[Any]:
    """Arrays in the order of the first."""
    order = np.argsort(values[0], axis, kind="stable")
    return [np.take_along_axis(one, order, axis) for one in values]


def sum_of_products(
    first: Any,
    second: Any,
    *,
    labels: tuple[Sequence[int], Sequence[int], Sequence[int]],
    dtype: Any,
) -> Any:
    """By Einstein's convention; labels of the axes of both and of the result."""
    found = np.einsum(first, labels[0], second, labels[1], labels[2])
    return found if dtype is None else found.astype(dtype)


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
            index = spread(start[..., of_operand[axis]], outer, len(shape))
        if is_kept:
            index = index + grid[next(within)]
        found.append(index)
    return found


def gather(
    operand: Any,
    start: Any,
    *,
    shape: Integers,
    sizes: Integers,
    offsets: Integers,
    dropped: Integers,
    batching: tuple[Integers, Integers],
    indexed: Integers,
    filling: Any,
) -> Any:
    """Windows of an array.

    Args:
        operand: the array.
        start: indices where they begin; kept where the whole window is inside.
        shape: of the result.
        sizes: of a window.
        offsets: axes of the result that are a window's.
        dropped: axes of the operand that are none of the result's.
        batching: axes of the operand that go with axes of ``start``, and these.
        indexed: axes of the operand that ``start`` indexes.
        filling: what takes the place of windows that are not inside; ``None`` if they are moved.
    """
    kept = [axis not in dropped for axis in range(len(sizes))]
    most = np.array([operand.shape[axis] - sizes[axis] for axis in indexed])
    inside = np.clip(start, 0, most)
    of_operand = {axis: n for n, axis in enumerate(indexed)}
    places = _indexed(inside, shape, offsets, of_operand, kept, batching)
    found = np.broadcast_to(operand[tuple(places)] if places else operand, shape)
    if filling is None:
        return found
    there = np.all(inside == start, axis=-1)
    outer = [axis for axis in range(len(shape)) if axis not in offsets]
    is_inside = spread(there, outer, len(shape))
    return np.where(is_inside, found, np.asarray(filling, operand.dtype))


def scatter(
    operand: Any,
    start: Any,
    updates: Any,
    *,
    dropped: Integers,
    batching: tuple[Integers, Integers],
    indexed: Integers,
    combine: Callable[[Any, Any, Any], None],
) -> Any:
    """Set, or change, single places of an array; those beyond it are left out."""
    kept = [axis not in dropped for axis in range(operand.ndim)]
    of_operand = {axis: n for n, axis in enumerate(indexed)}
    places = _indexed(start, updates.shape, (), of_operand, kept, batching)
    places = np.broadcast_arrays(*places, updates)[:-1]
    there = np.ones(updates.shape, bool)
    for index, size in zip(places, operand.shape, strict=True):
        there &= (index >= 0) & (index < size)
    changed = np.array(operand)
    combine(changed, tuple(index[there] for index in places), updates[there])
    return changed


def add_at(array: Any, places: Any, updates: Any) -> None:
    """Add to places of an array, to one as often as it is named."""
    np.add.at(array, places, updates)


set_at = operator.setitem


def lu(matrix: Any) -> tuple[Any, Any, Any]:
    """Of matrices: L and U in one, the rows that were exchanged, and the order of rows.

    Source: G. H. Golub, C. F. Van Loan, *Matrix Computations*, 4th ed., §3.4 (partial pivoting).
    """
    *batch, rows, columns = matrix.shape
    found = np.array(matrix).reshape(-1, rows, columns)
    every, count = np.arange(len(found)), min(rows, columns)
    pivots = np.empty((len(found), count), np.int32)
    for k in range(count):
        pivots[:, k] = best = k + np.argmax(np.abs(found[:, k:, k]), axis=1)
        found[every, best], found[:, k] = found[:, k].copy(), found[every, best].copy()
        pivot = found[:, k, k, None]
        found[:, k + 1 :, k] /= np.where(pivot == 0, 1, pivot)  # then all below are 0
        found[:, k + 1 :, k + 1 :] -= found[:, k + 1 :, k, None] * found[:, k, None, k + 1 :]
    pivots = pivots.reshape(*batch, count)
    return found.reshape(matrix.shape), pivots, permutation(pivots, size=rows)


def permutation(pivots: Any, *, size: int) -> Any:
    """The order of rows after exchanges, one after the other."""
    *batch, count = pivots.shape
    exchanged = pivots.reshape(-1, count)
    order = np.tile(np.arange(size, dtype=np.int32), (len(exchanged), 1))
    every = np.arange(len(exchanged))
    for k in range(count):
        other = exchanged[:, k]
        order[every, other], order[:, k] = order[:, k].copy(), order[every, other].copy()
    return order.reshape(*batch, size)


def triangular_solve(
    matrix: Any,
    sides: Any,
    *,
    left_side: bool,
    lower: bool,
    transpose_a: bool,
    unit_diagonal: bool,
) -> Any:
    """X of A X = B, or of X A = B if the matrix is not at the left side, by substitution."""
    if not left_side:
        sides = np.swapaxes(sides, -1, -2)
    if transpose_a == left_side:
        matrix, lower = np.swapaxes(matrix, -1, -2), not lower
    size = matrix.shape[-1]
    found = np.array(sides)
    for row in range(size) if lower else reversed(range(size)):
        known = slice(0, row) if lower else slice(row + 1, size)
        rest = matrix[..., row, known, None] * found[..., known, :]
        found[..., row, :] -= np.sum(rest, axis=-2)
        if not unit_diagonal:
            found[..., row, :] /= matrix[..., row, row, None]
    return found if left_side else np.swapaxes(found, -1, -2)


def svd(matrix: Any, *, full_matrices: bool, compute_uv: bool) -> tuple[Any, ...]:
    """Singular values of matrices, and the vectors where they are wanted; NaN of what is NaN."""
    finite = np.all(np.isfinite(matrix), axis=(-2, -1))[..., None, None]
    filled = np.where(finite, matrix, 0.0)
    if not compute_uv:
        values = np.linalg.svd(filled, full_matrices, compute_uv=False)
        return (np.where(finite[..., 0], values, np.nan),)
    first, values, second = np.linalg.svd(filled, full_matrices)
    return (
        np.where(finite[..., 0], values, np.nan),
        np.where(finite, first, np.nan),
        np.where(finite, second, np.nan),
    )


def branch(which: Any, *arguments: Any, programs: Sequence[NumpyProgram]) -> list[Any]:
    """What one of several programs returns; beyond the last number the last."""
    return programs[int(np.clip(which, 0, len(programs) - 1))](*arguments)


def repeat_while(
    *arguments: Any,
    condition: NumpyProgram,
    body: NumpyProgram,
    of_condition: int,
    of_body: int,
) -> list[Any]:
    """As `jax.lax.while_loop`; so many of the arguments are fixed for the condition and body."""
    first, second = arguments[:of_condition], arguments[of_condition : of_condition + of_body]
    state = list(arguments[of_condition + of_body :])
    while np.any(going := condition(*first, *state)[0]):
        new = body(*second, *state)
        # Of a batch each element stays as it is from when it has ended.
        state = new if np.ndim(going) == 0 else list(map(partial(_advance, going), new, state))
    return state


def _advance(going: Any, new: Any, old: Any) -> Any:
    return np.where(going.reshape(going.shape + (1,) * (np.ndim(new) - going.ndim)), new, old)


def scan(
    *arguments: Any,
    body: NumpyProgram,
    length: int,
    backwards: bool,
    constants: int,
    carried: int,
    results: Sequence[tuple[tuple[int, ...], Any]],
) -> list[Any]:
    """As `jax.lax.scan`; of each row of the results there are shape and type."""
    fixed, state = arguments[:constants], list(arguments[constants : constants + carried])
    rows = arguments[constants + carried :]
    found = [np.empty((length, *shape), dtype) for shape, dtype in results]
    for at in reversed(range(length)) if backwards else range(length):
        new = body(*fixed, *state, *(row[at] for row in rows))
        state = new[:carried]
        for one, value in zip(found, new[carried:], strict=True):
            one[at] = value
    return [*state, *found]
