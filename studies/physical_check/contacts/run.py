"""The study itself: from its spec to its results."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import UInt8

from designopt import Context, Records, Report, Results
from designopt.study import plots
from designopt.user_folders import cache_folder
from optics import parse_scene
from optics.rendering import Effects
from perception import View
from perception.contacts import Contact, Lamp, find_contacts, fuse_contacts, has_fine_colors
from perception.places import Sight, find_sight
from studies.image_check.cases import EVEN, Finger, nominal, plain, pose_of, with_lamps
from studies.models.one_thread import one_thread
from studies.models.path_tracer import require_mitsuba
from studies.models.sensor.finger_sensor import FingerSensor
from studies.models.sensor.light import LampTable, LightTable
from studies.models.sensor.made import deviations_of
from studies.models.sensor.spec import WIDTH
from studies.oracles.judge import contacts as judge
from studies.oracles.judge.photograph import photograph
from studies.oracles.judge.solids import FOOT, GAP, TOP
from studies.physical_check.contacts import ContactCheckSpec
from studies.physical_check.contacts.cases import fingers

FOLDER = "physical-check-contacts"
"""Of pictures, in the user's cache."""

FUSED = "fused"
"""Path of what several views give together."""

COORDINATES = ("along", "across", "diameter")
"""Of what is measured of a contact."""

FLATNESS = (0.5, 1.0, 2.0)
"""Bounds of slopes of rays: how far what is lifted by 1 mm seems moved."""

GAMMAS = (1.0, 2.2)
"""Of rendered pairs."""


