"""The study ``bending-posture``: a quick run end to end, and its pieces."""

import dataclasses
import json
import math
from pathlib import Path

import numpy as np
import pytest

from designopt.cli import run as command
from designopt.errors import UserError
from designopt.study.results import PrecisionRow
from perception.chamber import ChamberStatus
from perception.posture import PostureEstimator, find_posture
from studies.bending_posture import elsewhere, trainings
from studies.bending_posture import run as running
from studies.bending_posture.elsewhere import LAMP, Elsewhere
from studies.bending_posture.found import AtEta, Found
from studies.bending_posture.odd import AtBend, Odd
from studies.bending_posture.spec import BendingPostureSpec
from studies.bending_posture.statements import claims, findings, metrics
from studies.bending_posture.trainings import (
    EQUAL,
    KEPT,
    L2_LENGTHS,
    L2_MM,
    L2_STANDARDISED,
    OURS,
    RAW,
    Data,
    Trained,
    data_of,
    fewer,
    label_scale,
    regularisations,
    size_of,
    trained,
    ways,
)
from studies.bending_posture.verdicts import compared, judged, roomy
from studies.models.soft_finger.finger import DOWN, SoftFinger
from studies.models.soft_finger.odd import KINDS, odd_pictures
from studies.models.soft_finger.samples import MARKERS, Samples, marker_places

QUICK = [
    "samples=300",
    "unseen=60",
    "epochs=30",
    "seeds=1",
    "width=32",
    "widths=[32]",
    "counts=[100,300]",
    "etas=[0.6]",
    "eta_samples=100",
]


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    out = tmp_path_factory.mktemp("quick") / "out"
    sets = [part for setting in QUICK for part in ("--set", setting)]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(elsewhere, "DRAWS", 2)
        patch.setattr(running, "REGULARISATIONS", (1e-4, 0.01, 1.0))
        patch.setattr(running, "REPEATED", 5)
        code = command(["run", "bending-posture", *sets, "--out", str(out)])
    return code, json.loads((out / "results.json").read_text(encoding="utf-8")), out


@pytest.fixture(scope="module")
def finger():
    return SoftFinger.of(BendingPostureSpec())


@pytest.fixture(scope="module")
def data(finger):
    return data_of(BendingPostureSpec(unseen=50), finger, 50, [32], seed=3)


@pytest.fixture(scope="module")
def network(data):
    settings = dataclasses.replace(ways(BendingPostureSpec(), data, 100.0)[OURS], epochs=3)
    return trained(OURS, settings, data, size_of(32), watch=True).estimator


@pytest.mark.as_users
def test_a_quick_run_reads_postures(done):
    code, document, out = done
    assert code == 0
    measured = {name: metric["value"] for name, metric in document["metrics"].items()}
    assert measured["tip_seed_0_mm"] < measured["mean_predictor_mm"] / 8
    assert measured["odd_failures"] == 0
    assert measured["unanswered"] == 0
    assert measured["raw_images_ratio"] > 1
    assert measured["regularisation_finger_lengths_ratio"] > 1
    assert measured["regularisation_mm_ratio"] > 0
    assert measured["regularisation_standardised_ratio"] > 0
    assert measured["unusable"] == 0
    for name in ("other_lamp_tip_mm", "made_finger_tip_mm", "both_other_tip_mm"):
        assert 0 < measured[name] < measured["mean_predictor_mm"]
    assert not any(metric["target"] for metric in document["metrics"].values())
    assert len(document["claims"]) == 1
    said = " ".join(document["findings"])
    assert "(one seed)" in said
    assert "needs two chambers and two seeds" in said
    drawn = ("pictures", "dots", "markers", "learning", "ways", "bends", "regularisation", "etas")
    for name in (*drawn, "precision"):
        assert (out / "figures" / f"{name}.png").stat().st_size > 5000


