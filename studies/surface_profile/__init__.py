"""Surfaces slid along the soft finger: their profile and kind from its chamber's images."""

from designopt.results import Results
from designopt.study import Context, Study
from studies.surface_profile.spec import SurfaceProfileSpec


def _run(spec: SurfaceProfileSpec, context: Context) -> Results:
    # Imported here, so that listing the study does not load JAX and OpenCV.
    from studies.surface_profile.run import run

    return run(spec, context)


STUDY = Study(
    name="surface-profile",
    purpose="Soft finger: profile and kind of a surface it is slid along, in px and in mm",
    spec=SurfaceProfileSpec,
    run=_run,
)
