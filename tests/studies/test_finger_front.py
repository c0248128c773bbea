"""Fronts of fingers: who beats whom, where each design begins, and what is refused."""

from __future__ import annotations

import inspect
from contextlib import nullcontext
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from designopt import cli
from designopt.study.records import Records
from designopt.study.study import Context
from studies.finger.designing import Designer
from studies.finger.front import FingerFrontSpec
from studies.finger.front import run as front
from studies.finger.spec import FingerSpec
from tests.commands import check_command_refused

CONTEXT = Context(0, "float64", lambda _: nullcontext())


def test_those_on_the_front_are_those_of_a_sorted_sweep():
    """Of two objectives: by falling first one, each that has more of the second than all before."""
    generator = np.random.default_rng(2)
    for _ in range(50):
        sharp, often = generator.uniform(0, 1, (2, 30))
        missed = np.where(generator.uniform(size=30) < 0.2, "blur", "")
        rows = Records({"resolution_px_per_mm": sharp, "yield": often, "missed": missed})
        wanted, most = set(), -np.inf
        for row in np.argsort(-sharp):
            if missed[row] == "" and often[row] > most:
                wanted.add(int(row))
                most = often[row]
        found = front.is_best(rows, ["resolution", "yield"])
        assert set(np.flatnonzero(found).tolist()) == wanted


def test_less_thickness_is_better():
    rows = Records({"thickness_mm": [22.0, 25.0], "transmission_deg": [40.0, 40.0], "missed": ""})
    assert front.is_best(rows, ["thickness", "transmission"]).tolist() == [True, False]


@pytest.fixture
def misses(monkeypatch):
    """What a finger misses, by its settings and those it was designed from; nothing by default."""
    found = {}
    monkeypatch.setattr(front.Point, "missed", lambda point, _: found.get(id(point.linkage), []))
    return found


class Recorder(Designer):
    """Records where designs begin."""

    def __init__(self) -> None:
        super().__init__(CONTEXT)
        self.begun: list[tuple[float, float]] = []

    def linkage_from(self, spec: Any, start: Any, known: Any) -> Any:
        self.begun.append((spec.linkage.limits.clearance, start.linkage.limits.clearance))
        return known

    def mirrors_from(self, spec: Any, start: Any, known: Any) -> Any:
        del spec, start
        return known


def first_point(sharp: float = 6.0) -> front.Point:
    verdict = SimpleNamespace(worst_px_per_mm=sharp, worst_coverage=1.0)
    linkage: Any = SimpleNamespace(verdict=SimpleNamespace(least_deg=42.0))
    mirrors: Any = SimpleNamespace(verdict=verdict)
    share: Any = SimpleNamespace(value=0.99)
    return front.Point(FingerSpec(), linkage, mirrors, share)


@pytest.mark.usefixtures("misses")
def test_designs_begin_with_their_neighbours_from_the_first_outwards():
    designer = Recorder()
    spec = FingerFrontSpec(clearances=[0.25, 0.5, 0.75, 1.0])
    found = front.find_points(spec, first_point(), designer)
    asked = [changed["linkage.limits.clearance"] for changed, _ in found]
    assert asked == [0.25, 0.5, 0.75, 1.0]
    assert [point.values["clearance"] for _, point in found if point] == asked
    # 0.5 mm is the default: it begins with itself, the others with the one next to them.
    assert dict(designer.begun) == {0.5: 0.5, 0.25: 0.5, 0.75: 0.5, 1.0: 0.75}


@pytest.mark.parametrize(
    ("changed", "searched"),
    [
        ({"mirrors": {"floor": 4.0, "least_yield": 0.9}}, False),
        ({"mirrors": {"pads": {"thickness": [0.5, 0.5]}}}, True),
        ({"mirrors": {"camera": {"max_blur_px": 9.0}}}, True),
        ({"body": {"thickness": 26.0}}, True),
    ],
)
def test_a_finger_with_other_parts_is_designed_though_the_one_at_hand_meets_all(
    monkeypatch, changed, searched
):
    """Thinner layers would otherwise have the thicker ones' finger."""
    start, spec, fresh = FingerSpec(), FingerSpec.model_validate(changed), object()
    trial = SimpleNamespace(placement=None)
    known: Any = SimpleNamespace(trials=[trial], chosen=0), SimpleNamespace(value=1.0)
    monkeypatch.setattr("studies.finger.designing.missed_by_mirrors", lambda *_: [])
    monkeypatch.setattr(Designer, "_searched", lambda *_: fresh)
    from_it = inspect.unwrap(Designer.mirrors_from)  # its annotations are of real designs
    found = from_it(Designer(CONTEXT), spec, start, known)
    assert found is (fresh if searched else known)


@pytest.mark.usefixtures("misses")
def test_settings_that_are_refused_are_no_point():
    spec = FingerFrontSpec(objectives=["coverage", "thickness"], thickness_changes=[-20.0, 0.0])
    found = front.find_points(spec, first_point(), Recorder())
    assert [point is None for _, point in found] == [True, False]
    assert [changed for changed, _ in found] == [{"body.thickness": 5.0}, {"body.thickness": 25.0}]


