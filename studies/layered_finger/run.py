"""The study itself: from its spec to its results."""

from __future__ import annotations

import math
from operator import itemgetter
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from matplotlib.figure import Figure

from designopt import Context, Records, Report, Results
from designopt.solution import Solution
from designopt.study import plots
from optics import Fabrication, Imaging, Pieces, Scene, find_corners_in_space, find_views
from optics.plot.scene_figures import poses_figure
from optics.scene.fabrication import perturb, scale_errors
from optics.scene.sold import fields_of_view
from optics.visibility.sharpness import find_sharpness
from optics.visibility.unfolding import paths_of
from studies.layered_finger import LayeredFingerSpec
from studies.layered_finger.cases import (
    ACRYLIC,
    CASES,
    MIDDLE,
    PROJECTIONS,
    SILICONE,
    Pair,
    plain_tables,
    sold_camera,
)
from studies.layered_finger.mirrors import Redesigner
from studies.layered_finger.strips import ends_of, lost_strips
from studies.models.finger import Finger
from studies.models.finger_file import bare_finger
from studies.models.finger_parts import PHALANGES
from studies.models.sensor.made import carried_by_camera, deviations_of
from studies.models.sensor.spec import WIDTH
from studies.oracles import layers as oracle
from studies.oracles.layered_scenes import posed_tables, read
from studies.oracles.shadows import shadow_width

OUTER = {"proximal": 0, "distal": 2}
"""The pads that are not wholly seen, and their places among all pads."""

ROUNDING_DEG = 1e-9
"""A posture may exceed the largest flexion by as much."""

TEXT_MM = 22.0
"""Words on a lost strip stand so far behind it."""

COARSE = 5
"""Every so many angles are those of a coarse grid."""

PLATE = "3 mm"
"""Layers under which lenses are compared."""

FABRICATED = ("none", PLATE, "3+2 mm", "3 mm, clear ends")
"""Layers under which fingers with errors are looked at."""

MARKED = 9
"""Markers on a line."""

SHOWN = ("none", "2 mm", PLATE, "3+2 mm", "2 mm, overhang", "3 mm, overhang", "3 mm, clear ends")
"""Whose coverage is drawn."""

SHADOWS: dict[str, tuple[list[Pair], float | None]] = {
    "3 mm acrylic": ([(3.0, ACRYLIC)], 2.7),
    "3 mm, n 1.43": ([(3.0, MIDDLE)], 2.7),
    "3 mm silicone": ([(3.0, SILICONE)], 2.7),
    "3 mm acrylic + 2 mm silicone": ([(3.0, ACRYLIC), (2.0, SILICONE)], 4.2),
}
"""Layers whose shadow at 70° is published, and its published width, mm."""


class Survey(NamedTuple):
    """What a scene shows over all pairs of joint angles.

    Attributes:
        scene: the scene.
        coverage: of every pad; NaN where layers would run into each other.
        worst: of every pad, the indices of the posture in which least of it is seen.
        views: what is seen in these postures.
    """

    scene: Scene
    coverage: Float[np.ndarray, "pip dip pads"]
    worst: list[tuple[int, int]]
    views: list[Solution[Pieces]]

    @classmethod
    def of(
        cls, scene: Scene, poses: Float[Array, "pip dip joints"], most_deg: float = 180.0
    ) -> Survey:
        """What is seen in poses up to a flexion."""
        views = find_views(scene, poses)
        free = np.all(np.rad2deg(poses) <= most_deg + ROUNDING_DEG, axis=-1)
        coverage = np.where(free[..., None], views.value.coverage(), np.nan)
        flat = np.nanargmin(coverage.reshape(-1, coverage.shape[-1]), axis=0)
        worst = [divmod(int(at), coverage.shape[1]) for at in flat]
        return cls(scene, coverage, worst, [jax.tree.map(itemgetter(at), views) for at in worst])

    def least(self, step: int = 1) -> dict[str, float]:
        """Worst coverage of the outer pads, of every so many angles."""
        some = self.coverage[::step, ::step]
        return {name: float(np.nanmin(some[..., pad])) for name, pad in OUTER.items()}


class Measurements(NamedTuple):
    """All that is measured.

    Attributes:
        degrees: of either joint.
        surveys: by the names of `CASES`.
        strips: what is lost in the worst postures.
        checks: coverage in the worst postures by brute force.
        redesigned: worst coverage with other mirrors.
        lenses: fields and coverage with a lens as it is sold.
        made: worst coverage of fingers with errors of fabrication, and the room beside
            these pads in the image.
    """

    degrees: Float[np.ndarray, " angles"]
    surveys: dict[str, Survey]
    strips: Records
    checks: Records
    redesigned: Records
    lenses: Records
    made: Records


