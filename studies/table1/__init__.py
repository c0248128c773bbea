"""Paper A's Table I: what the printed equations and constants give, and what the table follows."""

from __future__ import annotations

from pydantic import model_validator

from designopt import Spec, Study, lazily, setting
from studies.models.soft_finger.spec import CLEARANCE, ChamberSpec


class Table1Spec(Spec):
    """All settings of ``designopt run table1``; defaults are paper A's chamber (§II.A)."""

    chamber: ChamberSpec = ChamberSpec()
    clearance: float = setting(
        CLEARANCE, "how far |Δl_D| must stay inside Δl_A when η is chosen (mm)", free=True, gt=0
    )
    f_number: float = setting(
        2.8,
        "f-number of the real lens set beside Eq. 1; the paper gives none",
        free=True,
        ge=0.1,
        le=1000,
    )
    blur: float = setting(
        0.003,
        "blur spot that counts as sharp, about a pixel of an endoscope (mm)",
        free=True,
        ge=1e-6,
        le=10,
    )
    precision: bool = setting(True, "measure error against run time", free=True)
    precision_problems: int = setting(
        100_000, "problems in a batch of the run-time study", free=True, ge=1, le=10_000_000
    )
    precision_repeats: int = setting(5, "timed repeats of each setting", free=True, ge=3, le=1000)
    stability: bool = setting(True, "run the stiff and extreme cases", free=True)

    @model_validator(mode="after")
    def _clearance_leaves_room(self) -> Table1Spec:
        if self.clearance >= self.chamber.offset_a:
            raise ValueError(
                f"clearance ({self.clearance:g} mm) must be smaller than chamber.offset_a "
                f"({self.chamber.offset_a:g} mm), or no Δl_D is left"
            )
        return self


STUDY = Study(
    name="table1",
    purpose="Chamber imaging and Table I of paper A: as printed, and with identified constants",
    spec=Table1Spec,
    run=lazily("studies.table1.run:run"),
    design=lazily("studies.table1.analysis:design"),
    batch=lazily("studies.table1.run:run_batch"),
)
