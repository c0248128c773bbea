"""Error against run time of visibility: exact intervals, sampling, rays and other tracers."""

from __future__ import annotations

from typing import Literal

from designopt.io.spec import Spec
from designopt.study.settings import setting
from designopt.study.study import Study, lazily


class VisibilityPrecisionSpec(Spec):
    """All settings of ``designopt run visibility-precision``; targets belong to the first two."""

    samples: Literal[64, 256, 1024, 4096, 16384, 65536] = setting(
        65536, "most points or rays of a method; the least is 64", scales=True
    )
    reference_rays: int = setting(
        4_000_000, "rays of the reference", scales=True, ge=1000, le=20_000_000
    )
    repeats: int = setting(5, "timed repeats of each setting", free=True, ge=3, le=1000)
    flexion: bool = setting(True, "measure a sweep of poses besides one pose", free=True)
    edge_refined: bool = setting(
        True, "measure edge-refined rays, and the gallery's curved mirrors", free=True
    )
    gallery: bool = setting(True, "compare the scenes of the gallery", free=True)
    grid: bool = setting(True, "time the finger over a grid of poses", free=True)
    tracers: bool = setting(True, "compare ray tracers", free=True)
    peers: bool = setting(
        True, "measure optiland and rayoptics where they are installed", free=True
    )
    left_out: bool = setting(True, "count operations left out", free=True)


STUDY = Study(
    name="visibility-precision",
    purpose="Error against run time of visibility: exact intervals, sampling, rays, other tracers",
    spec=VisibilityPrecisionSpec,
    run=lazily("studies.benchmarks.visibility.run:run"),
)