@pytest.mark.as_users
def test_the_network_of_a_run_is_loaded_and_reads_a_new_frame(done, finger):
    _, document, out = done
    assert document["specs"] == ["specs/posture.network"]
    estimator = PostureEstimator.load(Path(out / "specs" / "posture.network"))
    assert estimator.record.samples == 300
    bend = np.deg2rad([50.0])
    image = finger.renderer(7).render(finger.postures(bend, np.array([DOWN])))[0]
    seen = find_posture(image.pixels, estimator)
    assert seen.status is ChamberStatus.CHAMBER
    assert seen.markers is not None
    off = np.linalg.norm(seen.markers[-1] - marker_places(bend, finger.length)[0, -1])
    assert off < 8  # mm: of a network that saw 300 images twelve times


def test_frames_without_a_chamber_have_no_posture(network, finger):
    postures = finger.postures(np.deg2rad([20.0]), np.array([DOWN]))
    for kind, _, picture in odd_pictures(finger, postures, seed=1):
        seen = find_posture(picture, network)
        assert seen.status is kind.status, kind.name
        assert (seen.markers is not None) is kind.usable, kind.name
    assert {kind.status for kind in KINDS} == set(ChamberStatus)


@pytest.mark.parametrize("degrees", [0.0, 0.01, 60.0, 120.0])
def test_markers_lie_on_a_circle_of_the_bend(degrees):
    bend, length = math.radians(degrees), 100.0
    found = marker_places(np.array([bend]), length)[0]
    # The tangent summed over a thousand pieces, by the rule of midpoints.
    pieces = np.arange(1000) / 1000 * length + length / 2000
    tangents = np.stack([np.sin(bend * pieces / length), np.cos(bend * pieces / length)], axis=1)
    places = np.concatenate([[[0, 0]], np.cumsum(tangents * length / 1000, axis=0)])
    at = places[[round(1000 * share) for share in MARKERS]]
    np.testing.assert_allclose(found, at[1:] - at[0], atol=1e-4)


def test_samples_are_the_same_for_every_finger_but_for_the_picture(data):
    spec = BendingPostureSpec(unseen=50)
    other = SoftFinger.of(BendingPostureSpec(eta=0.9))
    one, two = data, data_of(spec, other, 50, [32], seed=3)
    np.testing.assert_array_equal(one.labels, two.labels)
    np.testing.assert_array_equal(one.unseen.markers, two.unseen.markers)
    size = size_of(32)
    assert not np.array_equal(one.train.images[size], two.train.images[size])
    off = one.labels - one.train.markers
    assert np.std(off) == pytest.approx(spec.label_noise, rel=0.15)  # of 300 numbers
    half = fewer(one, 25)
    np.testing.assert_array_equal(half.train.images[size], one.train.images[size][:25])
    np.testing.assert_array_equal(half.labels, one.labels[:25])
    assert half.mean_error == pytest.approx(
        np.mean(np.linalg.norm(one.unseen.markers[:, 2] - one.labels[:25, 2].mean(axis=0), axis=1))
    )


def test_the_papers_regularisation_goes_with_the_square_of_its_unit(data):
    scale, at = label_scale(data), regularisations(data, 100.0)
    assert at["standardised"] == 0.01
    assert at["mm"] * scale**2 == pytest.approx(0.01)
    longer = dataclasses.replace(data, labels=2 * data.labels)
    again = regularisations(longer, 200.0)
    assert again["finger lengths"] == pytest.approx(at["finger lengths"])
    assert again["mm"] == pytest.approx(at["mm"] / 4)


def test_the_papers_regularisation_is_trained_in_all_its_readings(data):
    made = ways(BendingPostureSpec(), data, 100.0)
    scale = label_scale(data)
    weights = [made[way].regularisation for way in (L2_MM, L2_STANDARDISED, L2_LENGTHS)]
    assert weights == pytest.approx([0.01 / scale**2, 0.01, 0.01 * (100 / scale) ** 2])


