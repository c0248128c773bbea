"""A scene sampled by rays of given angles: what each of them meets."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from designopt.vectors import Vector, rotation
from optics.scene.camera import Camera
from optics.scene.scene import Layout, Placed, Scene
from optics.visibility.tracing import NOTHING, Leg, Tracer
from optics.visibility.unfolding import padded

FLAT = 2**14
"""A pad coordinate that changes by fewer units of rounding per rad of the ray does not change."""


class Fan(eqx.Module):
    """A scene in a pose and the paths that are distinguished; angles are those from the axis, rad.

    Attributes:
        camera: the camera.
        placed: the scene in the pose.
        tracer: its surfaces.
        grazing: least angle between each pad and a ray that shows it, rad.
        layout: the scene's layout.
        words: the mirrors along every path.
    """

    camera: Camera
    placed: Placed
    tracer: Tracer
    grazing: Float[Array, " pads"]
    layout: Layout = eqx.field(static=True)
    words: tuple[tuple[int, ...], ...] = eqx.field(static=True)

    @classmethod
    def of(cls, scene: Scene, placed: Placed, words: list[tuple[int, ...]]) -> Fan:
        """The fan of a placed scene, over given paths."""
        tracer = Tracer.of(scene, placed)
        return cls(scene.camera, placed, tracer, scene.grazing, scene.layout, tuple(words))

    @property
    def bounces(self) -> int:
        """Most reflections of a path."""
        return max(len(word) for word in self.words)

    def heading(self, angle: Float[Array, ""]) -> Vector:
        """Unit vector of a ray as it leaves the camera."""
        return self.placed.axis.turned(rotation(angle))

    def start(self, angle: Float[Array, ""]) -> Vector:
        """Where a ray passes the entrance pupil."""
        if self.camera.pupil_shift is None:
            return self.placed.camera
        shift = self.camera.pupil_at(angle) / self.placed.size
        return self.placed.camera + self.placed.axis.scaled(shift)

    def follow(self, angle: Float[Array, ""]) -> Leg:
        """All legs of a ray."""
        return self.tracer.follow(self.start(angle), self.heading(angle), self.bounces)

    def reach(self, legs: Leg) -> tuple[Int[Array, ""], Int[Array, ""], Bool[Array, ""]]:
        """The pad that a ray reaches, on which leg, and whether it is seen there."""
        mirrors, pads = len(self.layout.mirrors), len(self.layout.pads)
        pad = legs.surface - mirrors
        is_pad = (pad >= 0) & (pad < pads) & legs.active
        leg = jnp.argmax(is_pad)
        pad = jnp.where(is_pad[leg], pad[leg], 0)
        return pad, leg, is_pad[leg] & (legs.sine[leg] >= jnp.sin(self.grazing[pad]))

    def path(self, legs: Leg, leg: Int[Array, ""]) -> Int[Array, ""]:
        """Index of the path that a ray has taken up to a leg."""
        words = np.pad(padded(self.words), ((0, 0), (0, 1)), constant_values=NOTHING)
        before = jnp.arange(self.bounces + 1) < leg
        taken = jnp.where(before, legs.surface, NOTHING)
        return jnp.argmax(jnp.all(jnp.asarray(words) == taken[None], axis=1))

    def label(self, angle: Float[Array, ""]) -> Int[Array, ""]:
        """A number for what a ray sees: 0 for nothing, else by pad, path and sense."""

        def coordinate(angle: Float[Array, ""]) -> tuple[Float[Array, ""], Leg]:
            legs = self.follow(angle)
            return legs.coordinate[self.reach(legs)[1]], legs

        _, slope, legs = jax.jvp(coordinate, (angle,), (jnp.ones_like(angle),), has_aux=True)
        pad, leg, seen = self.reach(legs)
        # Where all rays meet in one point of the pad its sense is but rounding.
        rises = (slope > FLAT * jnp.finfo(slope.dtype).eps).astype(int)
        number = (self.path(legs, leg) * len(self.layout.pads) + pad) * 2 + rises
        return jnp.where(seen, 1 + number, 0)

    def meaning(
        self, label: Int[Array, ""]
    ) -> tuple[Int[Array, ""], Int[Array, ""], Int[Array, ""]]:
        """Pad, path and last leg of a label that stands for something."""
        number = jnp.maximum(label - 1, 0) // 2
        path, pad = number // len(self.layout.pads), number % len(self.layout.pads)
        return pad, path, jnp.asarray([len(word) for word in self.words])[path]
