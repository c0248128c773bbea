"""Earlier names of `studies.models.soft_finger.robustness`, while studies still use them."""

from studies.models.soft_finger.robustness import DISTURBANCES as KINDS
from studies.models.soft_finger.robustness import Disturbance as Kind
from studies.models.soft_finger.robustness import Picture, status_words
from studies.models.soft_finger.robustness import disturbed_frames as odd_pictures

__all__ = ["KINDS", "Kind", "Picture", "odd_pictures", "status_words"]