def run(spec: LayeredFingerSpec, context: Context) -> Results:
    """Survey the finger under all layers and lenses, explain and check what is lost.

    Raises:
        UserError: another float type than float64.
    """
    context.require_float64("layered-finger compares to 1e-9 of a pad")
    out, finger = Report(spec, package=__package__), bare_finger()
    degrees = np.linspace(0.0, finger.body.range_deg, spec.angles)
    angles = jnp.deg2rad(jnp.asarray(degrees))
    poses = jnp.stack(jnp.meshgrid(angles, angles, indexing="ij"), axis=-1)
    found = Measurements(degrees, {}, *(Records() for _ in range(5)))
    for name, case in CASES.items():
        with context.step(f"Layers: {name}"):
            scene, most = case.scene(finger), case.meeting_deg(finger)
            found.surveys[name] = survey = Survey.of(scene, poses, most)
            explain(found, name, survey, spec.rays)
    with context.step("Lenses as they are sold"):
        compare_lenses(found, poses)
    with context.step("Fingers with errors of fabrication"):
        fabricate(found, spec, poses[::COARSE, ::COARSE], context.seed)
    if spec.redesign:
        redesign(found, finger, poses, context)
    add_metrics(out, finger, found)
    add_tables(out, found)
    add_findings(out, finger, found)
    add_figures(out, found)
    return out.results()


def explain(found: Measurements, name: str, survey: Survey, rays: int) -> None:
    """Add what is lost of the outer pads in their worst postures, and the brute-force check."""
    tables = plain_tables(survey.scene)
    for pad, index in OUTER.items():
        at, views = survey.worst[index], survey.views[index]
        pip, dip = (float(found.degrees[one]) for one in at)
        where = {"layers": name, "pad": pad, "pip_deg": pip, "dip_deg": dip}
        posed = posed_tables(tables, {"pip": pip, "dip": dip})
        plain = read(posed)
        by_rays = oracle.coverage(plain, oracle.runs(plain, rays))[index]
        exact = float(survey.coverage[at][index])
        check = {"coverage": exact, "by_rays": by_rays, "difference": by_rays - exact}
        found.checks.add(**where, **check)
        start, end = ends_of(posed["pads"][index])
        length = abs(end - start)
        for strip in lost_strips(survey.scene, posed, views.value, index):
            along, width, air, inside = strip.shadow or (math.nan,) * 4
            found.strips.add(
                **where,
                lost_mm=length * (strip.end - strip.start),
                from_mm=length * strip.start,
                to_mm=length * strip.end,
                view=strip.view,
                bound=strip.bound,
                air_deg=math.degrees(air),
                inside_deg=math.degrees(inside),
                shadow_mm=width,
                formula_mm=along,
                difference_mm=along - length * strip.at,
            )


def compare_lenses(found: Measurements, poses: Float[Array, "pip dip joints"]) -> None:
    """Add fields of view and coverage in air and under `PLATE` with every projection.

    What is seen depends on the field in the section alone: today's scenes are given other fields.
    """
    for projection in PROJECTIONS:
        for axis in ("long", "short"):
            camera = sold_camera(projection, axis).camera
            fields: Any = fields_of_view(camera)
            for name in ("none", PLATE):
                scene, field = found.surveys[name].scene, camera.field_of_view
                scene = eqx.tree_at(lambda one: one.camera.field_of_view, scene, field)
                survey = Survey.of(scene, poses)
                row = {"projection": projection, "long_deg": fields["horizontal"]}
                row |= {"short_deg": fields["vertical"], "in_section": axis, "layers": name}
                for index, pad in enumerate(PHALANGES):
                    part = survey.coverage[..., index]
                    row |= {pad: float(part.min()), f"{pad}_mean": float(part.mean())}
                found.lenses.add(**row)


