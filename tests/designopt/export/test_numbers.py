import json
import math

import pytest

from designopt.errors import UserError
from designopt.export.json import Quantity, json_text


def test_every_number_comes_back_with_its_unit():
    values = [0.1, -1 / 3, math.pi * 1e-300, 1e22, 5.0, 1080]
    quantities = [Quantity(f"α.{i}", value, "N mm/rad") for i, value in enumerate(values)]
    document = json.loads(json_text("Glied", quantities))
    assert document["name"] == "Glied"
    read = document["quantities"]
    assert list(read) == [part.name for part in quantities]
    for part in quantities:
        value = pytest.approx(part.value, rel=1e-13, abs=0)
        assert read[part.name] == {"value": value, "unit": "N mm/rad"}
    assert [read[f"α.{i}"]["value"] for i in (0, 3, 4, 5)] == [0.1, 1e22, 5, 1080]


def test_numbers_do_not_show_that_they_were_computed():
    text = json_text(
        "bar", [Quantity("length", 13.730000000000022, "mm"), Quantity("pixels", 1080, "px")]
    )
    assert '"value": 13.73,' in text
    assert '"value": 1080,' in text


def test_a_name_twice_is_a_fault_and_no_number_is_lost():
    quantities = [Quantity("a-b-c", 1.0, "mm"), Quantity("a-b-c", 2.0, "mm")]
    with pytest.raises(UserError, match=r"two numbers of crank are called 'a-b-c'; rename"):
        json_text("crank", quantities)
