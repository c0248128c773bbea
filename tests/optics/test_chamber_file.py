"""The chamber's file: what it says, and what is said of a faulty one."""

import dataclasses
import math
import tomllib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from designopt import UserError
from optics import Chamber
from optics.chamber.designed import DesignedChamber
from optics.chamber.file import format_chamber, read_chamber, write_chamber
from tests.commands import refused_cases
from tests.optics.chambers import PAPER

TEXT = format_chamber("soft", PAPER)


def written(tmp_path, text=TEXT):
    path = tmp_path / "finger.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_file_reads_back_as_the_chamber(tmp_path):
    path = tmp_path / "again.toml"
    write_chamber("soft", PAPER, path)
    assert path.read_text(encoding="utf-8") == TEXT
    name, chamber = read_chamber(path)
    assert name == "soft"
    for field in dataclasses.fields(chamber):
        expected = float(getattr(PAPER, field.name))
        assert float(getattr(chamber, field.name)) == pytest.approx(expected, rel=1e-12)


@given(st.lists(st.floats(0.5, 50.0), min_size=10, max_size=10), st.floats(0.0, 60.0))
def test_what_is_written_is_read_back(lengths, angle_deg):
    names = [field.name for field in dataclasses.fields(PAPER) if field.name != "wall_angle_bc"]
    drawn = dict(zip(names, lengths, strict=True))
    chamber = Chamber(**drawn, wall_angle_bc=math.radians(angle_deg))
    table = tomllib.loads(format_chamber("drawn", chamber))["chamber"]
    assert {name: table[name] for name in names} == drawn
    assert math.radians(table["wall_angle_bc_deg"]) == float(chamber.wall_angle_bc)


def test_without_a_name_it_is_the_files(tmp_path):
    design = DesignedChamber.read(written(tmp_path, TEXT.replace('name = "soft"\n', "")))
    assert design.name == "finger"
    odd = written(tmp_path, TEXT.replace('name = "soft"\n', "")).rename(tmp_path / "a\x1bb.toml")
    assert DesignedChamber.read(odd).name == "a b"
    assert math.degrees(float(design.chamber.wall_angle_bc)) == pytest.approx(2.0)


@pytest.mark.parametrize(("old", "new", "message"), refused_cases("chamber_file"))
def test_faults_name_the_file_the_key_and_the_cure(tmp_path, old, new, message):
    assert old in TEXT
    path = written(tmp_path, TEXT.replace(old, new))
    with pytest.raises(UserError) as caught:
        read_chamber(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
