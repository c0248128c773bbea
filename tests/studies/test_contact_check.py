"""What the study of contacts counts, and what it presses in."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from designopt import Records
from perception.contacts import Contact
from studies.image_check.cases import EVEN, nominal
from studies.models.sensor.spec import WIDTH
from studies.oracles.judge import contacts as judge
from studies.physical_check.contacts import ContactCheckSpec
from studies.physical_check.contacts.cases import BETWEEN, ROOM, fingers, press_pads
from studies.physical_check.contacts.run import add_contacts, lamps_of, matched, statistics


def claimed(along, across, diameter, deviation=0.1):
    covariance = deviation**2 * np.eye(3)
    return Contact("tip", ("direct",), np.array([along, across]), diameter, covariance, 0.5, 20.0)


THERE = [
    judge.Contact("tip", "sphere", 8.0, 1.0, 0.5, size=8.0),
    judge.Contact("tip", "pin", 16.0, 1.0, 0.5, size=1.5),
]


def test_what_is_claimed_is_that_of_the_nearest_thing_whose_edge_it_is_within():
    near, nearer, off = claimed(8.5, 1.0, 4.0), claimed(8.1, 1.0, 4.0), claimed(16.0, 9.0, 3.0)
    pairs = list(matched(THERE, [near, nearer, off]))
    assert pairs[0] == (THERE[0], nearer)
    assert pairs[1] == (THERE[1], None)
    assert pairs[2:] == [(None, near), (None, off)]


def test_errors_are_counted():
    records = Records()
    given = [claimed(8.03, 1.04, 4.2), claimed(2.0, -9.0, 3.0)]
    add_contacts(records, {"path": "direct"}, THERE, given)
    found = statistics(records)
    assert (found["contacts"], found["found"], found["false"]) == (2, 0.5, 0.5)
    assert found["center_worst_mm"] == pytest.approx(0.05)
    assert found["diameter_median_mm"] == pytest.approx(0.2)
    assert found["ratio"] == pytest.approx(math.sqrt((0.3**2 + 0.4**2 + 2**2) / 3))


def test_what_is_pressed_in_is_on_its_pad_and_apart():
    tables, generator = nominal("none"), np.random.default_rng(0)
    lengths = {pad["name"]: math.dist(pad["from"], pad["to"]) for pad in tables["pads"]}
    kinds = set()
    for _ in range(20):
        pressed = press_pads(tables, generator)
        kinds |= {one.kind for one in pressed}
        assert {one.pad for one in pressed} == set(lengths)
        for one in pressed:
            room = one.edge + ROOM
            assert room <= one.along <= lengths[one.pad] - room
            assert abs(one.across) <= WIDTH / 2 - room
        for one, other in itertools.combinations(pressed, 2):
            apart = math.hypot(one.along - other.along, one.across - other.across)
            assert one.pad != other.pad or apart > one.edge + other.edge + BETWEEN
    assert kinds == {"sphere", "pin"}


def test_fingers_have_their_lights_and_lamps():
    spec = ContactCheckSpec(fingers=5, pressed=2, untouched=1, references=2)
    made = list(fingers(spec, {"camera": 0.1}, 0))
    again = next(fingers(spec, {"camera": 0.1}, 0))
    assert again.captures == made[0].captures
    for finger in made:
        assert [bool(one.contacts) for one in finger.captures] == [False] * 3 + [True] * 2
        assert len(finger.poses) == 5
        pad = finger.tables["pads"][0]
        lamps = lamps_of(finger, pad["name"])
        if finger.light == EVEN:
            assert lamps == []
            continue
        red, green, blue = lamps
        assert red is not None
        assert blue is not None
        assert red.start[1] == -blue.start[1] >= WIDTH / 2
        assert (green is None) == (finger.layers != "none")
