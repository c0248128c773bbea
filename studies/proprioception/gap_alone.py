"""The gap without images: corners of made fingers with a stated noise, and five labelled frames."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from perception.proprioception import GapTable, calibrate_gap, make_undefined
from studies.models.sensor.finger_sensor import FingerSensor
from studies.proprioception.ladder import Answer
from studies.proprioception.watching import spread_over

METHOD = "1 gap, corners with stated noise"


def tried(
    finger: FingerSensor,
    tables: list[GapTable],
    *,
    fingers: int,
    frames: int,
    labelled: int,
    label_deviation: float,
    noise: float,
    seed: int,
) -> list[Answer]:
    """Joint angles by the gap where both views have facing ends.

    Args:
        finger: as designed.
        tables: the gap of every joint.
        fingers: how many made ones.
        frames: random frames of each joint.
        labelled: frames for the calibration.
        label_deviation: of their labels, rad.
        noise: standard deviation of every corner's column and row, px.
        seed: of everything random.
    """
    model, answers = finger.model, []
    predict = eqx.filter_jit(eqx.filter_vmap(model.predict, in_axes=(None, 0)))
    pixel = noise / float(finger.scene.camera.focal_pixels)
    limits = [(float(table.angles[0]), float(table.angles[-1])) for table in tables]
    for number in range(fingers):
        generator = np.random.default_rng([seed, 9, number])
        _, errors = finger.made(seed, number)
        told = spread_over(limits, labelled)
        asked = np.stack([generator.uniform(*limit, frames) for limit in limits], axis=-1)
        corners = np.array(predict(jnp.asarray(errors), jnp.asarray(np.concatenate([told, asked]))))
        corners += generator.normal(0, noise, corners.shape)
        labels = told + label_deviation * generator.standard_normal(told.shape)
        rays = np.stack([finger.lens.rays(c.reshape(-1, 2)).reshape(c.shape) for c in corners])
        for joint, table in enumerate(tables):
            first, second = (
                rays[:, model.views.index((table.pad, path)), [end, 3 - end], 0].mean(axis=-1)
                for path, end in zip(("direct", table.mirror), table.ends, strict=True)
            )
            gaps = np.abs(first - second)
            meter = calibrate_gap(
                table,
                gaps[:labelled],
                labels[:, joint],
                noise=pixel,
                label_deviation=label_deviation,
            )
            for index, gap in enumerate(gaps[labelled:]):
                estimate = (
                    make_undefined("the gap could not be calibrated")
                    if meter is None
                    else meter.estimate(gap)
                )
                truth = float(asked[index, joint])
                answers.append(Answer(METHOD, number, index, model.names[joint], truth, estimate))
    return answers
