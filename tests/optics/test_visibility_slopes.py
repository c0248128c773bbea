"""How views move: derivatives against central differences, and what the labels of ends name."""

from typing import NamedTuple

import jax
import numpy as np
import pytest

from optics.visibility import boundary_codes as codes
from optics.visibility.boundary_codes import parts_of
from tests.optics.scenes import (
    MIRRORS,
    WORDS,
    Case,
    answers,
    answers_traced,
    batch_of,
    case_of,
    item,
    random_cases,
    shapes,
)

STEPS = 3e-6, 1e-6
"""Two steps of central differences. At a kink, and where a view turns up, the two differ."""

AGREEMENT = 1e-6
"""What truncation and rounding may leave between the two, of the scale of all slopes of a scene."""

SLOPES = 2 * AGREEMENT
"""Truncation falls ninefold from the first step to the second, and rounding grows threefold, so
the second is as close to the derivative as the two are to each other."""

TIE = 1e-3
"""Pieces that begin nearer than this may change places as the scene moves."""


def flat(cases: Case) -> np.ndarray:
    """All numbers of each case in a row."""
    return np.concatenate([np.reshape(leaf, (len(cases.direction), -1)) for leaf in cases], axis=1)


def like(cases: Case, rows: np.ndarray) -> Case:
    """Cases from their numbers: the inverse of `flat`."""
    sizes = [np.size(leaf) // len(leaf) for leaf in cases]
    parts = np.split(rows, np.cumsum(sizes)[:-1], axis=1)
    leaves = zip(parts, cases, strict=True)
    return Case(*(part.reshape(-1, *np.shape(leaf)[1:]) for part, leaf in leaves))


def rich_cases(seed: int, count: int) -> Case:
    """Of many random scenes those with the most, and most often reflected, views; without ties."""
    cases = random_cases(seed, 20 * count)
    pieces = answers(cases).pieces
    starts = np.where(pieces.present, pieces.start, np.inf)
    with np.errstate(invalid="ignore"):
        near = np.diff(starts, axis=-1) < TIE
    tied = (near & (starts[..., 1:] > 0)).any(axis=(1, 2))
    worth = np.where(pieces.present, 1 + np.array([len(w) for w in WORDS])[pieces.path], 0)
    order = np.argsort(np.where(tied, 0, -worth.sum(axis=(1, 2))))
    return item(cases, order[:count])


@pytest.mark.parametrize(
    ("seed", "count"), [(20, 3), pytest.param(21, 96, marks=pytest.mark.nightly)]
)
def test_derivatives_of_all_results(seed, count):
    cases = rich_cases(seed, count)
    rng, names, rows = np.random.default_rng(seed), list(shapes()), flat(cases)
    weights = {name: rng.normal(size=(count, *shape)) for name, shape in shapes().items()}
    moves = np.eye(rows.shape[1])[:, None]

    def totals(rows: np.ndarray) -> dict[str, np.ndarray]:
        """The weighted sum of every result."""
        numbers = answers(like(cases, rows)).numbers
        axes = {name: tuple(range(1, 1 + len(shape))) for name, shape in shapes().items()}
        repeated = {name: np.resize(weights[name], numbers[name].shape) for name in names}
        return {name: (repeated[name] * numbers[name]).sum(axes[name]) for name in names}

    quotients = []
    for step in STEPS:
        ahead, behind = (
            totals((rows + move * moves).reshape(-1, rows.shape[1])) for move in (step, -step)
        )
        differences = {name: (ahead[name] - behind[name]) / (2 * step) for name in names}
        quotients.append({name: d.reshape(-1, count).T for name, d in differences.items()})
    for name in names:
        slopes = flat(answers(cases, {name: weights[name]}).slopes)
        scale = np.maximum(1, np.abs(slopes).max(axis=1, keepdims=True))
        first, second = (quotient[name] / scale for quotient in quotients)
        agree = np.abs(first - second) < AGREEMENT
        assert agree.mean() > 0.9, name
        assert (np.abs(slopes / scale - second)[agree] < SLOPES).all(), name
        assert np.median(np.abs(slopes).max(axis=1)) > 0.1, name


@pytest.mark.nightly  # which compiles as users compile
def test_optimised_programs_say_the_same():
    cases = rich_cases(25, 16)
    rng = np.random.default_rng(0)
    weights = {name: rng.normal(size=(16, *shape)) for name, shape in shapes().items()}
    found = answers(cases, weights)
    jax.config.update("jax_disable_most_optimizations", True)
    try:
        wanted = jax.jit(lambda *given: answers_traced(*given))(cases, weights)
    finally:
        jax.config.update("jax_disable_most_optimizations", False)
    for name, number in wanted.numbers.items():
        np.testing.assert_allclose(found.numbers[name], number, rtol=1e-9, atol=1e-9)
    scale = np.abs(flat(wanted.slopes)).max(axis=1, keepdims=True)
    np.testing.assert_allclose(flat(found.slopes) / scale, flat(wanted.slopes) / scale, atol=1e-9)


def test_derivatives_are_finite_even_where_scenes_degenerate():
    """Surfaces that coincide or lie on lines with others are in ``visibility-stability``."""

    def under(direction: float, field_of_view: float, grazing: float = 0.0) -> Case:
        """A pad under a mirror."""
        pad, mirror = {"both": [[-1, 0], [1, 0]]}, {"both": [[-1, 2], [1, 2]]}
        camera = (0, 1), direction, field_of_view
        return case_of(*camera, mirrors=mirror, pads=pad, grazing=grazing)

    views = [under(turn, fov) for turn in (0, 2) for fov in (0, np.pi, 2 * np.pi)]
    limited = [under(0, 3, grazing=least) for least in (0, np.pi / 4, np.pi / 2)]
    cases = batch_of([case_of((0, 1)), *views, *limited])
    count = len(cases.direction)
    for name, shape in shapes().items():
        found = answers(cases, {name: np.ones((count, *shape))})
        assert all(np.isfinite(number).all() for number in found.numbers.values())
        assert np.isfinite(flat(found.slopes)).all(), name
        assert not found.ok[0].any()


class Named(NamedTuple):
    """One end of a piece: which, and what its label names.

    Attributes:
        at: indices of its case, pad and place among the pieces.
        last: whether it is the piece's second end.
        label: its label.
    """

    at: tuple[int, int, int]
    last: bool
    label: int

    @property
    def surface(self) -> int:
        return parts_of(self.label)[1]

    @property
    def kind(self) -> int:
        """The label itself where it names no surface."""
        return self.label if self.label < 0 else parts_of(self.label)[2]


FIELDS = {
    codes.LEFT_LIMIT: "field_of_view",
    codes.RIGHT_LIMIT: "field_of_view",
    codes.LOW_GRAZING: "grazing",
    codes.HIGH_GRAZING: "grazing",
}
ENDS = {
    codes.FIRST_END: [0],
    codes.SECOND_END: [1],
    codes.CROSSING: [0, 1],
    codes.CUT_BEFORE: [0, 1],
    codes.CUT_AFTER: [0, 1],
}

MOVE = 1e-6
"""By how much numbers are changed to see what moves."""

MOVED, STILL = 1e-9, 1e-13
"""Ends move in proportion to what they follow; others only as rounding changes."""


def ends_by_kind(cases: Case, most: int) -> dict[int, list[Named]]:
    """Ends of pieces for every kind of label."""
    pieces = answers(cases).pieces
    found: dict[int, list[Named]] = {}
    for scene, pad, place in np.argwhere(pieces.end - pieces.start > TIE).tolist():
        at = scene, pad, place
        for last, labels in enumerate((pieces.start_label, pieces.end_label)):
            end = Named(at, bool(last), int(labels[at]))
            found.setdefault(end.kind, []).append(end)
    return {kind: ends[:most] for kind, ends in found.items()}


def none_of(case: Case) -> Case:
    return jax.tree.map(lambda leaf: np.zeros(np.shape(leaf), bool), case)


def named_by(case: Case, end: Named) -> Case:
    """Which numbers of a case an end's label names."""
    chosen = none_of(case)
    if end.kind in FIELDS:
        index = end.at[1] if FIELDS[end.kind] == "grazing" else ()
        getattr(chosen, FIELDS[end.kind])[index] = True
    else:
        chosen.ends[end.surface, ENDS[end.kind]] = True
    return chosen


def others_than(case: Case, end: Named, path: int) -> Case:
    """Which numbers neither its label names nor its path and its pad have to do with."""
    chosen, named = none_of(case), named_by(case, end)
    limited = end.kind in (codes.LEFT_LIMIT, codes.RIGHT_LIMIT)
    for name in ("ends", "grazing", *([] if limited else ["direction", "field_of_view"])):
        getattr(chosen, name)[...] = ~getattr(named, name)
    chosen.ends[[*WORDS[path], MIRRORS + end.at[1]]] = False
    return chosen


def test_an_end_moves_with_what_its_label_names_and_with_nothing_else():
    cases, rng = random_cases(26, 128), np.random.default_rng(0)
    pieces = answers(cases).pieces
    by_kind = ends_by_kind(cases, 8)
    for kind, place in ((codes.FIRST_PAD_END, 0), (codes.SECOND_PAD_END, 1)):
        for end in by_kind.pop(kind):
            assert (pieces.end if end.last else pieces.start)[end.at] == place
    assert set(by_kind) == {*FIELDS, *ENDS}

    def moved(chosen: Case, case: Case) -> Case:
        """Some numbers of a case increased."""
        return jax.tree.map(
            lambda leaf, which: leaf + MOVE * which * rng.uniform(0.5, 1, np.shape(leaf)),
            case,
            chosen,
        )

    ends = [end for same in by_kind.values() for end in same]
    named, others = [], []
    for end in ends:
        case, path = item(cases, end.at[0]), int(pieces.path[end.at])
        named.append(moved(named_by(case, end), case))
        others.append(moved(others_than(case, end, path), case))

    def distances(variants: list[Case]) -> np.ndarray:
        """How far each end has moved."""
        now = answers(batch_of(variants)).pieces
        found = []
        for i, end in enumerate(ends):
            before = (pieces.end if end.last else pieces.start)[end.at]
            after = (now.end if end.last else now.start)[i, end.at[1]]
            same = now.present[i, end.at[1]] & (now.path[i, end.at[1]] == pieces.path[end.at])
            found.append(np.abs(after - before)[same].min())
        return np.array(found)

    assert (distances(named) > MOVED).all()
    assert (distances(others) < STILL).all()
