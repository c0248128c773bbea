"""A study of one's own: how a crank's error reaches a rocker; ``python examples/own_study.py``."""

from importlib.resources import files

import jax
import jax.numpy as jnp
import numpy as np

from designopt import Context, Records, Report, Results, Spec, Study, run_study, setting
from designopt.study import plots
from kinematics import read_linkage, solve_poses

WORDS = """
# Metrics
worst_rms_deg [<= 0.5]: largest standard deviation of the rocker's angle
linear_share [>= 0.95]: least part of it that the slope alone predicts
# Findings
main: A crank {deviation_deg:g}° off turns the rocker by {worst_rms_deg:.2f}° at worst.
# Tables
spread [* angle_deg:0]: Standard deviation of the rocker's angle, of {draws} draws and by its slope
# Figures
spread: The rocker's error over the crank's angle
"""


class CrankSpec(Spec):
    """Settings."""

    draws: int = setting(1000, "errors drawn at each angle", scales=True, ge=2, le=100_000)
    deviation_deg: float = setting(0.5, "standard deviation of the crank's angle (°)", gt=0, le=10)


def run(spec: CrankSpec, context: Context) -> Results:
    """Draw errors, propagate them through poses and through the slope, compare."""
    linkage = read_linkage(str(files("studies") / "gallery/linkages/four-bar.toml"))

    def rocker(angle: jax.Array) -> jax.Array:
        return jnp.rad2deg(solve_poses(linkage, angle[None]).value.angle("rocker"))

    out, errors = Report(spec, WORDS), Records()
    drawn = np.random.default_rng(context.seed).normal(0, spec.deviation_deg, spec.draws)
    slopes = jax.jit(jax.vmap(jax.grad(rocker)))(angles := jnp.deg2rad(jnp.arange(30.0, 150, 15)))
    rockers = jax.jit(jax.vmap(jax.vmap(rocker)))(angles[:, None] + np.deg2rad(drawn)[None])
    for angle, slope, turned in zip(np.rad2deg(angles).round(), slopes, rockers, strict=True):
        both = np.std(turned), abs(float(jnp.deg2rad(slope))) * np.std(drawn)
        errors.add(angle_deg=angle, way=["draws", "slope"], deviation_deg=both)
    sampled, linear = (errors.where(way=way)["deviation_deg"] for way in ("draws", "slope"))
    out.metrics(worst_rms_deg=sampled.max(), linear_share=(linear / sampled).min())
    out.say("main")
    out.table("spread", errors)
    out.figure("spread", plots.lines(errors, "angle_deg", "deviation_deg", by="way"))
    return out.results()


STUDY = Study("crank-error", "How an error of the crank reaches the rocker", CrankSpec, run)

if __name__ == "__main__":
    print(*run_study(STUDY, out="out/crank-error").findings)
