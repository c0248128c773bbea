"""Tactile images of the finger: its pads found in synthetic images, unwarped, and compared."""

from designopt.results import Results
from designopt.study import Context, Study
from studies.tactile_images.spec import TactileImagesSpec


def _run(spec: TactileImagesSpec, context: Context) -> Results:
    # Imported here, so that listing the study does not load JAX and OpenCV.
    from studies.tactile_images.run import run

    return run(spec, context)


STUDY = Study(
    name="tactile-images",
    purpose="Images of the finger: every view found, unwarped, and imprints made visible",
    spec=TactileImagesSpec,
    run=_run,
)
