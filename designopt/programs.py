"""Functions that a person waits for: compiled quickly, and answered by NumPy until that is done."""

from __future__ import annotations

import functools
import math
import re
from collections.abc import Callable, Hashable, Iterator, Sequence
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass, field
from typing import Any
from weakref import WeakSet

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jax.experimental import serialize_executable

from designopt.batching import side_by_side
from designopt.compilation_cache import compiling_anew, current_store, forget_with_programs
from designopt.interpreter import Interpreter, Structure
from designopt.kept import PACKAGES, find_value, keep_value, kept_value, processor

QUICK = {"xla_cpu_use_fusion_emitters": False, "xla_cpu_experimental_ynn_fusion_type": ""}
"""Options of XLA, as `jax.jit` takes them: less than half the time, for programs as fast.

The second keeps reductions within XLA: the library it would call has to have what it reduces in
memory.
"""

LEAST_PACKED, MOST_PACKED = 12, 2**17
"""So many results, of no more numbers together, become one of each type: JAX takes longer over a
result than over a thousand numbers. XLA may compute anew for each number of one what it would
compute once for several, so that of few they stay apart."""


class Program:
    """A function as `jax.jit` compiles it, with `QUICK`; nothing happens before its first call.

    It returns NumPy arrays, but where JAX traces it. While a `Prompt` answers, NumPy computes it
    until it is compiled.

    Example:
        >>> double = Program(lambda value: 2 * value)
        >>> float(double(1.5))
        3.0
    """

    def __init__(self, function: Callable[..., Any], static_argnames: Sequence[str] = ()) -> None:
        """The program.

        Args:
            function: pure.
            static_argnames: as of `jax.jit`; such arguments are given by their names.
        """
        functools.update_wrapper(self, function)
        self._function, self.static = function, tuple(static_argnames)

    @functools.cached_property
    def compiled(self) -> Any:
        """What `jax.jit` makes of it; its results are packed."""

        def packed(*args: Any, **kwargs: Any) -> _Packed:
            return _Packed.of(self._function(*args, **kwargs))

        return QuickJit(packed, self.static, name=self.name and f"packed {self.name}")

    @property
    def name(self) -> str:
        """By which it is kept between commands; empty if the function is local to another one."""
        return _name_of(self._function)

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        """What the function returns."""
        if any(isinstance(one, Tracer) for one in jax.tree.leaves((args, kwargs))):
            return self._function(*args, **kwargs)
        prompt = _ANSWERING.get()
        return self.run(*args, **kwargs) if prompt is None else prompt.answer(self, args, kwargs)

    def run(self, *args: Any, **kwargs: Any) -> Any:
        """What it returns once it is compiled, which it is if need be."""
        return self.compiled(*args, **kwargs).unpacked()

    def when_compiled(self, *args: Any, **kwargs: Any) -> Any:
        """The same; ``None`` where it is not compiled yet while a `Prompt` answers."""
        prompt = _ANSWERING.get()
        if prompt is not None and not prompt.has_compiled(self, args, kwargs):
            return None
        return self.run(*args, **kwargs)

    def expect(self, *args: Any, **kwargs: Any) -> None:
        """Let a `Prompt` compile it for arguments like these, which are soon to come."""
        if (prompt := _ANSWERING.get()) is not None:
            prompt.has_compiled(self, args, kwargs)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class _Packed:
    """Arrays side by side in one of each type.

    Attributes:
        arrays: one-dimensional, by their types; apart where they are few, or large.
        tree: what is made of all of them.
        parts: of each its type, where it begins and its shape.
    """

    arrays: dict[str, Any]
    tree: Structure = field(metadata={"static": True})
    parts: tuple[tuple[str, int, tuple[int, ...]], ...] = field(metadata={"static": True})

    @classmethod
    def of(cls, result: Any) -> _Packed:
        leaves, tree = jax.tree.flatten(result)
        leaves = [jnp.asarray(leaf) for leaf in leaves]
        is_small = sum(leaf.size for leaf in leaves) <= MOST_PACKED
        is_packed = is_small and len(leaves) >= LEAST_PACKED
        arrays, parts = dict[str, list[Any]](), []
        for number, leaf in enumerate(leaves):
            name = str(leaf.dtype) if is_packed else str(number)
            before = arrays.setdefault(name, [])
            parts.append((name, sum(one.size for one in before), leaf.shape))
            before.append(leaf.reshape(-1))
        whole = {name: jnp.concatenate(several) for name, several in arrays.items()}
        return cls(whole, Structure(tree), tuple(parts))

    def unpacked(self) -> Any:
        arrays = {name: np.asarray(array) for name, array in self.arrays.items()}
        leaves = [
            arrays[name][start : start + math.prod(shape)].reshape(shape)
            for name, start, shape in self.parts
        ]
        return jax.tree.unflatten(self.tree.definition, leaves)


