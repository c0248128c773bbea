"""When a study's targets apply."""

from __future__ import annotations

from collections.abc import Mapping

from designopt.io.spec import Spec


def stated(spec: Spec, *, free: frozenset[str], least: Mapping[str, int]) -> bool:
    """Whether a run is one that targets are asked of.

    They are asked of the default settings, of as many images at least; settings that touch no
    target are free.

    Args:
        spec: of the run.
        free: names of settings that touch none.
        least: least values of settings that only make a result surer the larger they are.
    """
    default = type(spec)()
    apart = free | set(least)
    same = spec.model_dump(exclude=set(apart)) == default.model_dump(exclude=set(apart))
    return same and all(getattr(spec, name) >= value for name, value in least.items())