class Seen(NamedTuple):
    """A view of a pad, unwarped."""

    view: View
    picture: UInt8[np.ndarray, "along across 3"]
    sight: Sight

    @property
    def name(self) -> tuple[str, str]:
        """Pad and path."""
        return self.view.pad, self.view.path

    @property
    def slope(self) -> float:
        """Of the ray that shows the pad's middle."""
        middle = self.sight.slopes[tuple(np.array(self.sight.slopes.shape[:2]) // 2)]
        return float(np.hypot(*middle))


def run(spec: ContactCheckSpec, context: Context) -> Results:
    """Photograph fingers with Mitsuba, find contacts, compare with what is pressed in.

    Raises:
        UserError: Mitsuba is not installed, or another float type than float64.
    """
    context.require_float64("physical-check-contacts compares with a path tracer")
    require_mitsuba("physical-check-contacts")
    folder = cache_folder(spec.cache, FOLDER)
    # Those of the finger with everything: the others have fewer errors.
    scene = parse_scene(nominal("3 mm, pupil"), "finger")
    deviations = plain(deviations_of(spec.tolerances, scene))
    contacts, untouched, pairs = Records(), Records(), Records()
    tried = [*fingers(spec, deviations, context.seed)]
    for finger in context.each(
        tried, lambda one: f"Finger {one.number}: {one.light}, layers: {one.layers}"
    ):
        photos = [
            photograph(finger.tables, finger.errors, pose_of(angles), capture, number, folder)
            for number, (angles, capture) in enumerate(
                zip(finger.poses, finger.captures, strict=True)
            )
        ]
        add_finger(spec, finger, [one.pixels for one in photos], contacts, untouched)
        # Compiled programs of all kinds of layers together exceed what a process may map.
        jax.clear_caches()
    with context.step("Rendered pairs of untouched pads"):
        add_pairs(spec, context.seed, pairs)
    return report(spec, contacts, untouched, pairs)


def report(
    spec: ContactCheckSpec, contacts: Records, untouched: Records, pairs: Records
) -> Results:
    """What is reported of contacts, of untouched pads, and of rendered pairs."""
    out = Report(spec, package=__package__)
    add_metrics(out, spec, contacts, untouched, pairs)
    for name in ("found", "missed", "false", "deviations"):
        out.say(name)
    add_tables(out, contacts)
    views = contacts.where((contacts["path"] != FUSED) & contacts["found"])
    ratios = np.stack([views[f"{name}_ratio"] for name in COORDINATES])
    shown = Records({"ratio": ratios.ravel(), "of": np.repeat(COORDINATES, len(views))})
    names = {"ratio": "error over deviation"}
    out.figure("errors", plots.ecdf(shown, "ratio", by="of", names=names))
    return out.results()


def sensor_of(spec: ContactCheckSpec, light: str, layers: str) -> FingerSensor:
    """The finger as designed, seen through its layers or past its lamps."""
    lamps = light != EVEN and layers == "none"
    scene = parse_scene(with_lamps(nominal(layers)) if lamps else nominal(layers), "finger")
    return FingerSensor.of_scene(scene, WIDTH, deviations_of(spec.tolerances, scene))


def lamps_of(finger: Finger, pad: str) -> list[Lamp | None]:
    """The lamps of a pad, red, green and blue."""
    if finger.light == EVEN:
        return []
    (own,) = (one for one in finger.tables["pads"] if one["name"] == pad)
    thickness = sum(layer["thickness"] for layer in own.get("layers", []))
    # The surface of layers mirrors their lamp; across the section their walls are black.
    low, high, gap = (0.0, 2 * thickness, 0.0) if thickness else (FOOT, TOP, GAP)
    red, green, blue = (
        LampTable(beside=side, gap=gap, low=low, high=high) for side in ("right", "from", "left")
    )
    light = LightTable(red=red, green=None if thickness else green, blue=blue)
    return light.lamps(math.dist(own["from"], own["to"]), WIDTH)


def see(sensor: FingerSensor, pixels: UInt8[np.ndarray, "rows columns 3"]) -> list[Seen]:
    """The complete views in a picture, unwarped."""
    sighting = sensor.detect(pixels)
    places = sensor.find_places(sighting)
    found = []
    for view in sighting.complete():
        places_of = places.get((view.pad, view.path))
        if places_of is not None:
            sight = find_sight(places_of, sensor.catalog.lengths[view.pad], sensor.width)
            found.append(Seen(view, sensor.unwarp(pixels, view, places_of), sight))
    return found


def add_finger(
    spec: ContactCheckSpec,
    finger: Finger,
    pictures: Sequence[UInt8[np.ndarray, "rows columns 3"]],
    contacts: Records,
    untouched: Records,
) -> None:
    """Find contacts in a finger's pictures; add what is found, missed and false."""
    gamma = finger.captures[0].gamma
    sensor = sensor_of(spec, finger.light, finger.layers).with_response(gamma)
    seen = [see(sensor, pixels) for pixels in pictures]
    where = {"finger": finger.number, "light": finger.light, "layers": finger.layers}
    for frame in range(spec.references, len(seen)):
        by_view: dict[tuple[str, str], tuple[Seen, list[Contact]]] = {}
        truth, fine = finger.captures[frame].contacts, has_fine_colors(pictures[frame])
        # What is nearest in its pose is most alike.
        order = np.argsort(
            np.linalg.norm(finger.poses[: spec.references] - finger.poses[frame], axis=1)
        )
        for one in seen[frame]:
            references = (other for i in order for other in seen[i] if other.name == one.name)
            reference = next(references, None)
            if reference is None:
                continue
            lamps = lamps_of(finger, one.view.pad)
            with one_thread():
                start = time.perf_counter()
                found = find_contacts(
                    one.picture,
                    reference.picture,
                    one.view,
                    one.sight,
                    lamps,
                    sensor.lens.response,
                    fine=fine,
                )
                seconds = time.perf_counter() - start
            own = where | {"frame": frame, "pad": one.view.pad, "path": one.view.path}
            own |= {"slope": one.slope, "seconds": seconds}
            if truth:
                by_view[one.name] = one, found
                add_contacts(contacts, own, of_pad(truth, one.view.pad), found)
            else:
                untouched.add(**own, claimed=len(found))
        for pad in {name[0] for name in by_view}:
            both = [found for (own, _), (_, found) in by_view.items() if own == pad]
            if len(both) > 1:
                own = where | {"frame": frame, "pad": pad, "path": FUSED}
                own |= {"slope": np.nan, "seconds": np.nan}
                add_contacts(contacts, own, of_pad(truth, pad), fuse_contacts(both))


def of_pad(truth: Sequence[judge.Contact], pad: str) -> list[judge.Contact]:
    """What is pressed into a pad."""
    return [one for one in truth if one.pad == pad]


def add_contacts(
    records: Records,
    where: Mapping[str, Any],
    truth: Sequence[judge.Contact],
    found: Sequence[Contact],
) -> None:
    """Add what is there and found, there and missed, and claimed where nothing is.

    What is found is that of the nearest thing whose contact its center is in.
    """
    for there, claimed in matched(truth, found):
        row = dict(where) | {"there": there is not None, "found": False}
        row |= {"kind": "none" if there is None else there.kind, "views": 0}
        row |= dict.fromkeys(("true_mm", "depth_mm", "center_mm", "strength"), np.nan)
        errors = deviations = np.full(3, np.nan)
        if there is not None:
            row |= {"true_mm": 2 * there.edge, "depth_mm": there.depth}
        if claimed is not None:
            row |= {"views": len(claimed.paths), "strength": claimed.strength}
        if there is not None and claimed is not None:
            errors = claimed.measured - [there.along, there.across, 2 * there.edge]
            deviations = claimed.deviations
            row |= {"found": True, "center_mm": math.hypot(*errors[:2])}
        for name, error, deviation in zip(COORDINATES, errors, deviations, strict=True):
            row |= {f"{name}_mm": error, f"{name}_ratio": error / deviation}
        records.add(**row)


def matched(
    truth: Sequence[judge.Contact], found: Sequence[Contact]
) -> Iterator[tuple[judge.Contact | None, Contact | None]]:
    """What is there beside what is claimed, nearest first; ``None`` for either."""
    left, claims = list(truth), list(found)
    near = sorted(
        (math.hypot(claim.center[0] - there.along, claim.center[1] - there.across), i, j)
        for i, there in enumerate(truth)
        for j, claim in enumerate(found)
    )
    for distance, i, j in near:
        if distance < truth[i].edge and truth[i] in left and found[j] in claims:
            left.remove(truth[i])
            claims.remove(found[j])
            yield truth[i], found[j]
    yield from ((there, None) for there in left)
    yield from ((None, claim) for claim in claims)


def add_pairs(spec: ContactCheckSpec, seed: int, pairs: Records) -> None:
    """Find contacts between rendered pictures of untouched pads at different joint angles."""
    generator = np.random.default_rng([seed, 1])
    scene = parse_scene(nominal("none"), "finger")
    bare = FingerSensor.of_scene(scene, WIDTH, deviations_of(spec.tolerances, scene))
    number = 0
    while len(pairs) < spec.pairs:
        effects = Effects(
            gamma=GAMMAS[number % len(GAMMAS)],
            vignetting=0.2,
            blur=float(generator.uniform(0.4, 0.8)),
            noise=0.01,
            jpeg=10,
        )
        renderer = bare.made_renderer(effects, seed, number)
        sensor = bare.with_response(effects.gamma)
        poses = np.deg2rad(generator.uniform(0, 90, (2, 2)))
        before, after = (
            {one.name: one for one in see(sensor, renderer.render(pose, frame=frame).pixels)}
            for frame, pose in enumerate(poses)
        )
        for name in before.keys() & after.keys():
            one = after[name]
            found = find_contacts(
                one.picture, before[name].picture, one.view, one.sight, [], sensor.lens.response
            )
            pairs.add(finger=number, pad=name[0], path=name[1], claimed=len(found))
        number += 1


def statistics(own: Records) -> dict[str, float]:
    """Errors of contacts that are found, and of what is there, how much that is."""
    there, found = own.where(there=True), own.where(found=True)
    ratios = [found[f"{name}_ratio"] for name in COORDINATES]
    return {
        "contacts": len(there),
        "found": there.stat("share found"),
        "false": len(own.where(there=False)) / max(len(there), 1),
        "center_median_mm": found.stat("median center_mm"),
        "center_p95_mm": found.stat("p95 center_mm"),
        "center_worst_mm": found.stat("max center_mm"),
        "diameter_median_mm": found.stat("median_abs diameter_mm"),
        "diameter_p95_mm": found.stat("p95_abs diameter_mm"),
        "diameter_worst_mm": found.stat("max_abs diameter_mm"),
        "ratio": float(np.sqrt(np.mean(np.square(ratios)))) if len(found) else np.nan,
    }


def add_metrics(
    out: Report, spec: ContactCheckSpec, contacts: Records, untouched: Records, pairs: Records
) -> None:
    """The study's numbers."""
    views = contacts.where(contacts["path"] != FUSED)
    fused = contacts.where(contacts["views"] > 1)
    lit = views["light"] != EVEN
    out.metrics(pictures=spec.fingers * spec.pressed, contacts=len(views.where(there=True)))
    for light, own in (("even", views.where(~lit)), ("lamps", views.where(lit))):
        found = statistics(own)
        out.metrics(
            **{
                f"found_{light}": found["found"],
                f"false_{light}": found["false"],
                f"center_median_{light}_mm": found["center_median_mm"],
                f"center_p95_{light}_mm": found["center_p95_mm"],
                f"center_worst_{light}_mm": found["center_worst_mm"],
                f"diameter_median_{light}_mm": found["diameter_median_mm"],
                f"diameter_p95_{light}_mm": found["diameter_p95_mm"],
                f"diameter_worst_{light}_mm": found["diameter_worst_mm"],
                f"ratio_{light}": found["ratio"],
            }
        )
    both = statistics(fused)
    out.metrics(
        fused_center_p95_mm=both["center_p95_mm"],
        fused_diameter_p95_mm=both["diameter_p95_mm"],
        fused_ratio=both["ratio"],
    )
    out.metrics(
        untouched=len(untouched),
        untouched_false=int(untouched.stat("sum claimed")) if len(untouched) else 0,
        pairs=len(pairs),
        pairs_false=int(pairs.stat("sum claimed")) if len(pairs) else 0,
    )
    times = [
        own["seconds"][0] / max(1, int(own["found"].sum()))
        for own in views.group("finger", "frame", "pad", "path").values()
        if own["found"].any()
    ]
    quiet = untouched.where(claimed=0)["seconds"] if len(untouched) else [np.nan]
    out.metrics(
        contact_ms=1e3 * float(np.median(times)) if times else np.nan,
        untouched_ms=1e3 * float(np.median(quiet)),
    )


def add_tables(out: Report, contacts: Records) -> None:
    """Errors by light and layers, flatness of the view, and what is pressed in; all contacts."""
    columns = {name: _of(name) for name in statistics(contacts)}
    seen = np.where(contacts["path"] != FUSED, "one", "several")
    out.table("lights", (contacts | {"by": seen}).summary("light", "layers", "by", **columns))
    views = contacts.where(contacts["path"] != FUSED)
    steps = np.array((0.0, *FLATNESS))[np.digitize(views["slope"].astype(float), FLATNESS)]
    out.table("flatness", (views | {"from_slope": steps}).summary("from_slope", **columns))
    out.table("kinds", views.where(there=True).summary("kind", **columns))
    out.table("contacts", contacts)


def _of(name: str) -> Any:
    return lambda own: statistics(own)[name]
