"""Files state the version of their format; that of another one is refused in one line."""

from pathlib import Path

import pytest

from designopt import UserError
from designopt.designs import load_design
from kinematics import format_linkage, read_linkage
from optics import format_chamber, format_scene, read_scene
from studies.models import format_finger, packaged_finger
from tests.optics.chambers import PAPER

STUDIES = Path(__file__).parents[3] / "studies"

TEXTS = {
    "linkage": lambda: format_linkage(read_linkage(STUDIES / "gallery/linkages/four-bar.toml")),
    "scene": lambda: format_scene(read_scene(STUDIES / "gallery/scenes/periscope.toml")),
    "chamber": lambda: format_chamber("soft", PAPER),
    "finger": lambda: format_finger(packaged_finger()),
}


@pytest.mark.parametrize("table", TEXTS)
def test_a_file_of_another_version_is_refused(table, tmp_path):
    text = TEXTS[table]()
    path = tmp_path / "design.toml"
    assert text.count("format = 1") == 1
    path.write_text(text.replace("format = 1", "format = 2"))
    with pytest.raises(UserError) as caught:
        load_design(str(path))
    assert str(caught.value) == (
        f"{path}: {table}.format: this version reads format 1 and not 2; update designopt, or "
        "write the file anew"
    )
    path.write_text(text.replace("format = 1\n", ""))
    assert load_design(str(path)).name
