"""Specs of Table I in one program: the same metrics as one by one."""

from contextlib import nullcontext

import pytest

from designopt import UserError
from designopt.study.study import Context, load_study
from studies.models.soft_finger.spec import ChamberSpec
from studies.table1 import Table1Spec
from studies.table1.run import run, run_batch

ROUNDING = 1e-12
"""Relative; the same equations in another program."""

CONTEXT = Context(0, "float64", lambda _: nullcontext())


def spec(clearance, **chamber):
    return Table1Spec(
        clearance=clearance, chamber=ChamberSpec(**chamber), precision=False, stability=False
    )


def test_a_batch_finds_what_single_runs_find():
    specs = [spec(1.5), spec(1.1, length_ab=35.0, wall_angle_bc_deg=1.0, offset_b=2.5)]
    batch = load_study("table1").batch
    assert batch is not None
    for one, answer in zip(specs, batch(specs, CONTEXT), strict=True):
        assert not isinstance(answer, UserError)
        wanted = run(one, CONTEXT).metrics
        assert len(answer.metrics) == len(wanted)
        for mine, theirs in zip(answer.metrics, wanted, strict=True):
            assert mine.value == pytest.approx(theirs.value, rel=ROUNDING, abs=0), mine.name
            assert (mine.name, mine.unit, mine.target) == (theirs.name, theirs.unit, theirs.target)
            assert mine.description == theirs.description


def test_a_chamber_without_constants_is_told_and_the_others_found():
    nothing = spec(1.5, length_ab=1e-3, length_bc=1e4, length_cd=1e-3, offset_b=-1e4)
    good, bad = run_batch([spec(1.5), nothing], CONTEXT)
    assert not isinstance(good, UserError)
    with pytest.raises(UserError, match="no camera constants") as alone:
        run(nothing, CONTEXT)
    assert str(bad) == str(alone.value)
