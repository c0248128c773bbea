"""Labels of what bounds a view: one number for leg, surface and kind, and back; and in words."""

import itertools

import jax.numpy as jnp
import numpy as np

from optics.scene.reading import read_scene
from optics.visibility import boundary_codes as labels
from optics.visibility.boundary_codes import HORIZON, label_of, parts_of
from optics.visibility.views import describe_end
from tests.helpers import SCENES

LEGS, SURFACES, KINDS = range(4), (0, 1, 10, 65535), range(6)


def test_every_label_is_taken_apart_into_what_it_was_made_of():
    parts = list(itertools.product(LEGS, SURFACES, KINDS))
    made = [label_of(*part) for part in parts]
    assert min(made) >= 0
    assert len(set(made)) == len(parts)
    assert [parts_of(label) for label in made] == parts
    for number in (np.array(made, np.int32), jnp.asarray(made)):
        np.testing.assert_array_equal(np.stack(parts_of(number), axis=1), parts)


def test_what_is_no_surface_has_labels_of_its_own():
    names = [name for name in dir(labels) if name.isupper() and not name.startswith("_")]
    numbers = [number for name in names if isinstance(number := getattr(labels, name), int)]
    assert len(set(numbers)) == len(numbers) == 20
    # Those of deeper walls follow below, and far below those of windows.
    assert sorted(numbers)[:2] == [labels.WINDOWS, labels.SECOND_WALL]
    assert max(numbers) == HORIZON


def test_what_bounds_a_view_is_told_in_words():
    layout = read_scene(SCENES / "layered-pad.toml").layout
    own = {
        labels.SECOND_PAD_END: "end of the pad",
        labels.FIRST_BEZEL: "bezel",
        labels.HIGH_TRANSMISSION: "least transmission",
        labels.FIRST_WALL: "upper edge of layer 1 at 'from'",
        labels.SECOND_WALL: "upper edge of layer 1 at 'to'",
        labels.FIRST_WALL - 2: "edge between layers 1 and 2 at 'from'",
        labels.SECOND_WALL - 4: "lower edge of layer 2 at 'to'",
    }
    assert {label: describe_end(layout, label) for label in own} == own
    of_surfaces = {
        ("lid", labels.CUT_AFTER): "mirror 'lid': where it meets the line of a mirror",
        ("tip", labels.FIRST_END): "pad 'tip': its end 'from'",
        ("tip: layer 1 at 'to'", labels.SECOND_END): "pad 'tip', layer 1 at 'to': its upper edge",
        ("middle: upper side of layer 2", labels.FIRST_END): (
            "pad 'middle', upper side of layer 2: its end 'from'"
        ),
        ("middle: bezel at 'to'", labels.SECOND_END): "pad 'middle', bezel at 'to': its upper edge",
        ("middle: layer 2 at 'to'", labels.CROSSING): (
            "pad 'middle', layer 2 at 'to': where another surface meets it"
        ),
    }
    names = [part.name for part in layout.surfaces]
    for (name, kind), words in of_surfaces.items():
        assert describe_end(layout, label_of(1, names.index(name), kind)) == words