def test_frames_that_show_no_chamber_are_left_out(finger, data, monkeypatch):
    spec, size = BendingPostureSpec(unseen=50), size_of(32)
    both = (data.train, data.unseen)
    usable = np.arange(100) % 5 != 0

    def joined(*_, **__):
        images = np.concatenate([one.images[size] for one in both])
        bends, markers = (
            np.concatenate([getattr(one, name) for one in both]) for name in ("bends", "markers")
        )
        return Samples(bends, {size: images}, usable, markers)

    monkeypatch.setattr(trainings, "samples", joined)
    part = data_of(spec, finger, 50, [32], seed=3)
    assert part.unusable == 20
    np.testing.assert_array_equal(part.labels, data.labels[usable[:50]])
    np.testing.assert_array_equal(part.unseen.markers, data.unseen.markers[usable[50:]])
    np.testing.assert_array_equal(part.train.images[size], data.train.images[size][usable[:50]])
    for hidden in (slice(None), slice(1, 50), slice(50, None)):
        usable = np.ones(100, bool)
        usable[hidden] = False
        with pytest.raises(UserError, match=r"^η = 0.6: hardly any picture.*$"):
            data_of(spec, finger, 50, [32], seed=3)


def test_errors_elsewhere_are_those_of_usable_frames():
    errors = [np.array([[1.0, 2.0], [3.0, 6.0]]), np.zeros((2, 0)), np.array([[8.0], [4.0]])]
    one = Elsewhere(LAMP, 6, errors)
    assert one.usable == 3
    assert one.mean == pytest.approx(4.0)
    assert one.worst == pytest.approx(6.0)
    nothing = Elsewhere(LAMP, 2, [np.zeros((2, 0))])
    assert math.isnan(nothing.mean)
    assert math.isnan(nothing.worst)


TIPS = {
    OURS: (0.5, 0.6, 0.5),
    EQUAL: (0.5, 0.6, 0.6),
    KEPT: (0.6, 0.6, 0.6),
    L2_MM: (0.5, 0.6, 0.55),
    L2_STANDARDISED: (0.3, 0.4, 0.4),
    L2_LENGTHS: (1.5, 2.0, 1.8),
    RAW: (1.0, 1.2, 1.0),
}
"""Tip errors of three seeds, mm, as they may be."""


def made_up(network, etas=(), rows=(), **tips):
    """What a study may have found: a mean predictor that is off by 30 mm, and these tip errors."""

    def made(way, seed, tip):
        record = network.record
        settings = dataclasses.replace(record.settings, seed=seed)
        estimator = dataclasses.replace(
            network, record=dataclasses.replace(record, settings=settings)
        )
        return Trained(way, estimator, np.zeros((2, 3, 2)), np.full((2, 3), tip))

    none = Samples(np.zeros(2), {}, np.ones(2, bool), np.zeros((2, 3, 2)))
    unseen = dataclasses.replace(none, markers=np.full((2, 3, 2), [30.0, 0.0]))
    networks = {
        way: [made(way, i, tip) for i, tip in enumerate(known)]
        for way, known in (TIPS | tips).items()
    }
    return Found(
        data=Data(none, np.zeros((2, 3, 2)), unseen, 0),
        trained=networks,
        sweep=[],
        paper={"mm": 6e-5, "standardised": 0.01, "finger lengths": 0.6},
        rows=list(rows),
        etas=list(etas),
        elsewhere=[],
        bends=[AtBend(1.0, np.array([0.3, 0.5])), AtBend(120.0, np.full(2, 0.2))],
        odd=[Odd(KINDS[0], KINDS[0].status, answered=True)],
        seconds=0.001,
        cores=2,
        shown=[],
    )


def missed(found, **settings):
    """Names of metrics with targets, and of those that are missed."""
    asked = [one for one in metrics(BendingPostureSpec(**settings), found) if one.target]
    return {one.name for one in asked}, {one.name for one in asked if not one.met}


