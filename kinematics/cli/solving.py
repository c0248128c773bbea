"""What ``designopt solve`` does: read, sweep, solve, write the table, report what was met."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from designopt.compilation_cache import keep_programs
from designopt.errors import UserError
from designopt.io.csv_text import csv_text, numbers_text
from designopt.io.files import check_figure_ending, check_targets, replaced_when_complete
from designopt.io.ranges import grid_of, single_values
from designopt.kept import compute
from kinematics.io.assembled_sketch import AssembledSketch, assemble_sketch
from kinematics.io.sketch import load_sketch
from kinematics.model.topology import Structure
from kinematics.solve.plan import describe_plan, make_plan
from kinematics.solve.steps import PlanError

CHUNK = 4096
"""Poses that are solved and written at a time, so that memory does not grow with a sweep."""

SIZES = (64, 512)
"""Sweeps of at most so many poses are filled up to as many: they have one program."""

TABLE = "kinematics.cli.table:solve_columns"
"""What computes the columns; NumPy computes what JAX has traced of it."""

CODE = "result code"
"""Name of the one array that is no column: an integer for each pose, by which they fail."""

MOST_DRAWN = 10_000
"""Poses in a drawing; of more, so many are shown, evenly spread."""


@dataclass(frozen=True)
class Request:
    """What was asked for, as it was written on the command line.

    Attributes:
        file: the linkage file.
        sweeps: ``input=start:stop:count`` or ``input=value``, degrees or mm.
        rates: ``input=value``, rad/s or mm/s.
        accelerations: ``input=value``, rad/s² or mm/s².
        of: joints and bodies asked for; all if none.
        csv: where the table goes, ``-`` for standard output.
        figure: where a picture of the motion goes.
        animation: where an animation of the motion goes.
        force: whether existing files are replaced.
    """

    file: Path
    sweeps: tuple[str, ...]
    rates: tuple[str, ...] = ()
    accelerations: tuple[str, ...] = ()
    of: tuple[str, ...] | None = None
    csv: str = "-"
    figure: Path | None = None
    animation: Path | None = None
    force: bool = False


@dataclass(frozen=True)
class Solved:
    """Some of the poses, with everything that was computed of them.

    Attributes:
        inputs: values of the inputs, rad or mm, shape (poses, inputs).
        columns: of the table; NaN stands for an empty cell.
        codes: by which poses fail, of `kinematics.solve.poses.PoseResult`.
    """

    inputs: np.ndarray
    columns: dict[str, np.ndarray]
    codes: np.ndarray

    @property
    def ok(self) -> np.ndarray:
        """Which poses can be assembled."""
        return self.columns["ok"] == 1


def table_text(columns: dict[str, np.ndarray], *, head: bool) -> str:
    """Rows as CSV, by their columns, below the columns' names if there is to be a head."""
    return (csv_text([columns]) if head else "") + numbers_text(list(columns.values()))


@contextmanager
def table_at(target: str) -> Iterator[Callable[[str], object]]:
    """What writes a table's text, to standard output for ``-``; a file appears when it is complete.

    Raises:
        UserError: the file cannot be written.
    """
    if target == "-":
        yield sys.stdout.write
        return
    with (
        replaced_when_complete(Path(target)) as partial,
        partial.open("w", encoding="utf-8", newline="") as stream,
    ):
        yield stream.write


def print_plan(file: Path, of: Sequence[str] | None) -> None:
    """Print how a linkage is solved, in words.

    Raises:
        UserError: the file is faulty, or has no joint or body of a name in ``of``.
    """
    structure = assemble_sketch(load_sketch(file), str(file)).structure
    try:
        lines = describe_plan(structure, None if of is None else frozenset(of))
    except PlanError as error:
        raise UserError(f"--of: {error}") from error
    inputs = ", ".join(part.name for part in structure.inputs)
    print(f"{structure.name}: {len(structure.moving)} moving bodies, driven by {inputs}")
    print("\n".join(lines))


def solve_file(request: Request) -> tuple[list[str], bool]:
    """Solve and write what was asked for.

    Returns:
        Remarks for the person who asked, and whether any pose can be assembled.

    Raises:
        UserError: something in the file or in the request is wrong; nothing is written, but for
            rows on standard output.
    """
    named = {
        "--csv": None if request.csv == "-" else request.csv,
        "--figure": request.figure,
        "--animation": request.animation,
    }
    check_targets(named, force=request.force)
    if request.figure is not None:
        check_figure_ending("--figure", request.figure)
    sketch = assemble_sketch(load_sketch(request.file), str(request.file))
    _check_targets(sketch.structure, request.of)
    asked = grid_of(request.sweeps, "--sweep", _angle_inputs(sketch.structure), "input")
    shown = _shown_poses(request, len(asked))
    tally = Tally()
    # The table last: what fails in drawing leaves none behind.
    with table_at(request.csv) as write:
        for solved in _solve(sketch, request, asked):
            write(table_text(solved.columns, head=tally.count == 0))
            tally.add(solved, shown)
        drawn = _draw(sketch, request, tally) if tally.inputs else []
    failed = _failure_remarks(sketch, request, asked, tally) if tally.failures else []
    return [*failed, *drawn], tally.first is not None


