"""A scene's measures against the public functions, an oracle's rays and central differences."""

import functools
import itertools
import tomllib

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import shapely

from designopt.errors import UserError
from designopt.optimize import Evaluation, Problem, make_soft_minimum, minimize
from designopt.programs import Program
from optics.parametric.scene import SceneParameters
from optics.parametric.scene_measures import PLACES, find_module_room
from optics.scene.camera import Camera, Pinhole
from optics.scene.camera_module import CameraModule
from optics.scene.designed import DesignedScene
from optics.scene.file import SceneFile
from optics.scene.reading import parse_scene
from optics.scene.scene import Layout, Scene, Surface
from optics.visibility.coverage import find_coverage, find_views
from optics.visibility.sharpness import find_sharpness
from studies.oracles.rays import bounds
from tests.helpers import SCENES, assert_same, check_gradients, load_toml
from tests.optics.scenes import fans_of, posed, structure_of


@functools.cache
def design(name):
    return DesignedScene.read(SCENES / f"{name}.toml")


def parameters_of(name, **options):
    parameters = SceneParameters(design(name), **options)
    return parameters, parameters.values()


def saved(parameters, values):
    """The scene that the saved file describes."""
    (file,) = parameters.files(values)
    assert file.name == "scene.toml"
    return parse_scene(tomllib.loads(file.content))


MOVED = {
    "camera.direction": -104.0,
    "camera.position.x": 14.5,
    "camera.position.y": 15.25,
    "camera.field_of_view": 130.0,
    "mirrors.distal.to.x": 50.0,
    "mirrors.proximal.from.y": 16.0,
}


def test_the_saved_file_has_the_values_and_the_camera_takes_its_body_along():
    parameters, values = parameters_of("finger")
    assert all(one.low < one.value < one.high for one in parameters.parameters)
    assert set(values) - set(parameters.free or ()) == {"camera.field_of_view"}
    before, after = design("finger").scene, saved(parameters, values | MOVED)
    assert after.layout == before.layout
    np.testing.assert_allclose(after.camera.position, [14.5, 15.25], atol=1e-12)
    np.testing.assert_allclose(np.degrees(after.camera.direction), -104.0, atol=1e-12)
    np.testing.assert_allclose(np.degrees(after.camera.field_of_view), 130.0, atol=1e-12)
    mirrors = np.array(before.mirrors)
    mirrors[0, 1, 0], mirrors[1, 0, 1] = 50.0, 16.0
    np.testing.assert_allclose(after.mirrors, mirrors, atol=1e-12)

    def seen_from_the_camera(scene):
        arrows = (np.asarray(scene.blockers[0]) - np.asarray(scene.camera.position)) @ [1, 1j]
        return arrows * np.exp(-1j * float(scene.camera.direction))

    np.testing.assert_allclose(
        seen_from_the_camera(after), seen_from_the_camera(before), atol=1e-12
    )
    np.testing.assert_array_equal(after.blockers[1:], before.blockers[1:])
    np.testing.assert_array_equal(after.pads, before.pads)
    # What nobody turned comes back as it was.
    assert_same(saved(parameters, values), before, atol=1e-9)


def test_lens_and_layers_are_those_of_the_file():
    tables = load_toml("scenes/lens.toml")
    lens = SceneParameters(DesignedScene.of(SceneFile.model_validate(tables), "lens"))
    assert lens.tables(lens.values())["camera"]["lens"] == tables["camera"]["lens"]
    layered, values = parameters_of("layered-pad")
    scene = design("layered-pad").scene
    assert_same(parse_scene(layered.tables(values)), scene, rtol=1e-12)
    moves = {"mirrors.lid.to.y": 12.0, "camera.position.x": 1.0}
    moved = parse_scene(layered.tables(values | moves))
    assert float(moved.mirrors[0, 1, 1]) == pytest.approx(12.0)
    assert_same(moved.layers, scene.layers, rtol=1e-12)


