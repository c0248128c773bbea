"""Groups are those a textbook would find, and only what is needed is solved."""

import random

import pytest

from kinematics import PlanError, describe_plan, find_vector_loops, parse_linkage
from kinematics.io.sketch import load_sketch
from kinematics.model.topology import Structure
from kinematics.solve.plan import make_plan
from kinematics.solve.steps import Group
from tests.kinematics.gallery import FOLDER, NAMES, bodies_at, gallery, gallery_tables

KINDS = {
    "double-butterfly": ["iterated"],
    "finger": ["RRR", "RRR"],
    "finger-crank": ["RRR", "RRR"],
    "five-bar": ["RRR"],
    "four-bar": ["RRR"],
    "jansen": ["RRR", "RRR", "RRR"],
    "peaucellier": ["RRR", "RRR", "RRR"],
    "quick-return": ["RPR", "RRP"],
    "scotch-yoke": ["RPP"],
    "slider-crank": ["RRP"],
    "stephenson": ["iterated"],
    "watt": ["RRR", "RRR"],
}
LOOPS = {"stephenson": 2, "double-butterfly": 3}


@pytest.mark.parametrize("name", NAMES)
def test_groups_of_the_gallery(name):
    structure: Structure = gallery(name).structure
    plan = make_plan(structure)
    assert [group.kind for group in plan.groups] == KINDS[name]
    assert sum(len(group.loops) for group in plan.iterated) == LOOPS.get(name, 0)
    # Euler: independent loops = joints counted once per body but one, less moving bodies.
    joins = sum(count - 1 for count in bodies_at(gallery_tables(name)).values())
    loops = joins + len(structure.sliders) - len(structure.moving)
    assert len(find_vector_loops(structure)) == loops


@pytest.mark.parametrize("name", ["jansen", "finger-crank", "stephenson"])
def test_the_order_in_the_file_does_not_matter(name):
    sketch = load_sketch(FOLDER / f"{name}.toml").model_dump()
    for seed in range(3):
        shuffled = dict(sketch)
        for table in ("joints", "bodies"):
            items = list(sketch[table].items())
            random.Random(seed).shuffle(items)
            shuffled[table] = dict(items)
        plan = make_plan(parse_linkage(shuffled).structure)
        assert sorted(group.kind for group in plan.groups) == sorted(KINDS[name])


def test_a_loop_between_moving_bodies_is_solved_in_the_frame_of_one():
    """Paper B's finger driven by its crank: B-C-G'-G closes wherever the phalanx is."""
    first, second = make_plan(gallery("finger-crank").structure).groups
    assert first.base == "intermediate"
    assert second.base is None
    assert first.pin == "G'"


def test_only_what_is_upstream_is_solved():
    structure = gallery("jansen").structure

    def groups(*targets: str) -> int:
        return len(make_plan(structure, frozenset(targets)).groups)

    assert [groups(name) for name in ("J1", "J3", "J4", "J5", "J6", "J7")] == [0, 1, 1, 1, 3, 3]
    assert groups("crank") == 0
    assert groups("foot") == 3
    assert groups("J3", "hip") == 2
    assert all(
        isinstance(step, Group) or step.at.joint != "J7"
        for step in make_plan(structure, frozenset({"J6"})).steps
    )


def test_unknown_targets_are_named():
    with pytest.raises(PlanError, match="no joint or body named Z9"):
        make_plan(gallery("four-bar").structure, frozenset({"Z9", "B"}))


def test_the_plan_in_words():
    text = "\n".join(describe_plan(gallery("quick-return").structure))
    assert "solve RPR in closed form: angle of lever, slide of A" in text
    assert "solve RRP in closed form: angle of rod, slide of R" in text
    text = "\n".join(describe_plan(gallery("stephenson").structure))
    assert "2 loops together in iteration" in text
    text = "\n".join(describe_plan(gallery("quick-return").structure, frozenset({"A"})))
    assert "solve" not in text
