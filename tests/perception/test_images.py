"""Every public function that takes an image refuses what is none, in one line with the cure."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import perception.chamber
import perception.posture
import perception.proprioception
from designopt.errors import UserError
from perception import (
    PaperRoute,
    References,
    compare_with_reference,
    detect_quads,
    detect_views,
    find_tag_turns,
    fit_quad,
    unwarp,
)
from perception.chamber import find_points, find_regions
from perception.matching import ViewCatalog
from perception.posture import (
    PostureEstimator,
    PostureNetwork,
    Training,
    TrainingRecord,
    find_posture,
    make_boundary_image,
    shrink,
    train,
)
from tests.perception.drawn import Eye, Pad, exact_view

ROWS, COLUMNS = 24, 32
COLORED = np.random.default_rng(0).integers(0, 256, (ROWS, COLUMNS, 3), np.uint8)
GRAY = COLORED[..., 0].copy()

EYE = Eye(ROWS, COLUMNS, focal=40.0, pinhole=True)
LENS = EYE.lens()
VIEW = exact_view(EYE, Pad((40, -6), (40, 6), width=16.0))
CONTOUR = np.round(VIEW.corners).astype(int)
REGIONS = find_regions(COLORED)
SETTINGS = Training(channels=(2, 2))
RECORD = TrainingRecord((1.0,), (), (1.0,), 4, (COLUMNS, ROWS), SETTINGS, {})
NETWORK = PostureNetwork((COLUMNS, ROWS), SETTINGS.channels, np.random.default_rng(0))
ESTIMATOR = PostureEstimator(NETWORK, 0.0, 1.0, np.zeros((3, 2)), 1.0, RECORD)
MARKERS = np.random.default_rng(1).normal(size=(4, 3, 2))
REFERENCES = References({("pad", "direct"): COLORED})


bare = inspect.unwrap
"""A function as users have it, without the run-time checks of types."""

OF_COLORED = {
    "find_regions": bare(find_regions),
    "find_points": lambda image: bare(find_points)(image, REGIONS),
    "find_posture": lambda image: bare(find_posture)(image, ESTIMATOR),
    "compare_with_reference": lambda image: bare(compare_with_reference)(image, COLORED),
    "References": lambda image: bare(References.compare)(REFERENCES, VIEW, image),
    "PaperRoute": lambda image: bare(PaperRoute.corners)(PaperRoute(), image),
    "find_tag_turns": lambda image: bare(find_tag_turns)(image, 2),
}
OF_ANY_CHANNELS = {
    "detect_quads": lambda image: bare(detect_quads)(image, LENS),
    "detect_views": lambda image: bare(detect_views)(image, LENS, ViewCatalog((), {}, {}, 5.0, 0)),
    "unwarp": lambda image: bare(unwarp)(image, VIEW, LENS, 12.0, 8.0),
}
OF_GRAY = {
    "make_boundary_image": bare(make_boundary_image),
    "shrink": lambda image: bare(shrink)(image, (8, 6)),
}
OF_FLOATS = {
    "fit_quad": lambda image: bare(fit_quad)(image, LENS, CONTOUR),
    "PostureEstimator": lambda image: bare(PostureEstimator.predict)(ESTIMATOR, image[None]),
    "train": lambda image: bare(train)(np.stack([image] * 4), MARKERS, SETTINGS),
}
SIZED = {"find_points", "compare_with_reference", "References", *OF_ANY_CHANNELS}
"""Those for which an image must be as large as something else."""

TAKING = {**OF_COLORED, **OF_ANY_CHANNELS, **OF_GRAY}


def refusal(take: Callable[[Any], Any], image: Any) -> str:
    with pytest.raises(UserError) as caught:
        take(image)
    line = str(caught.value)
    assert "\n" not in line
    assert re.search(r"[;:] \w", line), line  # what it is; what to do
    return line


def routines(public: Any) -> list[Any]:
    """A function; of a class its public methods."""
    own = [public]
    if inspect.isclass(public):
        own = [getattr(public, name) for name in vars(public) if name[0] != "_"]
    return [one for one in own if inspect.isroutine(one) and callable(one)]


def test_every_public_function_with_an_image_is_here():
    """By the names of their parameters."""
    images = {"image", "images", "picture", "gray", "labels", "boundary"}
    packages = (perception, perception.chamber, perception.posture, perception.proprioception)
    public = {name: getattr(package, name) for package in packages for name in package.__all__}
    taking = {
        name
        for name, one in public.items()
        for routine in routines(one)
        if images & set(inspect.signature(routine).parameters)
    }
    # The rulers' and the meters' labels are joint angles.
    assert taking - {"fit_edges"} == set(TAKING) | set(OF_FLOATS)


@pytest.mark.parametrize("name", TAKING)
def test_what_is_no_image_is_refused(name):
    usual = GRAY if name in OF_GRAY else COLORED

    def refused(image: Any) -> str:
        return refusal(TAKING[name], image)

    assert "None" in refused(None)
    for other in ("image", 3, usual.tolist(), object()):
        assert type(other).__name__ in refused(other)
    for kind in (float, np.float32, np.uint16, np.int64, bool, complex, object):
        assert f"not {np.dtype(kind)}" in refused(usual.astype(kind))
    cure = "convert it with (255 * image).astype(numpy.uint8) if 1 is white"
    assert refused(np.full(usual.shape, np.nan)).endswith(cure)
    assert "no pixels" in refused(usual[:0])
    assert "no pixels" in refused(usual[:, :0])
    for shape in ((), (5,), (1, *COLORED.shape), *((ROWS, COLUMNS, n) for n in (0, 1, 2, 4))):
        assert str(shape) in refused(np.zeros(shape, np.uint8))
    if name in OF_COLORED:
        assert "give the image with its colours" in refused(GRAY)
    if name in OF_GRAY:
        assert "give one channel" in refused(COLORED)
    if name in SIZED:
        assert f"{COLUMNS}x{ROWS - 1} px" in refused(COLORED[1:])
        assert "numpy.rot90" in refused(COLORED.swapaxes(0, 1))


@pytest.mark.parametrize("name", TAKING)
def test_any_layout_in_memory_and_a_read_only_image_do(name):
    for usual in [GRAY] * (name not in OF_COLORED) + [COLORED] * (name not in OF_GRAY):
        fixed = usual.copy()
        fixed.flags.writeable = False
        larger = np.zeros((ROWS, 2 * COLUMNS, *usual.shape[2:]), np.uint8)
        larger[:, ::2] = usual
        backwards = usual[::-1, ::-1].copy()
        expected = repr(TAKING[name](usual))
        for same in (fixed, larger[:, ::2], backwards[::-1, ::-1], np.asfortranarray(usual)):
            assert repr(TAKING[name](same)) == expected


@pytest.mark.parametrize("name", OF_FLOATS)
def test_floats_that_are_no_image_are_refused(name):
    image = GRAY.astype(np.float32)
    take = OF_FLOATS[name]
    for other in (GRAY, image.astype(complex), image > 9, image.astype(object)):
        assert f"not {other.dtype}" in refusal(take, other)
    for value in (np.nan, np.inf):
        broken = image.copy()
        broken[10, 10] = value
        assert "not finite" in refusal(take, broken)
    for other in (image[None], image[:, 0], *((image[1:], image.T) if name != "train" else ())):
        assert "shape" in refusal(take, other)


def test_samples_without_pixels_and_other_sizes_of_validation_are_refused():
    images = np.random.default_rng(0).random((4, 6, 8), np.float32)
    assert "no pixels" in refusal(lambda it: bare(train)(it, MARKERS, SETTINGS), images[:, :0])
    line = refusal(lambda it: bare(train)(images, it, SETTINGS), MARKERS[1:])
    assert "(4, 3, 2), not (3, 3, 2); give the places" in line
    validation = images[:, 1:], MARKERS
    line = refusal(lambda it: bare(train)(images, MARKERS, SETTINGS, it), validation)
    assert "(samples, 6, 8), not (4, 5, 8)" in line