def test_what_cannot_be_is_refused():
    curved, values = parameters_of("circle")
    assert float(saved(curved, values | {"mirrors.bowl.radius": 80.0}).radii[0]) == 80
    with pytest.raises(UserError, match="make 'radius' longer than 40"):
        curved.files(values | {"mirrors.bowl.radius": 40.0})
    with pytest.raises(UserError, match="mirror bowl: a search looks into straight mirrors only"):
        curved.evaluate(curved.vector(values), ("coverage",))
    tables = design("folded-pad").file.model_dump(by_alias=True, exclude_unset=True)
    bare = DesignedScene.of(SceneFile.model_validate({**tables, "pads": []}), "bare")
    with pytest.raises(UserError, match=r"add one under \[\[pads\]\]"):
        SceneParameters(bare)
    with pytest.raises(UserError, match="no joint angle is named mcp; there are: pip, dip"):
        parameters_of("finger", over={"mcp": (0, 10)})
    with pytest.raises(UserError, match="the range from 10° to 10° is empty"):
        parameters_of("finger", over={"pip": (10, 10)})
    finger, values = parameters_of("finger")
    short = {f"mirrors.distal.{end}.{axis}": 20.0 for end in ("from", "to") for axis in "xy"}
    for refused in (finger.judge, finger.files):
        with pytest.raises(UserError, match="it has no length"):
            refused(values | short)


def measured(parameters, values, *of):
    """Arrays of measures."""
    return Program(functools.partial(parameters.evaluate, of=of))(parameters.vector(values))


def grid(joints, count):
    ranges = [np.radians(np.linspace(joint.low, joint.high, count)) for joint in joints]
    return np.array(list(itertools.product(*ranges))).reshape(-1, len(joints))


def test_coverage_is_that_of_rays_and_goes_on_below_0_by_what_is_missed():
    parameters, values = parameters_of("finger", over={"dip": (0, 60)})
    values |= MOVED | {"camera.direction": -75.0}
    found = measured(parameters, values, "coverage", "px_per_mm", "coverage.distal")
    scene, poses = saved(parameters, values), grid(parameters.joints, 4)
    shot = bounds(
        structure_of(scene.layout), fans_of([posed(scene, angles) for angles in poses]), 2001, 1
    )
    inner, outer = shot.coverage[:, 0]
    covered = found["coverage"]
    assert np.all(covered <= outer + 1e-9)
    hidden = covered < 0
    assert hidden.any()
    assert not hidden.all()
    assert np.all(inner[hidden] == 0)
    assert np.all(covered[~hidden] >= inner[~hidden] - 1e-9)
    np.testing.assert_array_equal(found["coverage.distal"], covered[:, 2])
    views = find_views(scene, jnp.asarray(poses))
    np.testing.assert_allclose(covered[hidden], np.max(views.margin, axis=1)[hidden], atol=1e-9)
    # Of resolution, what is least between the places that are asked.
    least = find_sharpness(scene, poses, views.value, bounces=1).px_per_mm[..., 0]
    sharp = np.min(found["px_per_mm"], axis=-1)
    assert np.all(sharp[hidden] < 0)
    assert np.all(sharp[~hidden] >= least[~hidden] * (1 - 1e-9))
    whole = covered > 1 - 1e-9
    np.testing.assert_allclose(sharp[whole], least[whole], rtol=0.1)
    where = {one.name: one.where for one in parameters.measures}
    assert where["coverage"]((1, 2)) == "pad 'distal', pip 0°, dip 20°"
    assert where["coverage.distal"]((1,)) == "pip 0°, dip 20°"
    assert where["mirror_length"]((1,)) == "mirror 'proximal'"


def test_a_judgement_is_over_more_poses():
    parameters, values = parameters_of("finger")
    judged = parameters.judge(values)
    assert judged.keys() == {one.name for one in parameters.measures}
    scene, poses = design("finger").scene, grid(parameters.joints, 10)
    coverage = np.asarray(find_coverage(scene, jnp.asarray(poses)).value)
    assert judged["coverage"] == pytest.approx(np.min(coverage), abs=1e-9)
    assert judged["coverage.proximal"] == pytest.approx(np.min(coverage[:, 0]), abs=1e-9)
    assert judged["mirror_length"] == pytest.approx(np.hypot(53.81 - 23.24, 0.34 - 19.04))
    resolution = [judged[f"px_per_mm.{pad.name}"] for pad in scene.layout.pads]
    assert judged["px_per_mm"] == min(resolution) > 0
    (asked,) = parameters.requirements
    assert (asked.measure, asked.value) == ("coverage", pytest.approx(0.9999))
    assert asked.margin(judged["coverage"]) >= 0


def folded(direction, field):
    """The folded pad before a camera that looks elsewhere."""
    tables = design("folded-pad").file.model_dump(by_alias=True, exclude_unset=True)
    tables["camera"] |= {"direction_deg": direction, "fov_deg": field}
    parameters = SceneParameters(DesignedScene.of(SceneFile.model_validate(tables), "folded"))
    return parameters, parameters.values()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["coverage", "px_per_mm"])