def fabricate(
    found: Measurements,
    spec: LayeredFingerSpec,
    poses: Float[Array, "pip dip joints"],
    seed: int,
) -> None:
    """Add worst coverage of the outer pads in fingers with errors, those of layers among them."""
    flat = poses.reshape(-1, poses.shape[-1])
    for name in FABRICATED:
        survey = found.surveys[name]
        deviations = deviations_of(spec.tolerances, survey.scene)
        count = sum(leaf.size for leaf in jax.tree.leaves(deviations))
        draws = np.random.default_rng([seed, 4]).standard_normal((spec.made, count))
        given = survey.scene, deviations, jnp.asarray(draws), flat
        worst, room = map(np.asarray, find_worst(*given, Imaging.of(survey.scene.camera)))
        for place, (pad, index) in enumerate(OUTER.items()):
            own = worst[:, index]
            row = {"designed": survey.least(COARSE)[pad], "median": np.median(own)}
            row |= {"p5": np.percentile(own, 5), "room_p5_px": np.percentile(room[:, place], 5)}
            found.made.add(layers=name, pad=pad, **row)


@eqx.filter_jit
def find_worst(
    scene: Scene,
    deviations: Fabrication,
    draws: Float[Array, "draws errors"],
    poses: Float[Array, "poses joints"],
    imaging: Imaging,
) -> tuple[Float[Array, "draws pads"], Float[Array, "draws outer"]]:
    """What fingers with drawn errors of fabrication leave at worst over poses.

    Errors out of the section, on which coverage in it does not depend, move pads towards the left
    and the right end of the image. What counts there is every corner, between the image's upper and
    lower end, of a view that shows any of the pad in the section, direct or in the mirror of the
    pad's own phalanx.

    Args:
        scene: as designed.
        deviations: of the errors.
        draws: of standard normal numbers, one for every error.
        poses: joint angles, rad.
        imaging: image of the camera as designed.

    Returns:
        Coverage of every pad, and how far the outer ones are from these ends of the image, px.
    """
    layout, carried = scene.layout, carried_by_camera(scene)
    words = paths_of(layout, layout.bounces)
    views = tuple(
        (word, pad)
        for pad in OUTER.values()
        for word in words
        if len(word) < 2 and all(layout.mirrors[i].frame == layout.pads[pad].frame for i in word)
    )
    paths = jnp.array([words.index(word) for word, _ in views])
    pads = np.array([pad for _, pad in views])

    def worst(numbers: Float[Array, " errors"]) -> tuple[Array, Array]:
        errors = scale_errors(deviations, numbers)
        made = perturb(scene, errors, carried=carried)
        camera = eqx.tree_at(lambda one: one.camera, imaging, made.camera)

        def corners(pose: Float[Array, " joints"]) -> Float[Array, "views 4 2"]:
            return find_corners_in_space(made, pose, errors, camera, WIDTH, views)

        column, row = jnp.moveaxis(jax.vmap(corners)(poses), -1, 0)
        pieces = find_views(made, poses).value
        on_path = pieces.path[:, pads] == paths[None, :, None]
        shown = jnp.any(pieces.present[:, pads] & on_path, axis=-1)[..., None]
        shown &= (row >= 0) & (row <= camera.rows - 1)
        aside = jnp.minimum(column, camera.columns - 1 - column)
        room = jnp.min(jnp.where(shown, aside, jnp.inf), axis=(0, 2))
        outer = [jnp.min(room[pads == pad]) for pad in OUTER.values()]
        return jnp.min(pieces.coverage(), axis=0), jnp.stack(outer)

    return jax.lax.map(worst, draws)


def redesign(
    found: Measurements, finger: Finger, poses: Float[Array, "pip dip joints"], context: Context
) -> None:
    """Add worst coverage with camera and mirrors placed anew, of the published cases."""
    search, alike = Redesigner(finger), np.arange(len(poses))
    for name, case in CASES.items():
        if case.redesigned is None:
            continue
        with context.step(f"Other mirrors: {name}"):
            scene = search.redesigned(found.surveys[name].scene)
            survey = Survey.of(scene, poses)
            views = find_views(scene, poses).value
            pieces, bent = jax.tree.map(lambda leaf: leaf[alike, alike], (views, poses))
            sharp = find_sharpness(scene, np.asarray(bent), pieces, bounces=scene.layout.bounces)
        row = survey.least()
        row |= dict(zip(("paper_proximal", "paper_distal"), case.redesigned, strict=True))
        row |= {f"today_{pad}": value for pad, value in found.surveys[name].least().items()}
        row["ahead"] = sum(row[pad] - row[f"paper_{pad}"] for pad in OUTER) / 2
        row["px_per_mm"] = float(np.min(sharp.px_per_mm[..., 0]))
        found.redesigned.add(layers=name, **row)