@functools.cache
def known_options() -> dict[str, Any]:
    """Those of `QUICK` that this version of XLA has.

    And nothing where JAX compiles without most optimisations: with both, slopes are wrong.
    """
    if jax.config.values["jax_disable_most_optimizations"]:
        return {}

    def is_known(name: str) -> bool:
        try:
            jax.jit(jnp.negative, compiler_options={name: QUICK[name]})(0.0)
        except jax.errors.JaxRuntimeError:
            return False
        return True

    return {name: value for name, value in QUICK.items() if is_known(name)}


class QuickJit:
    """What `jax.jit` makes of a function, with `QUICK` where it is not part of another program.

    It is kept between commands, so that what has been compiled is not even traced again.

    Example:
        >>> double = QuickJit(lambda value: 2 * value)
        >>> float(double(1.5))
        3.0
    """

    def __init__(
        self,
        function: Callable[..., Any],
        static_argnames: Sequence[str] = (),
        *,
        name: str | None = None,
    ) -> None:
        """The program; nothing happens before its first call.

        Args:
            function: pure; what it computes follows from its arguments and the code alone, or it
                has no name.
            static_argnames: as of `jax.jit`; such arguments are given by their names.
            name: by which it is kept; by default its own, if it is one of this project's and not
                local to another function. Nothing is kept with an empty one.
        """
        functools.update_wrapper(self, function)
        self._name = _name_of(function) if name is None else name
        self._static = tuple(static_argnames)
        self._within = jax.jit(function, static_argnames=self._static)
        self._compiled: dict[Hashable, Any] = {}
        _JITTED.add(self)

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        """What the function returns."""
        if any(isinstance(one, Tracer) for one in jax.tree.leaves((args, kwargs))):
            return self._within(*args, **kwargs)
        _, given = divided(kwargs, self._static)
        return self.compile(*args, **kwargs)(*args, **given)

    def compile(self, *args: Any, **kwargs: Any) -> Any:
        """What computes it for arguments like these, all but the static ones."""
        key = _key_of(args, kwargs, self._static)
        if key not in self._compiled:

            def compiled() -> Any:
                return self._within.lower(*args, **kwargs).compile(compiler_options=known_options())

            kept = _kept_executable(f"{self._name} {key}", compiled) if self._name else compiled()
            self._compiled[key] = kept
        return self._compiled[key]

    @property
    def compiled_count(self) -> int:
        """For how many structures of arguments it is compiled."""
        return len(self._compiled)

    def trace(self, *args: Any, **kwargs: Any) -> Any:
        """As that of what `jax.jit` returns."""
        return self._within.trace(*args, **kwargs)

    def forget(self) -> None:
        """Let go of all that is compiled."""
        self._compiled.clear()


_JITTED: WeakSet[QuickJit] = WeakSet()


def _forget_compiled() -> None:
    for one in [*_JITTED]:
        one.forget()


forget_with_programs(_forget_compiled)


def keep_interpreter(function: Callable[..., Any], *args: Any, name: str) -> Interpreter:
    """A function for arguments like these, computed by NumPy.

    Args:
        function: pure.
        args: none of them static.
        name: as of `QuickJit`.

    Example:
        >>> double = keep_interpreter(lambda value: 2 * value, jnp.array(1.0), name="")
        >>> float(double(1.5))
        3.0
    """
    return _interpreter(lambda: jax.jit(function).trace(*args), name, _key_of(args, {}, ()))


def _interpreter(trace: Callable[[], Any], name: str, key: Any) -> Interpreter:
    """What computes a program by NumPy; it is kept between commands where it has a name."""

    def translated() -> Interpreter:
        return Interpreter(trace())

    return kept_value(f"NumPy {name} {key}", translated) if name else translated()


def _name_of(function: Callable[..., Any]) -> str:
    """A function's name; empty if it is local to another one, a part of one, or somebody else's.

    The code of others may change while its names stay.
    """
    name = getattr(function, "__qualname__", "<partial>")
    if "<" in name or function.__module__.partition(".")[0] not in PACKAGES:
        return ""
    return f"{function.__module__}.{name}"