def test_targets_are_missed_by_what_they_forbid(network):
    asked, no = missed(made_up(network))
    assert asked == {
        "tip_seed_0_mm", "tip_seed_1_mm", "tip_seed_2_mm", "training_seconds",
        "times_better_than_mean", "regularisation_finger_lengths_ratio", "raw_images_ratio",
        "unanswered", "odd_failures",
    }  # fmt: skip
    assert not no
    assert missed(made_up(network, **{OURS: (0.5, 1.6, 0.5)}))[1] >= {
        "tip_seed_1_mm",
        "times_better_than_mean",
    }
    # As good as the study's own from one seed: nothing is shown to be worse.
    for way, name in (
        (L2_LENGTHS, "regularisation_finger_lengths_ratio"),
        (RAW, "raw_images_ratio"),
    ):
        same = (*TIPS[way][:2], TIPS[OURS][2])
        assert missed(made_up(network, **{way: same}))[1] == {name}
    silent = dataclasses.replace(made_up(network), bends=[AtBend(1.0, np.array([0.3, np.nan]))])
    assert missed(silent)[1] == {"unanswered"}
    mute = dataclasses.replace(made_up(network), odd=[Odd(KINDS[0], None, answered=False)])
    assert missed(mute)[1] == {"odd_failures"}


def test_targets_belong_to_the_stated_run(network):
    found = made_up(network)
    asked = missed(found)[0]
    for settings in ({"samples": 1000}, {"unseen": 100}, {"seeds": 1}, {"eta": 0.7}):
        assert not missed(found, **settings)[0]
    for settings in ({"unseen": 800}, {"seeds": 4}, {"etas": []}, {"sweep": False}):
        assert missed(found, **settings)[0] == asked


def test_the_finding_says_which_readings_are_worse(network):
    said = findings(made_up(network))[2]
    assert "in mm it is no different (1.00–1.10 times" in said
    assert "of standardised labels it is better (0.60–0.80 times" in said
    assert "in finger lengths it is worse (3.00–3.60 times" in said
    other = made_up(network, **{L2_LENGTHS: TIPS[OURS], L2_MM: (0.7, 0.8, 0.7)})
    said = findings(other)[2]
    assert "in finger lengths it is no different (1.00 times" in said
    assert "in mm it is worse" in said


@pytest.mark.parametrize(
    ("ratios", "word"),
    [([1.2, 3.0], "worse"), ([1.19, 3.0], "no different"), ([0.8, 0.5], "better"),
     ([0.9, 0.5], "no different"), ([0.5, 2.0], "no different")],
)  # fmt: skip
def test_worse_and_better_are_so_at_every_seed(ratios, word):
    assert judged(ratios) == word


def test_bends_without_an_answer_are_left_out(network):
    bends = [AtBend(1.0, np.full(2, np.nan)), AtBend(10.0, np.array([0.4, np.nan]))]
    found = dataclasses.replace(made_up(network), bends=bends)
    said = findings(found)
    assert any("at most 0.40 mm, at 10°" in line for line in said)
    mute = dataclasses.replace(found, bends=bends[:1])
    assert any("No frame" in line for line in findings(mute))


def chamber(eta, tips, clearance=2.0):
    return AtEta(eta, (80.0, 50.0), 4.0, clearance, 0, tips)


def test_chambers_differ_if_their_seeds_do_not_explain_it():
    # Printed tables of the studentised range at 5 %: 4.339 for three groups and six degrees of
    # freedom; for two groups and four it is √2 times Student's 2.776.
    three = [chamber(eta, (0.8, 0.9, 1.0)) for eta in (0.5, 0.6, 0.7)]
    alike = compared(three)
    assert alike is not None
    assert alike.limit == pytest.approx(4.339, abs=1e-3)
    assert alike.error == pytest.approx(0.1 / math.sqrt(3))
    assert alike.difference == pytest.approx(0, abs=1e-12)
    assert not alike.told
    # 4.339 × 0.0577 mm = 0.2505 mm
    for more, told in ((0.24, False), (0.26, True)):
        other = chamber(0.8, tuple(tip + more for tip in (0.8, 0.9, 1.0)))
        comparison = compared([*three[:2], other])
        assert comparison is not None
        assert comparison.told is told
    two = compared(three[:2])
    assert two is not None
    assert two.limit == pytest.approx(math.sqrt(2) * 2.776, abs=1e-3)
    assert compared(three[:1]) is None
    assert compared([chamber(eta, (0.8,)) for eta in (0.5, 0.6)]) is None
    assert compared([]) is None