def test_slopes_are_central_differences_also_of_a_hidden_pad(name):
    parameters, values = folded(75.0, 40.0)
    hidden = {"camera.position.x": -13.7, "mirrors.lid.to.y": 8.1}
    turned = [values | {"camera.direction": 10.0}, values, values | hidden]
    batch = jnp.stack([parameters.vector(one) for one in turned])

    def total(numbers):
        return jnp.sum(parameters.evaluate(jnp.stack(numbers), (name,))[name])

    check_gradients(total, [*batch.T], of_largest=1e-6, rtol=1e-5)
    value, slopes = jax.jit(jax.value_and_grad(total))([*batch[1]])
    assert value < 0
    # Turning back by a degree brings it nearer by a degree.
    unit = 1.0 if name == "coverage" else PLACES * parameters._nominal
    assert float(slopes[2]) == pytest.approx(-np.radians(1.0) * unit)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("direction", "field", "before", "after"), [(75.0, 40.0, 0.0, 0.1), (40.0, 50.0, 0.7, 0.999)]
)
def test_a_hidden_pad_is_found_and_one_in_part_is_seen_wholly(direction, field, before, after):
    parameters, values = folded(direction, field)
    judged = parameters.judge(values)["coverage"]
    assert judged < before
    assert bool(parameters.requirements) == (judged > 0)
    names = [one.name for one in parameters.parameters]
    free = jnp.array([names.index(name) for name in parameters.free or ()])
    start = parameters.vector(values)
    low, high = (
        jnp.array([getattr(one, end) for one in parameters.parameters])[free]
        for end in ("low", "high")
    )

    def terms(chosen):
        numbers = start.at[free].set(chosen)
        return Evaluation(least=parameters.evaluate(numbers, ("coverage",)))

    problem = make_soft_minimum(Problem(terms, low, high), 0.01)
    best = minimize(problem, start[free][None]).best
    found = values | dict(zip(parameters.free or (), best.parameters.tolist(), strict=True))
    assert parameters.judge(found)["coverage"] > after


def test_blur_is_judged_where_it_is_worst():
    tables = load_toml("scenes/lens.toml")
    tables["camera"]["max_blur_px"] = 3.0
    parameters = SceneParameters(DesignedScene.of(SceneFile.model_validate(tables), "lens"))
    values = parameters.values()
    blur = measured(parameters, values, "blur")["blur"]
    assert blur.shape == (1, 1)
    # The judgement takes the greatest of many places along each piece.
    assert parameters.judge(values)["blur"] == pytest.approx(float(blur[0, 0]), rel=1e-3)
    limits = {one.measure: one.value for one in parameters.requirements}
    assert limits["blur"] == 3.0


def test_room_for_a_module_is_between_nothing_and_the_distance():
    rng = np.random.default_rng(4)
    module = CameraModule(6.0, 5.0, 0.5, jnp.array([10.0, 8.0]), 1.5, 2.0)
    camera = Camera(jnp.array([3.0, -2.0]), 0.7, 1.5, 100.0, Pinhole(), module=module)
    ends = rng.uniform(-12, 12, (200, 2, 2))
    names = tuple(Surface(f"b{i}", 0) for i in range(len(ends)))
    lines = (Surface("camera module", 0),) * 6
    layout = Layout("", (), (), (), names, (), (), -1, 0, module=lines)
    none, flat = jnp.zeros((0, 2, 2)), jnp.zeros(0)
    hinges = jnp.zeros((0, 2))
    scene = Scene(camera, none, flat, flat, none, flat, jnp.asarray(ends), hinges, layout)
    room = np.asarray(find_module_room(scene, jnp.zeros((1, 0))))[0]
    turn = np.exp(0.7j)
    for index, box in enumerate([(-4.5, -3.0, 0.5, 3.0), (-8.0, -5.0, -4.5, 5.0)]):
        corners = np.array(shapely.box(*box).exterior.coords) @ [1, 1j] * turn + (3 - 2j)
        solid = shapely.Polygon(np.stack([corners.real, corners.imag], axis=-1))
        segments = shapely.linestrings(ends)
        distance = shapely.distance(segments, solid)
        np.testing.assert_array_equal(room[:, index] < 0, shapely.intersects(segments, solid))
        assert np.all(room[:, index] <= distance + 1e-9)
        # Only past a corner it is less.
        assert np.mean(np.isclose(room[:, index], distance)[distance > 0]) > 0.4
