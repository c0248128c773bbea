"""A contact: its place and size, from one view of its pad or from several."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

CORNERS = 72
"""Of the polygon that an outline is."""


@dataclass(frozen=True, eq=False)
class Contact:
    """Something round that is pressed into a pad.

    Attributes:
        pad: name of the pad.
        paths: names of the paths by which it was seen.
        center: along the pad from its first end and across it from its middle, mm.
        diameter: of the contact's edge: of the circle along which the membrane leaves what presses,
            where it is steepest, mm.
        covariance: of the center's two coordinates and of the diameter, mm².
        depth: by which the membrane is lifted, mm; a rough estimate.
        strength: of the change of light, over the noise of samples.

    Example:
        >>> covariance = np.diag([0.01, 0.01, 0.04])
        >>> contact = Contact("tip", ("direct",), np.array([8.0, 1.0]), 4.0, covariance, 0.5, 60.0)
        >>> contact.deviations.tolist(), contact.outline[0].tolist()
        ([0.1, 0.1, 0.2], [10.0, 1.0])
    """

    pad: str
    paths: tuple[str, ...]
    center: Float[np.ndarray, "2"]
    diameter: float
    covariance: Float[np.ndarray, "3 3"]
    depth: float
    strength: float

    @property
    def deviations(self) -> Float[np.ndarray, "3"]:
        """Standard deviations of the center's two coordinates and of the diameter, mm."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def measured(self) -> Float[np.ndarray, "3"]:
        """The center's two coordinates and the diameter, mm."""
        return np.array([*self.center, self.diameter])

    @property
    def outline(self) -> Float[np.ndarray, "corners 2"]:
        """Its edge, a closed polygon without its first point again, mm."""
        angles = np.arange(CORNERS) * (2 * np.pi / CORNERS)
        way = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
        return self.center + self.diameter / 2 * way


def fuse_contacts(contacts: Iterable[list[Contact]]) -> list[Contact]:
    """Contacts of several views of pads, each once, the strongest first.

    Contacts of one pad whose centers are nearer than the larger one's radius, or that agree within
    their deviations, are one. They are combined by inverse covariance; where they disagree by more
    than their deviations, the covariance grows by χ² over its degrees of freedom (R. Birge, Phys.
    Rev. 40 (1932) 207). What only one view has stays.

    Args:
        contacts: those of each view.

    Example:
        >>> def seen(path, diameter):
        ...     covariance = np.diag([0.02, 0.02, 0.08])
        ...     return Contact("tip", (path,), np.zeros(2), diameter, covariance, 0.5, 60.0)
        >>> (fused,) = fuse_contacts([[seen("direct", 4.0)], [seen("mirror", 4.2)]])
        >>> fused.paths, round(fused.diameter, 3), fused.deviations.round(3).tolist()
        (('direct', 'mirror'), 4.1, [0.1, 0.1, 0.2])
    """
    every = sorted((one for view in contacts for one in view), key=lambda one: -one.strength)
    groups: list[list[Contact]] = []
    for one in every:
        group = next((group for group in groups if _is_one(group, one)), None)
        if group is None:
            groups.append([one])
        else:
            group.append(one)
    return sorted(map(_combined, groups), key=lambda one: -one.strength)


AGREE = 16.27
"""χ² of three degrees of freedom that chance exceeds once in a thousand times."""


def _is_one(group: list[Contact], one: Contact) -> bool:
    """Whether a contact is that of a group from other views."""
    if any(other.pad != one.pad or set(other.paths) & set(one.paths) for other in group):
        return False
    first = group[0]
    off = one.measured - first.measured
    chi_squared = off @ np.linalg.solve(one.covariance + first.covariance, off)
    near = np.hypot(*off[:2]) < max(one.diameter, first.diameter) / 2
    return bool(near or chi_squared < AGREE)


def _combined(group: list[Contact]) -> Contact:
    if len(group) == 1:
        return group[0]
    weights = [np.linalg.inv(one.covariance) for one in group]
    covariance = np.linalg.inv(sum(weights))
    mean = covariance @ sum(w @ one.measured for w, one in zip(weights, group, strict=True))
    off = [one.measured - mean for one in group]
    chi_squared = sum(float(d @ w @ d) for w, d in zip(weights, off, strict=True))
    covariance = covariance * max(1.0, chi_squared / (3 * (len(group) - 1)))
    strength = float(np.sqrt(sum(one.strength**2 for one in group)))
    paths = tuple(path for one in group for path in one.paths)
    pad, depth = group[0].pad, group[0].depth
    return Contact(pad, paths, mean[:2], float(mean[2]), covariance, depth, strength)