def test_the_finding_on_chambers_follows_the_numbers(network):
    def said(*etas):
        lines = findings(made_up(network, etas))
        return next(line for line in lines if line.startswith("Tip errors of chambers"))

    room = {0.5: 2.8, 0.6: 1.55, 0.7: 0.3}
    alike = said(*(chamber(eta, (0.8, 0.9, 1.0), space) for eta, space in room.items()))
    assert "does not choose η" in alike
    assert "0.6 is the largest η of these with 1.5 mm" in alike
    tips = {0.5: (0.8, 0.81, 0.8), 0.6: (0.8, 0.81, 0.82), 0.7: (0.4, 0.41, 0.4)}
    apart = said(*(chamber(eta, tips[eta], space) for eta, space in room.items()))
    assert "read best at η = 0.7" in apart
    one = said(chamber(0.7, (0.8, 0.9), 0.3))
    assert "needs two chambers and two seeds" in one
    assert "none of these chambers leaves 1.5 mm" in one


def test_the_papers_choice_leaves_the_room_that_is_asked_for():
    etas = (0.5, 0.6, 0.7)
    made = []
    for eta in etas:
        # Table I of the paper prints Δl_D: 1.29, 2.55 and 3.81 mm; Δl_A is 4.1 mm.
        section = SoftFinger.of(BendingPostureSpec(eta=eta)).chamber
        space = float(section.offset_a) - abs(float(section.offset_d))
        made.append(chamber(eta, (1.0,), space))
    spaces = [one.clearance for one in made]
    assert spaces == pytest.approx([2.81, 1.55, 0.29], abs=2e-3)
    best = roomy(made)
    assert best is not None
    assert best.eta == 0.6
    assert roomy(made[2:]) is None


def row(method, count, error):
    return PrecisionRow(method, f"{count} samples", "training", error, 1.0, 1.0, 1.0, 0.0)


@pytest.mark.parametrize("counts", [[100, 300, 200], [300, 200, 100]])
def test_the_claim_compares_the_most_samples_with_the_fewest(network, counts):
    errors = {100: 0.1, 200: 0.12, 300: 0.05}
    rows = [row(method, count, errors[count]) for method in ("a", "b") for count in counts]
    spec = BendingPostureSpec(counts=counts)
    (claim,) = claims(spec, made_up(network, rows=rows))
    assert claim.holds
    assert "300 samples leave a smaller error than 100 samples" in claim.statement
    assert len(claim.evidence) == 2
    worse = [*rows[:3], *(row("b", count, 0.2 - errors[count]) for count in counts)]
    assert not claims(spec, made_up(network, rows=worse))[0].holds
    useless = [row("a", count, 20 * errors[count]) for count in counts]
    assert not claims(spec, made_up(network, rows=useless))[0].holds


def test_there_is_no_claim_without_something_to_compare(network):
    rows = [row("a", 100, 0.1)]
    assert claims(BendingPostureSpec(counts=[100]), made_up(network, rows=rows)) == []
    assert claims(BendingPostureSpec(widths=[]), made_up(network)) == []
    mean = dataclasses.replace(row(trainings.MEAN, 100, 1.0), setting="all samples")
    assert claims(BendingPostureSpec(widths=[]), made_up(network, rows=[mean])) == []


def test_an_eta_without_a_chamber_is_said_before_anything_is_rendered(
    tmp_path, capsys, monkeypatch
):
    def no_data(*_):
        raise AssertionError("rendered")

    monkeypatch.setattr(running, "data_of", no_data)
    out = tmp_path / "out"
    assert command(["run", "bending-posture", "--set", "etas=[0.6,1.1]", "--out", str(out)]) == 2
    said = capsys.readouterr().err
    assert "--set etas" in said
    assert "1.1" in said


@pytest.mark.parametrize("setting", ["widths=[32,32]", "samples=3", "largest_bend_deg=200"])
def test_settings_out_of_range_are_one_line(setting, tmp_path, capsys):
    out = tmp_path / "out"
    assert command(["run", "bending-posture", "--set", setting, "--out", str(out)]) == 2
    assert setting.split("=")[0] in capsys.readouterr().err
    assert not out.exists()