class Tally:
    """What of all the poses outlives the rows of the table.

    Attributes:
        count: poses so far.
        failures: how many of them failed, by their codes.
        first: inputs of the first one that is ok, rad or mm.
        inputs: of the poses to draw, rad or mm.
    """

    def __init__(self) -> None:
        self.count = 0
        self.failures: Counter[int] = Counter()
        self.first: np.ndarray | None = None
        self.inputs: list[np.ndarray] = []

    def add(self, solved: Solved, shown: np.ndarray) -> None:
        """Take in the next poses; ``shown`` are the numbers of those to draw, of all."""
        ok = np.flatnonzero(solved.ok)
        if self.first is None and ok.size:
            self.first = solved.inputs[ok[0]]
        self.failures.update(solved.codes[~solved.ok].tolist())
        here = shown[np.searchsorted(shown, self.count) :] - self.count
        here = here[: np.searchsorted(here, len(solved.inputs))]
        if here.size:
            self.inputs.append(solved.inputs[here])
        self.count += len(solved.inputs)


def _shown_poses(request: Request, count: int) -> np.ndarray:
    """Numbers of the poses that are drawn: none, all of them, or `MOST_DRAWN`."""
    if request.animation is not None:
        # Imported here, as drawing is: Matplotlib takes a second.
        from kinematics.plot.animation import check_animation

        check_animation(request.animation)
    if request.figure is None and request.animation is None:
        return np.zeros(0, int)
    return np.linspace(0, count - 1, min(count, MOST_DRAWN)).astype(int)


def _solve(sketch: AssembledSketch, request: Request, asked: np.ndarray) -> Iterator[Solved]:
    """Solve a grid, `CHUNK` poses at a time."""
    structure = sketch.structure
    angles = list(_angle_inputs(structure).values())
    rates = _values(structure, request.rates, "--rate")
    accelerations = _values(structure, request.accelerations, "--accel")
    if rates is None and accelerations is not None:
        rates = np.zeros_like(accelerations)
    # Sweeps of about one length have one program.
    size = min(CHUNK, next((size for size in SIZES if len(asked) <= size), CHUNK))
    for start in range(0, len(asked), CHUNK):
        part = asked[start : start + CHUNK]
        inputs = np.where(angles, np.deg2rad(part), part)
        filled = np.concatenate([inputs, np.repeat(inputs[-1:], size - len(part), axis=0)])
        given = {
            "linkage": sketch.numbers,
            "inputs": filled,
            "rates": rates,
            "accelerations": accelerations,
        }
        found = compute(TABLE, given, structure.untitled, sketch.assembly, request.of)
        found = {name: column[: len(part)] for name, column in found.items()}
        codes = found.pop(CODE)
        named = {part.name: asked for part, asked in zip(structure.inputs, part.T, strict=True)}
        yield Solved(inputs, named | found, codes)


def _check_targets(structure: Structure, of: Sequence[str] | None) -> None:
    try:
        make_plan(structure, None if of is None else frozenset(of))
    except PlanError as error:
        raise UserError(f"--of: {error}") from error


def _angle_inputs(structure: Structure) -> dict[str, bool]:
    """By name, whether an input is an angle."""
    return {part.name: part.slider is None for part in structure.inputs}


def _values(structure: Structure, texts: Sequence[str], option: str) -> np.ndarray | None:
    if not texts:
        return None
    names = [part.name for part in structure.inputs]
    values = single_values(texts, option, names, "input")
    return np.array([values.get(name, 0.0) for name in names])


def _draw(sketch: AssembledSketch, request: Request, tally: Tally) -> list[str]:
    """Draw what was asked for; returns remarks on it."""
    keep_programs()
    from kinematics.cli.drawing import draw_motion  # Matplotlib and JAX take a second each

    inputs = np.concatenate(tally.inputs)
    if not draw_motion(sketch, inputs, request.of, request.figure, request.animation):
        return ["nothing is drawn: no pose to show can be assembled"]
    if len(inputs) == tally.count:
        return []
    return [f"drawn: {len(inputs):,} of {tally.count:,} poses, evenly spread"]


def _failure_remarks(
    sketch: AssembledSketch, request: Request, asked: np.ndarray, tally: Tally
) -> list[str]:
    """How many poses failed and why, and the limits of the inputs that ran into them."""
    keep_programs()
    from kinematics.cli.remarks import failure_messages, limit_remarks  # these load JAX

    some = f"{tally.failures.total()} of {tally.count} poses cannot be assembled"
    first = "no pose can be assembled" if tally.first is None else some
    lines = [f"{first}; their rows have ok = 0 and empty cells"]
    lines += [f"  {count} poses: {message}" for message, count in failure_messages(tally.failures)]
    # From a pose that exists, so that the other inputs are as they were asked for.
    start = sketch.numbers["reference"]["inputs"] if tally.first is None else tally.first
    for index, part in enumerate(sketch.structure.inputs):
        if np.ptp(asked[:, index]) > 0 or len(asked) == 1:
            lines += limit_remarks(sketch, part.name, start, request.of)
    return lines