def published(found: Measurements) -> Records:
    """Published worst coverage under layers inside and outside, beside that of two grids."""
    rows = Records()
    for name, case in CASES.items():
        if case.today is None:
            continue
        fine, coarse = (found.surveys[name].least(step) for step in (1, COARSE))
        for (pad, value), paper in zip(fine.items(), case.today, strict=True):
            off = {"difference": value - paper, "coarse_difference": coarse[pad] - paper}
            grid = {"worst": value, "coarse": coarse[pad], "paper": paper}
            rows.add(layers=name, reading=name.split()[-1], pad=pad, **grid, **off)
    return rows


def straight_field(scene: Scene) -> float:
    """Degrees between the rays to the far ends of the outer pads in the straight finger, in air."""
    camera = complex(*np.asarray(scene.camera.position).tolist())
    ends = np.asarray(scene.pads) @ [1, 1j]
    root, tip = ends[OUTER["proximal"], 0] - camera, ends[OUTER["distal"], 1] - camera
    return math.degrees(abs(np.angle(tip / root)))


def add_metrics(out: Report, finger: Finger, found: Measurements) -> None:
    """The study's numbers."""
    least = {name: survey.least() for name, survey in found.surveys.items()}
    rows, strips = published(found), found.strips
    inside, outside = (rows.where(reading=place) for place in ("inside", "outside"))
    whole = [np.nanmin(survey.coverage[..., 1]) for survey in found.surveys.values()]
    out.metrics(
        bare_worst=min(least["none"].values()),
        plate_proximal=least[PLATE]["proximal"],
        plate_distal=least[PLATE]["distal"],
        stack_proximal=least["3+2 mm"]["proximal"],
        stack_distal=least["3+2 mm"]["distal"],
        intermediate_worst=min(*map(float, whole), found.lenses.stat("min intermediate")),
        inside_difference=inside.stat("max_abs difference"),
        inside_coarse_difference=inside.stat("max_abs coarse_difference"),
        outside_difference=outside.stat("max_abs difference"),
        redesigned_ahead=found.redesigned.stat("min ahead") if len(found.redesigned) else None,
        strips=len(strips),
        strips_unexplained=int(np.sum(np.isnan(strips["formula_mm"]))),
        formula_worst_mm=strips.stat("max_abs difference_mm"),
        oracle_worst=found.checks.stat("max_abs difference"),
        straight_deg=straight_field(finger.scene()),
    )
    for projection in PROJECTIONS:
        own = found.lenses.where(projection=projection, in_section="long", layers="none")
        for side in ("long", "short"):
            name = f"{projection}_{side}_deg"
            out.metric(name, own.stat(f"min {side}_deg"), "field_deg", lens=projection, side=side)
        for pad in OUTER:
            name = f"{projection}_{pad}"
            out.metric(name, own.stat(f"min {pad}"), "sold", lens=projection, pad=pad)


def add_tables(out: Report, found: Measurements) -> None:
    """What is seen, what is lost and why, published numbers, shadows, lenses, checks."""
    seen = Records()
    for name, survey in found.surveys.items():
        for pad, index in OUTER.items():
            part, (pip, dip) = survey.coverage[..., index], survey.worst[index]
            joints = {"pip_deg": found.degrees[pip], "dip_deg": found.degrees[dip]}
            seen.add(layers=name, pad=pad, worst=np.nanmin(part), mean=np.nanmean(part), **joints)
    out.table("coverage", seen)
    out.table("strips", found.strips)
    out.table("published", published(found))
    if len(found.redesigned):
        out.table("redesigned", found.redesigned)
    shadows = Records()
    for name, (layers, paper) in SHADOWS.items():
        for air in (70.0, 80.0, 90.0):
            inside = math.degrees(math.asin(math.sin(math.radians(air)) / layers[-1][1]))
            width = shadow_width(layers, math.radians(air))
            angles = {"air_deg": air, "inside_deg": inside}
            own = paper if air == 70.0 else None
            shadows.add(layers=name, **angles, shadow_mm=width, paper_mm=own or math.nan)
    out.table("shadows", shadows)
    out.table("lenses", found.lenses)
    out.table("made", found.made)
    out.table("checks", found.checks)


