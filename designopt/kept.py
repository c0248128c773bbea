"""What is worked out once for a topology: plans and programs, kept between commands.

They lie beside compiled programs, where a command has asked for it (`compilation_cache`). No result
is kept: whatever depends on a dimension or an input is computed.
"""

from __future__ import annotations

import functools
import importlib.metadata
import os
import pickle
import platform
import sys
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import numpy as np

from designopt.compilation_cache import current_store
from designopt.numpy_program import NumpyProgram

PACKAGES = ("designopt", "kinematics", "optics", "perception", "studies")
"""Whose code decides what is kept."""

_PROGRAMS: dict[str, tuple[list[str], NumpyProgram]] = {}
"""Those of this process, by their keys."""

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")


def kept(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """A function whose results are kept by its arguments' `repr`; what it raises is not.

    Args:
        function: pure, of arguments of equal `repr` if they are equal, with results that can be
            pickled.

    Example:
        >>> @kept
        ... def square(number: int) -> int:
        ...     return number * number
        >>> square(3)
        9
    """
    name = f"{function.__module__}.{function.__qualname__}"

    @functools.wraps(function)
    def wrapped(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Result:
        def work_out() -> Result:
            return function(*args, **kwargs)

        return kept_value(f"{name} {args!r} {kwargs!r}", work_out)

    return wrapped


def compute(place: str, arguments: Any, *fixed: Any) -> dict[str, np.ndarray]:
    """What a function of arrays returns, by NumPy; its program is kept, without JAX.

    Args:
        place: of the function, ``"module:name"``; it is loaded, with JAX, where its program is not
            kept. It returns an ordered dictionary of arrays.
        arguments: arrays in dictionaries, tuples and lists, or ``None``; they are the function's
            first argument.
        fixed: further arguments, of equal `repr` if they are equal.

    Example:
        >>> place = "designopt.kept:_example"
        >>> compute(place, {"angle": np.array([0.0, 1.0])}, 2)["doubled"].tolist()
        [0.0, 2.0]
    """
    leaves = [np.asarray(one) for one in leaves_of(arguments)]
    types = [(one.shape, one.dtype.str) for one in leaves]
    key = f"{place} {types!r} {_shape_of(arguments)!r} {fixed!r}"
    if key not in _PROGRAMS:
        trace = functools.partial(_traced, place, arguments, fixed)
        _PROGRAMS[key] = kept_value(key, trace)
    names, program = _PROGRAMS[key]
    with np.errstate(all="ignore"):
        found = program(*leaves)
    return dict(zip(names, map(np.asarray, found), strict=True))


def leaves_of(arguments: Any) -> list[Any]:
    """The arrays of nested dictionaries, tuples and lists, in the order in which JAX has them.

    Example:
        >>> leaves_of({"b": (1, None), "a": [2]})
        [2, 1]
    """
    if arguments is None:
        return []
    if isinstance(arguments, Mapping):
        return [leaf for name in sorted(arguments) for leaf in leaves_of(arguments[name])]
    if isinstance(arguments, tuple | list):
        return [leaf for part in arguments for leaf in leaves_of(part)]
    return [arguments]


def _shape_of(arguments: Any) -> Any:
    """How they are nested."""
    if isinstance(arguments, Mapping):
        return {name: _shape_of(arguments[name]) for name in sorted(arguments)}
    if isinstance(arguments, tuple | list):
        return [_shape_of(part) for part in arguments]
    return arguments is None


def _traced(place: str, arguments: Any, fixed: tuple[Any, ...]) -> tuple[list[str], NumpyProgram]:
    from designopt.interpreter import named_program  # with JAX

    module, _, name = place.partition(":")
    function = getattr(importlib.import_module(module), name)
    return named_program(lambda given: function(given, *fixed), arguments)


def kept_value(key: str, work_out: Callable[[], Result]) -> Result:
    """A value that is kept by its key; what cannot be pickled is worked out each time.

    Args:
        key: a text of all that decides the value, but for our own code and what that uses.
        work_out: what is kept is not called.

    Example:
        >>> kept_value("the number of bars", lambda: 4)
        4
    """
    found = find_value(key)
    if found is None:
        found = work_out()
        keep_value(key, found)
    return found


def find_value(key: str) -> Any:
    """What is kept by a key; ``None`` if nothing is.

    Example:
        >>> find_value("no such key") is None
        True
    """
    store = current_store()
    found = None if store is None else store.get(f"{_fingerprint()} {key}")
    # The folder is the user's alone, as it is for the machine code beside it.
    return None if found is None else pickle.loads(found)


def keep_value(key: str, value: object) -> None:
    """Keep a value by its key, if a command has asked for it and it can be pickled.

    Example:
        >>> keep_value("the number of bars", 4)
    """
    store = current_store()
    if store is None:
        return
    # A program of which a part is JAX's cannot be.
    with suppress(pickle.PicklingError, AttributeError, TypeError):
        store.put(f"{_fingerprint()} {key}", pickle.dumps(value))


@functools.cache
def _fingerprint() -> str:
    """Of all code that what is kept depends on."""
    root = Path(__file__).parents[1]
    found = [
        (path, about.st_mtime_ns, about.st_size)
        for package in PACKAGES
        for folder, _, files in os.walk(root / package)
        for path in (os.path.join(folder, name) for name in files if name.endswith(".py"))
        for about in [os.stat(path)]  # by which Python takes its own compiled code for current
    ]
    versions = [importlib.metadata.version(name) for name in ("jax", "jaxlib", "numpy")]
    options = sorted(one for one in os.environ.items() if one[0].startswith(("JAX_", "XLA_")))
    return f"{sys.version} {versions} {options} {sorted(found)}"


@functools.cache
def processor() -> str:
    """What machine code depends on: the processor and its instructions."""
    try:
        lines = Path("/proc/cpuinfo").read_text().split("\n\n")[0].splitlines()
    except OSError:
        return f"{platform.machine()} {platform.processor()}"
    entries = ("model name", "flags", "Features", "CPU implementer", "CPU part")
    return f"{platform.machine()} {[line for line in lines if line.startswith(entries)]}"


def _example(arguments: Mapping[str, Any], factor: int) -> dict[str, Any]:
    return {"doubled": factor * arguments["angle"]}
