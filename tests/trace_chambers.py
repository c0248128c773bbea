"""Traces tests/data/chamber_*.png: ``python -m tests.trace_chambers``, with the extra 'judge'.

The paper's chamber with wet, dusty walls, straight and bent by 40° to each side: few samples, so
that rare paths of light leave speckles, and no filter.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from studies.oracles.chamber_light import Frame, expose, trace

DATA = Path(__file__).parent / "data"

STRAIGHT = Frame(
    lengths=(40.0, 30.0, 30.0),
    radii=(12.72, 10.62, 9.57, 6.07),
    pinhole=0.84,
    distortion=-0.1,
    columns=320,
    rows=240,
    coat=1.41,
    roughness=0.03,
    dust=40,
)

TOWARDS_DEG = {"right": 8.0, "down": 82.0, "left": 187.0, "up": 275.0}


def main() -> None:
    """Trace, expose so that a hundredth of the pixels is brighter than 0.9, and write."""
    bent = {
        name: replace(STRAIGHT, bend=math.radians(40), direction=math.radians(towards))
        for name, towards in TOWARDS_DEG.items()
    }
    for name, frame in {"straight": STRAIGHT, **bent}.items():
        light = trace(frame)
        picture = expose(light, 0.9 / np.percentile(light.max(axis=-1), 99))
        cv2.imwrite(str(DATA / f"chamber_{name}.png"), picture[..., ::-1])


if __name__ == "__main__":
    main()
