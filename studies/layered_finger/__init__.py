"""What today's finger sees through clear layers on its pads, and with a lens as it is sold."""

from __future__ import annotations

from designopt import Spec, Study, lazily, setting
from studies.models.sensor.spec import MadeSpec


class LayeredFingerSpec(Spec):
    """All settings of ``designopt run layered-finger``."""

    angles: int = setting(
        91, "angles of each joint, of which all pairs are looked at", scales=True, ge=2, le=181
    )
    redesign: bool = setting(True, "search for other mirrors under some of the layers")
    tolerances: MadeSpec = MadeSpec()
    made: int = setting(
        200, "fingers with random errors, those of layers among them", scales=True, ge=1, le=10_000
    )
    rays: int = setting(
        2000, "rays of the brute-force check of each worst posture", scales=True, ge=100, le=10**6
    )


STUDY = Study(
    name="layered-finger",
    purpose="Today's finger under clear layers and with a lens as sold: what is lost, and why",
    spec=LayeredFingerSpec,
    run=lazily("studies.layered_finger.run:run"),
)
