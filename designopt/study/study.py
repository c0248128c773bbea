"""A design study as a plug-in: what it is, what it is given, and how it is found."""

from __future__ import annotations

import difflib
import pkgutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from importlib.metadata import entry_points
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from designopt.errors import UserError, load_plug_in
from designopt.io.spec import Spec
from designopt.study.results import Results

if TYPE_CHECKING:
    from designopt.design_kind import Design

STUDY_GROUP = "designopt.studies"

T = TypeVar("T")


def _not_shown(total: int) -> Callable[[], None]:
    """No display of how many are done."""
    return lambda: None


@dataclass(frozen=True)
class Context:
    """What the runner gives a study beside its spec.

    Attributes:
        seed: seed of every random draw.
        dtype: ``"float64"`` or ``"float32"``; JAX's default float type while the study runs.
        step: ``with step("Fitting"):`` shows what is being done while it lasts.
        count: ``done = count(12)`` shows how many of 12 are done, and the time left: ``done()`` is
            called for each; see `each`.
    """

    seed: int
    dtype: str
    step: Callable[[str], AbstractContextManager[None]]
    count: Callable[[int], Callable[[], None]] = _not_shown

    def each(self, items: Sequence[T], describe: Callable[[T], str]) -> Iterator[T]:
        """Go through items in a step each, and show how many are done and the time left.

        Args:
            items: what is gone through.
            describe: from an item to what is being done with it.

        Yields:
            The items, in their order.

        Example:
            >>> from contextlib import nullcontext
            >>> context = Context(0, "float64", lambda text: nullcontext(print(text)))
            >>> for size in context.each([480, 1080], lambda size: f"Images {size} px high"):
            ...     assert size in (480, 1080)
            Images 480 px high
            Images 1080 px high
        """
        done = self.count(len(items))
        for item in items:
            with self.step(describe(item)):
                yield item
            done()

    def require_float64(self, why: str) -> None:
        """End a study that asks more of its numbers than float32 has.

        Args:
            why: what it does that needs them.

        Raises:
            UserError: another float type than float64.
        """
        if self.dtype != "float64":
            raise UserError(f"--dtype {self.dtype}: {why}, which needs float64; leave --dtype out")


@dataclass(frozen=True)
class Study:
    """A study, offered through the entry-point group ``designopt.studies``.

    Attributes:
        name: its name on the command line, the same as its entry point's.
        purpose: one line.
        spec: pydantic model of its settings, with defaults.
        run: from spec and context to results (`designopt.Report`); imports JAX and the rest only
            when called (`lazily`).
        needs: what must be installed beyond the package itself (extras); empty if nothing.
        design: from its spec, and from the ``specs`` folder of an earlier result with that spec
            if there is one, to the design that ``explore`` and ``export`` take; ``None`` if the
            study designs nothing.
        batch: from many specs at once to what ``run`` finds for each, in the same order, but for
            rounding: its metrics, or the error raised instead. For studies whose
            points JAX can batch; used by sweeps only.
        front_of: the study whose trade-offs it shows, for ``designopt front``: it has the settings
            of that one, and others, ``objectives`` among them; ``None`` if it shows none.
    """

    name: str
    purpose: str
    spec: type[Spec]
    run: Callable[[Any, Context], Results]
    needs: tuple[str, ...] = ()
    design: Callable[[Any, Path | None], Design] | None = None
    batch: Callable[[Sequence[Any], Context], Sequence[Results | UserError]] | None = None
    front_of: str | None = None


def lazily(where: str) -> Callable[..., Any]:
    """A function that is imported when it is first called, so that listing a study is cheap.

    Args:
        where: ``"package.module:function"``, as entry points name it.

    Example:
        >>> lazily("math:hypot")(3, 4)
        5.0
    """
    return lambda *args: pkgutil.resolve_name(where)(*args)


def installed_studies() -> Iterator[tuple[str, Study | UserError]]:
    """Every installed study by name; one that cannot be loaded comes as its error."""
    for point in sorted(entry_points(group=STUDY_GROUP), key=lambda point: point.name):
        try:
            yield point.name, load_study(point.name)
        except UserError as error:
            yield point.name, error


def load_study(name: str) -> Study:
    """The installed study of that name.

    Raises:
        UserError: there is none of that name, or its package cannot be imported.
    """
    points = {point.name: point for point in entry_points(group=STUDY_GROUP)}
    if name not in points:
        close = difflib.get_close_matches(name, points, n=1)
        hint = f"did you mean '{close[0]}'?" if close else f"there are: {', '.join(sorted(points))}"
        raise UserError(f"STUDY: no study is named '{name}'; {hint}")
    study = load_plug_in(points[name], "study")
    if not isinstance(study, Study):
        raise UserError(
            f"study '{name}' ({points[name].value}) is a {type(study).__name__}, not a "
            "designopt.Study; repair or uninstall the package that offers it"
        )
    return study
