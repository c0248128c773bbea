"""Everything that the study measures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, UInt8

from designopt.study.results import PrecisionRow
from studies.bending_posture.elsewhere import Elsewhere
from studies.bending_posture.odd import AtBend, Odd
from studies.bending_posture.trainings import OURS, Data, Trained


@dataclass(frozen=True)
class AtEta:
    """Postures read from one chamber.

    Attributes:
        eta: its η.
        rings: widths of the blue and the yellow ring, straight, px.
        rate: px per degree of bend by which yellow's outline starts to move; None where it cannot.
        clearance: Δl_A − |Δl_D|: how far the wall at D stays inside that at A, mm.
        unusable: frames that showed no chamber and were left out.
        tip_errors: mean over unseen images of each training, mm.
    """

    eta: float
    rings: tuple[float, float]
    rate: float | None
    clearance: float
    unusable: int
    tip_errors: tuple[float, ...]


@dataclass(frozen=True)
class Shown:
    """What becomes of one picture.

    Attributes:
        bend_deg: of the finger.
        pixels: the picture.
        labels: its regions.
        small: the boundary image that the network sees.
    """

    bend_deg: float
    pixels: UInt8[np.ndarray, "rows columns 3"]
    labels: UInt8[np.ndarray, "rows columns"]
    small: Float[np.ndarray, "small_rows small_columns"]


@dataclass(frozen=True)
class Found:
    """What the study measures.

    Attributes:
        data: samples of the spec's finger.
        trained: networks of every way, by seed.
        sweep: L2 regularisations of standardised labels, each with the tip error, mm.
        paper: what the paper's 0.01 is among them, by the unit of its loss.
        rows: error against training time.
        etas: chambers compared.
        elsewhere: tip errors under other lamps and in other fingers.
        bends: tip errors from 0.01° to 120°.
        odd: frames that are no proper images.
        seconds: of one frame, from picture to markers.
        cores: that were there for all of this; OpenCV has one of them.
        shown: pictures.
    """

    data: Data
    trained: dict[str, list[Trained]]
    sweep: list[tuple[float, float]]
    paper: dict[str, float]
    rows: list[PrecisionRow]
    etas: list[AtEta]
    elsewhere: list[Elsewhere]
    bends: list[AtBend]
    odd: list[Odd]
    seconds: float
    cores: int
    shown: list[Shown]

    def tips(self, way: str) -> list[float]:
        """Mean tip errors of a way's trainings, mm."""
        return [one.tip_error for one in self.trained[way]]

    def ratios(self, way: str) -> list[float]:
        """Tip errors of a way over those of the study's own, seed by seed."""
        return [a / b for a, b in zip(self.tips(way), self.tips(OURS), strict=True)]
