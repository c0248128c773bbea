"""Contacts found in pictures that a path tracer has taken of fingers that touch something."""

from __future__ import annotations

from designopt.io.spec import Spec
from designopt.study.settings import setting
from designopt.study.study import Study, lazily
from studies.models.sensor.spec import MadeSpec


class ContactCheckSpec(Spec):
    """All settings of ``designopt run physical-check-contacts``."""

    fingers: int = setting(
        10, "fabricated fingers, one after the other of every light and layer", scales=True, ge=1
    )
    pressed: int = setting(6, "pictures of each with things pressed into its pads", ge=1, le=100)
    untouched: int = setting(
        2, "pictures of each without, where nothing may be found", ge=0, le=100
    )
    references: int = setting(4, "pictures of each that others are compared with", ge=1, le=100)
    pairs: int = setting(
        200, "pairs of rendered views of untouched pads, where nothing may be found", ge=0
    )
    tolerances: MadeSpec = MadeSpec()
    cache: str = setting(
        "", "folder that keeps pictures (empty: the user's cache folder)", free=True
    )


STUDY = Study(
    name="physical-check-contacts",
    purpose="Contacts found in a path tracer's pictures of pads, beside what is pressed in",
    spec=ContactCheckSpec,
    run=lazily("studies.physical_check.contacts.run:run"),
    needs=("judge",),
)