def divided(kwargs: dict[str, Any], static: Sequence[str]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Named arguments that are static, and the others."""
    fixed = {name: kwargs[name] for name in static if name in kwargs}
    return fixed, {name: value for name, value in kwargs.items() if name not in fixed}


def _key_of(args: Any, kwargs: dict[str, Any], static: Sequence[str]) -> Any:
    """All of arguments that decides which program computes with them."""
    fixed, given = divided(kwargs, static)
    leaves, tree = jax.tree.flatten((args, given))
    is_wide = jnp.result_type(float) == jnp.float64
    return tuple(fixed.items()), tree, tuple(map(_type_of, leaves)), is_wide


@dataclass(frozen=True)
class _Executable:
    """A compiled program as it is kept; whether it calls LAPACK, and its arguments and results."""

    content: bytes
    calls_lapack: bool
    given: Structure
    found: Structure

    def load(self) -> Any:
        if self.calls_lapack:
            _find_lapack()
        return serialize_executable.deserialize_and_load(
            self.content, self.given.definition, self.found.definition
        )


@functools.cache
def _find_lapack() -> None:
    """Let JAX look up LAPACK's functions, which it does when it lowers a program that calls one.

    A program that is only read would call what has no address.
    """
    jax.jit(jnp.linalg.cholesky).lower(jax.ShapeDtypeStruct((1, 1), jnp.float32))


def _kept_executable(key: str, compile_: Callable[[], Any]) -> Any:
    """A compiled program that is kept by its key; what cannot be kept is compiled each time."""
    if current_store() is None:
        return compile_()
    device = jax.devices()[0]
    key = f"{key} {device.platform} {device.device_kind} {processor()}"
    if (found := find_value(key)) is not None:
        return found.load()
    with compiling_anew() as is_anew:
        program = compile_()
    # JAX writes no program that calls Python, or to which it hands constants apart.
    with suppress(ValueError, NotImplementedError):
        called = set(re.findall(r'custom_call_target="([^"]*)"', program.as_text()))
        if is_anew() and all(name.startswith("lapack_") for name in called):
            content, given, returned = serialize_executable.serialize(program)
            keep_value(
                key, _Executable(content, bool(called), Structure(given), Structure(returned))
            )
    return program


@dataclass
class _Call:
    """A program with arguments of one structure; what computes it until it is compiled."""

    run: Callable[[], Any]
    interpret: Callable[[], Interpreter]
    interpreter: Interpreter | None = None
    is_compiled: bool = False
    fault: Exception | None = None

    @property
    def waits(self) -> bool:
        """Whether it is to be compiled; what could not be is not tried again."""
        return not self.is_compiled and self.fault is None

    def compile(self) -> None:
        """Compile it; what that raises is kept."""
        try:
            self.run()
        except Exception as error:
            self.fault = error
        else:
            self.is_compiled, self.interpreter = True, None


class Prompt:
    """Answers at once: what programs return is computed by NumPy until it is compiled.

    Example:
        >>> prompt, double = Prompt(), Program(lambda value: 2 * value)
        >>> with prompt.answering():
        ...     print(float(double(1.5)), double.when_compiled(1.5))
        3.0 None
        >>> prompt.compile()
        >>> with prompt.answering():
        ...     print(float(double(1.5)), float(double.when_compiled(1.5)))
        3.0 3.0
    """

    def __init__(self) -> None:
        self._calls: dict[Hashable, _Call] = {}

    @contextmanager
    def answering(self) -> Iterator[None]:
        """Within it, and in its thread, programs are answered at once."""
        token = _ANSWERING.set(self)
        try:
            yield
        finally:
            _ANSWERING.reset(token)

    @property
    def is_behind(self) -> bool:
        """Whether anything was called that is not compiled."""
        return any(one.waits for one in [*self._calls.values()])

    def compile(self) -> None:
        """Compile what was called, with all cores and in the float type of whoever calls this.

        Raises:
            Exception: what the first program raised that could not be compiled; all others are,
                and NumPy goes on to answer for that one.
        """
        tried = list[_Call]()
        while waiting := [one for one in [*self._calls.values()] if one.waits]:
            side_by_side([one.compile for one in waiting])
            tried += waiting
        for fault in (one.fault for one in tried):
            if fault is not None:
                raise fault

    def has_compiled(self, program: Program, args: Any, kwargs: Any) -> bool:
        """Whether a program is compiled for arguments like these; it is to be, from now on."""
        return self._call(program, args, kwargs).is_compiled

    def answer(self, program: Program, args: Any, kwargs: Any) -> Any:
        """What a program returns."""
        call = self._call(program, args, kwargs)
        if call.is_compiled:
            return program.run(*args, **kwargs)
        if (interpreter := call.interpreter) is None:
            interpreter = call.interpreter = call.interpret()
        _, given = divided(kwargs, program.static)
        return interpreter(*args, **given).unpacked()

    def _call(self, program: Program, args: Any, kwargs: Any) -> _Call:
        key = program, _key_of(args, kwargs, program.static)
        if key not in self._calls:
            # What is traced is what XLA compiles later: JAX keeps it.
            trace = functools.partial(program.compiled.trace, *args, **kwargs)
            self._calls[key] = _Call(
                functools.partial(program.run, *args, **kwargs),
                functools.partial(_interpreter, trace, program.name, key[1]),
            )
        return self._calls[key]


def _type_of(leaf: Any) -> Any:
    """Shape and type; those of a number of Python's follow from what it is computed with."""
    try:
        return leaf.shape, leaf.dtype, getattr(leaf, "weak_type", False)
    except AttributeError:
        return type(leaf)


_ANSWERING: ContextVar[Prompt | None] = ContextVar("answering", default=None)
