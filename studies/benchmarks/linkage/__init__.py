"""Error against run time of linkage poses: closed form, iterations and other people's tools."""

from __future__ import annotations

from typing import Literal

from designopt.io.spec import Spec
from designopt.study.settings import setting
from designopt.study.study import Study, lazily


class LinkagePrecisionSpec(Spec):
    """All settings of ``designopt run linkage-precision``; targets belong to the longest sweep."""

    poses: int = setting(
        1_000_000, "poses of the longest sweep, one turn", scales=True, ge=10, le=4_000_000
    )
    repeats: int = setting(5, "timed repeats of each setting", free=True, ge=3, le=1000)
    linkage: Literal["all", "four-bar", "slider-crank", "six-bar"] = setting(
        "all", "which linkages: all of them, or one", free=True
    )
    optimistix: bool = setting(True, "measure Optimistix as well", free=True)
    gradients: bool = setting(True, "measure gradients as well", free=True)
    float32: bool = setting(True, "measure in float32 as well", free=True)
    peers: bool = setting(
        True, "measure mechanism and pylinkage where they are installed", free=True
    )
    first_call: bool = setting(
        True, "time the first call of four-bar and finger in fresh processes", free=True
    )


STUDY = Study(
    name="linkage-precision",
    purpose="Error against run time of linkage poses: closed form, iterations and other tools",
    spec=LinkagePrecisionSpec,
    run=lazily("studies.benchmarks.linkage.run:run"),
)
