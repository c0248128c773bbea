"""Labels of what bounds a view: one number for leg, surface and kind, and back."""

import itertools

import jax.numpy as jnp
import numpy as np

from optics.visibility import boundary_codes as labels
from optics.visibility.boundary_codes import HORIZON, label_of, parts_of

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
    numbers = [getattr(labels, name) for name in names]
    assert len(set(numbers)) == len(numbers) == 13
    assert min(numbers) == labels.FOLD
    assert max(numbers) == HORIZON