def test_what_went_astray_is_searched_once_more_from_a_neighbour_that_misses_less(misses):
    """At 23 mm the search from the thicker finger fails, that from more clearance does not."""

    class Astray(Recorder):
        def linkage_from(self, spec: Any, start: Any, known: Any) -> Any:
            own = SimpleNamespace(verdict=known.verdict)
            at, begun = (
                (one.body.thickness, one.linkage.limits.clearance) for one in (spec, start)
            )
            asked.append((at, begun))
            lost = (at, begun) == ((23.0, 0.25), (25.0, 0.25))
            misses[id(own)] = ["a", "b"] if lost else ["blur"] if at[0] == 23.0 else []
            kept.append(own)
            return own

    kept: list[Any] = []
    asked: list[Any] = []
    spec = FingerFrontSpec(
        objectives=["transmission", "clearance", "thickness"],
        thickness_changes=[-2.0, 0.0],
        clearances=[0.25, 0.5],
    )
    found = front.find_points(spec, first_point(), Astray())
    assert [len(point.missed(spec.objectives)) for _, point in found if point] == [1, 0, 1, 0]
    assert asked[-1] == ((23.0, 0.25), (23.0, 0.5))
    assert len(asked) == 5


@pytest.mark.usefixtures("misses")
def test_two_settings_make_a_grid_and_resolutions_are_parts():
    spec = FingerFrontSpec(
        objectives=["yield", "resolution", "layers"], sharper=[1.0, 1.5], thicker_layers=[0.5, 1.0]
    )
    found = front.find_points(spec, first_point(4.0), Recorder())
    assert [tuple(changed.values()) for changed, _ in found] == [
        (4.0, [0.5, 0.5]),
        (4.0, [1.0, 1.0]),
        (6.0, [0.5, 0.5]),
        (6.0, [1.0, 1.0]),
    ]


@pytest.mark.parametrize(
    ("objectives", "words"),
    [
        (["transmission", "yield"], "name at least one of clearance"),
        (["clearance", "thickness"], "one of transmission, yield, coverage"),
        (["clearance", "clearance"], "differ"),
        (["clearance"], "at least 2"),
        (["beauty", "clearance"], "'transmission'"),
    ],
)
def test_objectives_that_are_no_trade_off_are_refused(objectives, words):
    with pytest.raises(ValidationError, match=words):
        FingerFrontSpec.model_validate({"objectives": objectives})


def test_layers_of_bare_pads_are_refused():
    bare = {"pads": {"thickness": [], "index": []}}
    with pytest.raises(ValidationError, match="bare pads"):
        FingerFrontSpec.model_validate({"objectives": ["coverage", "layers"], "mirrors": bare})


def test_the_command_runs_the_study_with_its_objectives(monkeypatch, tmp_path):
    asked = {}

    def run(study, spec, **given):
        asked.update(given, study=study.name, spec=spec)
        return SimpleNamespace(metrics=(), findings=(), waived="", unmet=())

    monkeypatch.setattr("designopt.study.runner.run", run)
    (tmp_path / "my.toml").write_text("[body]\nthickness = 24.0\n", encoding="utf-8")
    words = ["front", "finger", "--objectives", "yield, resolution", "--seed", "3"]
    more = ["--config", str(tmp_path / "my.toml"), "--out", str(tmp_path / "new")]
    assert cli.run([*words, *more]) == 0
    assert (asked["study"], asked["seed"]) == ("finger-front", 3)
    assert asked["spec"].objectives == ["yield", "resolution"]
    assert asked["spec"].finger() == FingerSpec.model_validate({"body": {"thickness": 24.0}})


def test_studies_without_trade_offs_are_refused(capsys):
    words = ["'table1' has no trade-offs", "finger"]
    check_command_refused(capsys, "front table1 --objectives a,b", words)
    check_command_refused(capsys, "front finger --objectives a", ["objectives"])
    check_command_refused(capsys, "front fingr --objectives a,b", ["did you mean 'finger'"])


def test_the_figure_has_fingers_off_the_front_and_joins_none_of_them():
    rows = Records(
        {
            "resolution_px_per_mm": [3.0, 4.0, 3.5, 5.0],
            "yield": [0.9, 0.8, 0.7, 0.99],
            "missed": ["", "", "", "blur"],
        }
    )
    best = front.is_best(rows, ["yield", "resolution"])
    rows = rows | {"front": np.where(best, "yes", "no")}
    (axis,) = front.draw_front(rows, ["yield", "resolution"]).axes
    joined, worse, missing, *_ = axis.lines
    np.testing.assert_array_equal(joined.get_xydata(), [[3.0, 0.9], [4.0, 0.8]])
    np.testing.assert_array_equal(worse.get_xydata(), [[3.5, 0.7]])
    np.testing.assert_array_equal(missing.get_xydata(), [[5.0, 0.99]])
    labels = axis.get_legend_handles_labels()[1]
    assert labels == ["on the front", "worse than another", "misses a requirement besides"]