def add_findings(out: Report, finger: Finger, found: Measurements) -> None:
    """Plain sentences, most important first."""
    out.say("bare", postures=len(found.degrees) ** 2)
    out.say("plate")
    for pad in OUTER:
        strip = found.strips.where(layers=PLATE, pad=pad)
        out.say(f"why-{pad}", **{name: cells.tolist()[0] for name, cells in dict(strip).items()})
    beyond = "2 mm, overhang beyond today's end"
    numbers = found.surveys["2 mm, overhang"].least()
    numbers |= {f"{pad}_beyond": value for pad, value in found.surveys[beyond].least().items()}
    out.say("overhang", **numbers, meeting=CASES[beyond].meeting_deg(finger))
    out.say("clear", **found.surveys["3 mm, clear ends"].least())
    own = published(found).where(reading="inside")
    least, most = (own.stat(f"{end} difference") for end in ("min", "max"))
    out.say("inside", least=least, most=most, meeting=CASES["3 mm outside"].meeting_deg(finger))
    acrylic, silicone = ([(3.0, index)] for index in (ACRYLIC, SILICONE))
    steep, flat = math.radians(70.0), math.radians(90.0)
    widths = {"acrylic": shadow_width(acrylic, steep), "flat": shadow_width(acrylic, flat)}
    out.say("shadows", **widths, silicone=shadow_width(silicone, steep))
    if len(found.redesigned):
        most, sharp = (found.redesigned.stat(of) for of in ("max ahead", "min px_per_mm"))
        out.say("redesigned", count=len(found.redesigned), most=most, sharp=sharp)
    for layers, key in ((PLATE, "plate"), ("none", "bare")):
        made = found.made.where(layers=layers)
        out.say(f"made-{key}", **dict(zip(made["pad"], made["p5"], strict=True)))
    out.say("lenses")
    short = found.lenses.where(in_section="short", layers="none")
    out.say("short", **{pad: short.stat(f"max {pad}") for pad in OUTER})


def add_figures(out: Report, found: Measurements) -> None:
    """Coverage over the joints' angles, the worst postures in section, lenses."""
    seen = Records()
    for name in SHOWN:
        coverage = found.surveys[name].coverage
        for pad, part in {"proximal": coverage[:, 0, 0], "distal": coverage[0, :, 2]}.items():
            own = {"layers": name, "pad": f"{pad} pad", "angle_deg": found.degrees}
            seen.add(**own, coverage_percent=100 * part)
    names = {"angle_deg": "PIP or DIP (°)", "coverage_percent": "coverage (%)"}
    by = {"by": "layers", "panel": "pad", "names": names}
    drawing = plots.lines(seen, "angle_deg", "coverage_percent", **by)
    for line in (line for axes in drawing.axes for line in axes.lines):
        line.set_markevery(max(len(found.degrees) // MARKED, 1))
    out.figure("coverage", drawing, most=4)
    out.figure("worst", draw_worst(found))
    sold = Records()
    for name, own in found.lenses.where(in_section="long").group("layers").items():
        for pad in OUTER:
            fields = zip(own["projection"], own["long_deg"], strict=True)
            labels = [f"{projection}, {field:.0f}°" for projection, field in fields]
            sold.add(
                lens=labels,
                case=f"{pad}, {'in air' if name == 'none' else name}",
                worst_coverage_percent=100 * own[pad],
            )
    out.figure("lenses", plots.bars(sold, "lens", "worst_coverage_percent", by="case"))


def draw_worst(found: Measurements) -> Figure:
    """The section under `PLATE` in the worst posture of each outer pad, with what is lost."""
    survey = found.surveys[PLATE]
    poses = [np.deg2rad(found.degrees[list(survey.worst[pad])]) for pad in OUTER.values()]
    views = [survey.views[pad] for pad in OUTER.values()]
    stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *views)
    drawing = poses_figure(survey.scene, np.stack(poses), stacked, labels=False)
    tables = plain_tables(survey.scene)
    for axes, (pad, index) in zip(drawing.axes, OUTER.items(), strict=True):
        strip = found.strips.where(layers=PLATE, pad=pad)
        posed = posed_tables(tables, {"pip": strip["pip_deg"][0], "dip": strip["dip_deg"][0]})
        start, end = ends_of(posed["pads"][index])
        along = (end - start) / abs(end - start)
        middle = start + along * (strip["from_mm"][0] + strip["to_mm"][0]) / 2
        text = f"{strip['lost_mm'][0]:.1f} mm lost"
        arrow = {"arrowstyle": "->", "color": "black"}
        away = middle - TEXT_MM * 1j * along
        spot, words = (middle.real, middle.imag), (away.real, away.imag)
        axes.annotate(text, spot, words, arrowprops=arrow, ha="center", va="center")
    return drawing
