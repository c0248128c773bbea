"""What `designopt trace` does: read, pose, trace, draw, write, report what is not seen."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path

import jax
import numpy as np
from jaxtyping import Float

from designopt.design_kind import read_tables
from designopt.errors import UserError
from designopt.io.files import check_figure_ending, check_targets, replaced_when_complete
from designopt.io.ranges import LARGEST_INPUT, grid_of, single_values
from designopt.programs import Prompt
from optics.cli.report import document_of, lines_of
from optics.scene.file import MOST_BOUNCES
from optics.scene.reading import parse_scene
from optics.scene.scene import Scene
from optics.visibility.remarks import remark_on_fields, remarks_on, remarks_on_model
from optics.visibility.scene_trace import trace_sweep

MOST_BY_NUMPY = 2048
"""More poses are computed by programs that are compiled, which takes longer than few poses do."""

MOST_POSES = 250_000
"""A larger grid makes gigabytes of JSON."""


def trace_file(
    file: Path,
    *,
    poses: Sequence[str] = (),
    sweeps: Sequence[str] = (),
    rays: Sequence[str] = (),
    bounces: int | None = None,
    json: str = "-",
    figure: Path | None = None,
    chart: Path | None = None,
    force: bool = False,
) -> list[str]:
    """Trace, write what was asked for, and return the remarks.

    Args:
        file: the scene file.
        poses: ``angle=value``, several divided by commas, degrees.
        sweeps: ``angle=start:stop:count`` or ``angle=value``, degrees.
        rays: ``x,y,direction``, mm and degrees counter-clockwise from +x.
        bounces: most reflections of a path or ray; the scene's own number if none.
        json: where the document goes, ``-`` for standard output.
        figure: where a drawing of the section in the poses goes.
        chart: where curves or maps over the swept angles go.
        force: whether existing files are replaced.

    Raises:
        UserError: something in the file or in the request is wrong; nothing is written.
    """
    figures = {"--figure": figure, "--chart": chart}
    target = None if json == "-" else Path(json)
    check_targets({"--json": target, **figures}, force=force)
    for option, path in figures.items():
        if path is not None:
            check_figure_ending(option, path)
    if bounces is not None and not 0 <= bounces <= MOST_BOUNCES:
        raise UserError(
            f"--bounces {bounces}: that many reflections cannot be followed; "
            f"ask for 0 to {MOST_BOUNCES}"
        )
    with ExitStack() as stack:
        stack.enter_context(jax.enable_x64(True))
        tables = read_tables(file, "scene", "camera")
        scene = parse_scene(tables, str(file))
        angles = posed_angles(scene, poses, sweeps)
        if len(angles) <= MOST_BY_NUMPY:
            stack.enter_context(Prompt().answering())
        starts = np.array([_ray(text) for text in rays]).reshape(-1, 3)
        if chart is not None:
            _check_drawable(scene, angles, chart)
        trace = trace_sweep(
            scene, angles, scene.layout.bounces if bounces is None else bounces, starts
        )
        # The document last: what fails in drawing leaves none behind.
        if figure is not None or chart is not None:
            # Imported here: Matplotlib takes a second.
            from optics.plot.trace_figures import save_chart, save_section

            if figure is not None:
                save_section(trace, figure)
            if chart is not None:
                save_chart(trace, chart)
        _write(lines_of(document_of(trace)), target)
        on_camera = [*remarks_on_model(tables["camera"]), remark_on_fields(scene.camera)]
        return [*remarks_on(trace), *on_camera]


def posed_angles(
    scene: Scene, poses: Sequence[str], sweeps: Sequence[str]
) -> Float[np.ndarray, "poses joints"]:
    """Joint angles of all poses of a grid, degrees; see `trace_file`.

    Raises:
        UserError: a text of another form, an unknown joint, or too large a grid.
    """
    texts = [part for text in poses for part in text.split(",")]
    named = dict.fromkeys(scene.angle_names, 0.0)
    posed = single_values(texts, "--pose", named, "joint angle")
    for name, value in posed.items():
        if abs(value) > LARGEST_INPUT:
            raise UserError(f"--pose {name}={value:g}: so large an angle has no digits left")
    for text in sweeps:
        name = text.partition("=")[0]
        if name in posed:
            raise UserError(f"--sweep {text}: --pose gives '{name}' too; leave out one of them")
    swept = dict.fromkeys(scene.angle_names, True)
    grid = grid_of(sweeps, "--sweep", swept, "joint angle", named | posed)
    if len(grid) > MOST_POSES:
        raise UserError(
            f"--sweep: a grid of {len(grid):,} poses is too large (at most {MOST_POSES:,}); "
            "sweep fewer values"
        )
    return grid


def _ray(text: str) -> list[float]:
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != 3 or not all(abs(number) <= LARGEST_INPUT for number in numbers):
        raise UserError(
            f"--ray {text}: write it as X,Y,DEG: three numbers, its start in mm and its direction "
            "in degrees, counter-clockwise from +x"
        )
    return numbers


def _check_drawable(scene: Scene, angles: Float[np.ndarray, "poses joints"], chart: Path) -> None:
    """Refuse charts that cannot be drawn, before anything is computed for them."""
    varying = int(np.sum(np.ptp(angles, axis=0) > 0))
    if not scene.layout.pads:
        raise UserError(f"--chart {chart}: the scene has no pads, so there is no coverage")
    if varying not in (1, 2):
        raise UserError(
            f"--chart {chart}: it shows one or two swept angles, not {varying}; "
            "use --sweep ANGLE=START:STOP:COUNT once or twice"
        )


def _write(lines: Iterator[str], target: Path | None) -> None:
    if target is None:
        sys.stdout.writelines(lines)
        return
    with (
        replaced_when_complete(target) as partial,
        partial.open("w", encoding="utf-8", newline="") as stream,
    ):
        stream.writelines(lines)
