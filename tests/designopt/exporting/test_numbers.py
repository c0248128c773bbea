import json
import math

import pytest

from designopt.designs import Quantity
from designopt.errors import UserError
from designopt.exporting.numbers import json_text


def test_every_number_comes_back_to_the_bit_with_its_unit():
    values = [0.1 + 0.2, -1 / 3, math.pi * 1e-300, 1e22, 5.0, 1080]
    quantities = [Quantity(f"α.{i}", value, "N mm/rad") for i, value in enumerate(values)]
    document = json.loads(json_text("Glied", quantities))
    assert document["name"] == "Glied"
    read = document["quantities"]
    assert list(read) == [part.name for part in quantities]
    for part in quantities:
        assert read[part.name] == {"value": part.value, "unit": "N mm/rad"}


def test_a_name_twice_is_a_fault_and_no_number_is_lost():
    quantities = [Quantity("a-b-c", 1.0, "mm"), Quantity("a-b-c", 2.0, "mm")]
    with pytest.raises(UserError, match=r"two numbers of crank are called 'a-b-c'; rename"):
        json_text("crank", quantities)
