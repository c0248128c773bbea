"""The layers of a pad in the section as plain numbers in mm, and rays on their way through them."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from optics.scene.layers import GREEN, BodyFace, EndKind
from optics.scene.scene import Scene

Points = Float[np.ndarray, "_ 2"]


class EndFace(NamedTuple):
    """An end face of a layer.

    Attributes:
        line: its ends, the membrane's side first, mm.
        kind: whether light comes through.
    """

    line: Points
    kind: EndKind


@dataclass(frozen=True)
class LayerSection:
    """The layers of one pad in a pose, mm.

    Attributes:
        membrane: ends of the membrane.
        layers: outlines of the layers, the outermost first: along the membrane's side and back.
        ends: of every layer its end faces, at the pad's first and second end.
        ledges: what levels leave free of a layer on one of their sides.
        bezel: outlines of the bezel's two parts, if there is one.
        index: of refraction, of every layer, in green light.
    """

    membrane: Points
    layers: tuple[Points, ...]
    ends: tuple[tuple[EndFace, EndFace], ...]
    ledges: tuple[Points, ...]
    bezel: tuple[Points, ...]
    index: tuple[float, ...]

    def outlines(self) -> list[Points]:
        """Closed outlines of layers and bezel."""
        return [np.vstack([part, part[:1]]) for part in (*self.layers, *self.bezel)]

    def through(
        self, before: Sequence[Sequence[float]], layer: int, end: int | None
    ) -> list[tuple[float, float]]:
        """Where a ray goes behind the surface that it meets, by Snell's law, down to the membrane.

        Args:
            before: where it leaves a mirror or the camera, and where it meets the surface.
            layer: the layer that it enters.
            end: whether through its end face at the pad's first or second end; otherwise it enters
                through its side towards the camera.

        Returns:
            Where it meets every surface behind, as far as it comes.
        """
        start, place = (complex(*point) for point in before)
        ray = (place - start) / abs(place - start)
        outline = self.layers[layer]
        surface = outline[[3, 2]] if end is None else self.ends[layer][end].line
        met, index = [], 1.0
        for lower, below in zip(self.layers[layer:], self.index[layer:], strict=True):
            ray = _refracted(ray, surface, below / index)
            surface, index = lower[:2], below
            first, last = _ends(surface)
            across = _cross(last - first, ray)
            if not ray or not across:
                break
            place += ray * _cross(last - first, first - place) / across
            met.append((place.real, place.imag))
        return met


def _ends(surface: Points) -> tuple[complex, complex]:
    first, last = surface.tolist()
    return complex(*first), complex(*last)


def _cross(first: complex, second: complex) -> float:
    return (first.conjugate() * second).imag


def _refracted(ray: complex, surface: Points, ratio: float) -> complex:
    """A ray's unit vector behind a surface, where the index is larger by a factor; 0 for none."""
    first, last = _ends(surface)
    along = (last - first) / abs(last - first)
    # n sin θ, the part along the surface, stays (M. Born, E. Wolf, Principles of Optics, §1.5.1).
    part = ray * along.conjugate()
    square = 1 - (part.real / ratio) ** 2
    if square <= 0:
        return 0j
    return along * complex(part.real / ratio, math.copysign(math.sqrt(square), part.imag))


def stacks_of(scene: Scene, lines: Sequence[Points]) -> tuple[LayerSection | None, ...]:
    """The layers of every pad; none where a pad has none.

    Args:
        scene: the scene.
        lines: ends of all surfaces, in the order of ``Layout.surfaces``, mm.
    """
    layout = scene.layout
    if scene.layers is None:
        return (None,) * len(layout.pads)
    first = len(lines) - len(layout.bodies)
    index = np.asarray(scene.layers.index, float)[..., GREEN]
    overhang = np.asarray(scene.layers.overhang, float)
    bodies = list(zip(layout.bodies, lines[first:], strict=True))
    return tuple(
        _stack([pair for pair in bodies if pair[0].pad == pad], index[pad], overhang[pad])
        if kinds
        else None
        for pad, kinds in enumerate(layout.layers)
    )


def _stack(
    faces: Sequence[tuple[BodyFace, Points]],
    index: Float[np.ndarray, " layers"],
    overhang: Float[np.ndarray, "layers 2"],
) -> LayerSection:
    """The layers of a pad from the faces of its body."""
    ends = [EndFace(line, face.kind) for face, line in faces if face.part == "end"]
    pairs = tuple(zip(ends[::2], ends[1::2], strict=True))
    layers = tuple(
        np.array([first.line[0], second.line[0], second.line[1], first.line[1]])
        for first, second in pairs
    )
    edges = [line for face, line in faces if face.part in ("rim", "lip")]
    lower, longer = layers[-1][:2], overhang[len(layers) - 1]
    along = (lower[1] - lower[0]) / math.dist(*lower)
    return LayerSection(
        membrane=lower + np.outer([1, -1] * longer, along),
        layers=layers,
        ends=pairs,
        ledges=tuple(
            np.array([above.line[0], below.line[1]])
            for pair in itertools.pairwise(pairs)
            for above, below in zip(*pair, strict=True)
        ),
        bezel=tuple(np.vstack(pair) for pair in _bezel(edges)),
        index=tuple(index[: len(layers)].tolist()),
    )


def _bezel(edges: Sequence[Points]) -> Iterator[tuple[Points, Points]]:
    """Of each part of a bezel its outer side, and its inner side from above."""
    for rim, lip in zip(edges[::2], edges[1::2], strict=True):
        yield rim, lip[::-1]
