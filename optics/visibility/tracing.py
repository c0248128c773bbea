"""Rays followed from surface to surface: nearest hit, reflection by equal angles, path length.

Which surface comes first is found without derivatives; the hit is then computed once more from
that surface alone and carries the derivatives with respect to ray, scene and pose.
"""

from __future__ import annotations

from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from designopt.numerics import as_float, safe_divide, safe_sqrt
from designopt.vectors import Vector, rotation, vector, where
from optics.scene.layers import MirrorLayers
from optics.scene.scene import Layout, Placed, Scene, place
from optics.visibility.curves import Arc, arc_between
from optics.visibility.unfolding import unit

NOTHING = -1
"""In place of a surface's index where a ray meets none."""


class Hits(eqx.Module):
    """Where rays go, leg by leg; arrays have the shape (..., legs) after the rays' axes.

    Attributes:
        surface: index of the surface that is met, mirrors before pads before blockers;
            `NOTHING` where there is none, or the ray has ended before.
        coordinate: where along it: 0 at its first end, 1 at its second (of a curved mirror along
            its chord); 0 where there is none. On a mirror behind layers it is that of the place
            where they end the ray, or where the coat reflects it.
        place: the point, mm, shape (..., legs, 2); where nothing is met, the point where the leg
            begins.
        direction: unit vector of the ray after it, shape (..., legs, 2).
        length: length of the path from the ray's start to it, mm.
        reflected: whether the ray goes on from there.
        active: whether it is the side that reflects, senses or blocks.
        sine: sine of the angle between ray and surface.
    """

    surface: Int[Array, "*rays legs"]
    coordinate: Float[Array, "*rays legs"]
    place: Float[Array, "*rays legs 2"]
    direction: Float[Array, "*rays legs 2"]
    length: Float[Array, "*rays legs"]
    reflected: Bool[Array, "*rays legs"]
    active: Bool[Array, "*rays legs"]
    sine: Float[Array, "*rays legs"]


@partial(jax.jit, static_argnames="bounces")
def trace_rays(
    scene: Scene,
    angles: Float[Array, " joints"],
    positions: Float[Array, "*rays 2"],
    directions: Float[Array, "*rays"],
    *,
    bounces: int,
) -> Hits:
    """Follow rays through a scene in one pose.

    Args:
        scene: the scene, with straight and curved mirrors.
        angles: joint angles in the order of ``scene.angle_names``, rad.
        positions: where the rays start, mm.
        directions: rad, counter-clockwise from +x.
        bounces: most reflections; so many legs and one more are followed.

    Returns:
        The hits. A ray ends at a pad, at a blocker, at the back of a mirror, and at the mirror
        after its last bounce; one-sided blockers let it pass from behind.

    Example:
        >>> from importlib.resources import files
        >>> from optics import read_scene
        >>> scene = read_scene(files("studies") / "gallery/scenes/periscope.toml")
        >>> hits = trace_rays(scene, jnp.zeros(0), jnp.zeros((1, 2)), jnp.zeros(1), bounces=2)
        >>> [
        ...     round(v, 3) for v in hits.length[0].tolist()
        ... ]  # to the lower mirror, the upper one, the pad
        [100.0, 400.0, 700.0]
    """
    placed = place(scene, as_float(angles))
    tracer = Tracer.of(scene, placed)

    def one(position: Float[Array, "2"], direction: Float[Array, ""]) -> Hits:
        start = vector(position) - placed.origin
        start = Vector(start.x / placed.size, start.y / placed.size)
        legs = tracer.follow(start, rotation(direction), bounces)
        at = placed.absolute(legs.place)
        return Hits(
            legs.surface,
            legs.coordinate,
            at.stacked(),
            legs.direction.stacked(),
            legs.length * placed.size,
            legs.reflected,
            legs.active,
            legs.sine,
        )

    positions, directions = as_float(positions), as_float(directions)
    for _ in directions.shape:
        one = jax.vmap(one)
    return one(positions, directions)


class Leg(eqx.Module):
    """One leg of a ray, in the units of the placed scene; see `Hits`."""

    surface: Int[Array, "*legs"]
    coordinate: Float[Array, "*legs"]
    place: Vector
    direction: Vector
    length: Float[Array, "*legs"]
    reflected: Bool[Array, "*legs"]
    active: Bool[Array, "*legs"]
    sine: Float[Array, "*legs"]


class Meeting(eqx.Module):
    """Where a ray meets a surface, extended beyond its ends.

    Attributes:
        distance: along the ray.
        coordinate: along the surface.
        normal: the unit normal to its left.
        horizon: of a curved mirror, what vanishes where the ray only touches it; 1 of others.
    """

    distance: Float[Array, ""]
    coordinate: Float[Array, ""]
    normal: Vector
    horizon: Float[Array, ""]


class _Ray(eqx.Module):
    position: Vector
    direction: Vector
    length: Float[Array, ""]
    last: Int[Array, ""]
    alive: Bool[Array, ""]


class Tracer(eqx.Module):
    """The surfaces of a scene in a pose, ready to be met by rays.

    Attributes:
        starts: first ends of all surfaces.
        ends: second ends.
        arcs: the curved mirrors.
        layout: the scene's layout.
        sheets: layers on mirrors, whose lines are the outermost surfaces of these.
    """

    starts: Vector
    ends: Vector
    arcs: Arc | None
    layout: Layout = eqx.field(static=True)
    sheets: MirrorLayers | None = None

    @classmethod
    def of(cls, scene: Scene, placed: Placed) -> Tracer:
        """The tracer of a placed scene."""
        arcs, curved = None, np.array(scene.layout.curved, int)
        if len(curved):
            start, end = placed.segment(curved)
            arcs = arc_between(start, end, placed.radii, scene.conics)
        return cls(placed.starts, placed.ends, arcs, scene.layout, placed.sheets)

    def follow(self, position: Vector, direction: Vector, bounces: int) -> Leg:
        """All legs of one ray, stacked.

        Args:
            position: where it starts.
            direction: a unit vector.
            bounces: most reflections.
        """

        def step(ray: _Ray, _: None) -> tuple[_Ray, Leg]:
            leg = self._leg(ray)
            if self.sheets is None:
                on = _Ray(leg.place, leg.direction, leg.length, leg.surface, leg.reflected)
                return on, leg
            return self._through(self.sheets, ray, leg)

        zero = jnp.zeros_like(position.x)
        ray = _Ray(position, direction, zero, jnp.asarray(NOTHING), jnp.asarray(True))
        return jax.lax.scan(step, ray, None, length=bounces + 1)[1]

    def _leg(self, ray: _Ray) -> Leg:
        layout = self.layout
        # Which surface is first has no slope; the hit itself is computed again below, so a reverse
        # pass goes through one crossing for each leg and not through all surfaces.
        still, frozen = jax.lax.stop_gradient((self, ray))
        found = still._nearest(frozen)
        surface = jnp.where(ray.alive, found[1], NOTHING)
        hit = self.meeting(ray.position, ray.direction, surface, found[0], ray.last)
        met = surface != NOTHING
        distance = jnp.where(met, hit.distance, 0.0)
        normal = Vector(jnp.where(met, hit.normal.x, 0.0), jnp.where(met, hit.normal.y, 0.0))
        toward = ray.direction.dot(normal)
        side = jnp.asarray(layout.sides, toward.dtype)[surface]
        active = met & (side * toward <= 0)
        reflected = active & (surface < len(layout.mirrors))
        bent = ray.direction - normal.scaled(2 * toward)
        direction = where(reflected, bent, ray.direction)
        return Leg(
            surface,
            jnp.where(met, hit.coordinate, 0.0),
            ray.position + ray.direction.scaled(distance),
            direction,
            ray.length + distance,
            reflected,
            active,
            jnp.abs(toward),
        )

    def _through(self, sheets: MirrorLayers, ray: _Ray, leg: Leg) -> tuple[_Ray, Leg]:
        """A leg to a mirror, whose layers the ray passes down to the coat and back, if it can.

        By Snell's law, n sin ϑ′ = sin ϑ, it goes t tan ϑ′ along the mirror on either way.
        """
        mirror = jnp.clip(leg.surface, 0, len(self.layout.mirrors) - 1)
        thickness = jnp.where(leg.reflected, sheets.thickness[mirror], 0.0)
        index, start, end = sheets.index[mirror], self.starts[mirror], self.ends[mirror]
        step = end - start
        along, length = unit(step), step.length()
        square = index**2 - 1 + leg.sine**2
        inside, _ = safe_divide(jnp.ones_like(square), safe_sqrt(square))
        forth = ray.direction.dot(along) * jnp.sum(thickness * inside)
        down = jnp.sum(thickness) * jnp.sign(along.cross(ray.direction))
        leaves, _ = safe_divide(2 * forth, length)
        leaves = leg.coordinate + leaves
        passes = leg.reflected & (leaves >= 0) & (leaves <= 1)
        out = leg.place + along.scaled(2 * forth)
        coat = leg.place + along.scaled(forth) + along.perpendicular().scaled(down)
        at_coat = (leg.coordinate + leaves) / 2
        longer = 2 * jnp.sum(thickness * index * inside)
        stopped = leg.reflected & ~passes
        # From behind a ray ends at the coat, before it comes to the outermost surface.
        behind = (leg.surface >= 0) & (leg.surface < len(self.layout.mirrors)) & ~leg.active
        deep = jnp.where(behind, jnp.sum(sheets.thickness[mirror]), 0.0)
        back, _ = safe_divide(deep, leg.sine)
        aside, _ = safe_divide(back * ray.direction.dot(along), length)
        found = Leg(
            leg.surface,
            jnp.where(passes, at_coat, leg.coordinate - aside),
            where(passes, coat, leg.place - ray.direction.scaled(back)),
            where(stopped, ray.direction, leg.direction),
            leg.length + jnp.where(passes, longer / 2, -back),
            passes,
            leg.active,
            leg.sine,
        )
        length = leg.length + jnp.where(passes, longer, 0.0)
        return _Ray(out, found.direction, length, leg.surface, passes), found

    def _nearest(self, ray: _Ray) -> tuple[Float[Array, ""], Int[Array, ""]]:
        """Distance and index of the first surface that a ray meets."""
        layout = self.layout
        curved = np.array(layout.curved, int)
        straight = np.setdiff1d(np.arange(len(layout.surfaces)), curved)
        starts, ends = jax.tree.map(lambda leaf: leaf[straight], (self.starts, self.ends))
        distances, along = _crossing(ray, starts, ends)
        step = ends - starts
        from_left = -step.cross(ray.direction)
        sides = jnp.asarray(layout.sides[straight], from_left.dtype)
        lets = jnp.asarray(layout.one_way[straight]) & (sides * from_left <= 0)
        hit = (distances > 0) & (along >= 0) & (along <= 1) & ~lets
        # By index and not by a least distance: that would depend on the scene's size, and lose a
        # mirror in a sharp corner.
        hit &= jnp.asarray(straight) != ray.last
        distances = jnp.where(hit, distances, jnp.inf)
        if self.arcs is not None:
            meet, on, _ = jax.vmap(_meet_arc, (None, 0, 0))(ray, self.arcs, jnp.asarray(curved))
            first = jnp.min(jnp.where(on, meet, jnp.inf), axis=1)
            distances = jnp.concatenate([distances, first])
        order = jnp.asarray(np.append(straight, curved))
        nearest = jnp.argmin(distances)
        distance = distances[nearest]
        return distance, jnp.where(jnp.isfinite(distance), order[nearest], NOTHING)

    def meeting(
        self,
        position: Vector,
        direction: Vector,
        surface: Int[Array, ""],
        near: Float[Array, ""],
        last: Int[Array, ""],
    ) -> Meeting:
        """Where a ray meets a given surface, or would if that went on beyond its ends.

        Args:
            position: where the ray begins.
            direction: its direction, a unit vector.
            surface: index of the surface.
            near: of two places on a curved mirror, the one nearer to this distance is meant.
            last: index of the surface on which the ray begins.
        """
        start, end = jax.tree.map(lambda leaf: leaf[surface], (self.starts, self.ends))
        ray = _Ray(position, direction, near, last, jnp.asarray(True))
        distance, coordinate = _crossing(ray, start, end)
        flat = Meeting(
            distance, coordinate, unit(end - start).perpendicular(), jnp.ones_like(distance)
        )
        if self.arcs is None:
            return flat
        curved = jnp.asarray(self.layout.curved)
        arc = jax.tree.map(lambda leaf: leaf[jnp.argmax(curved == surface)], self.arcs)
        roots, _, horizon = _meet_arc(ray, arc, surface)
        # Both roots carry derivatives; the one that the search has met is picked without.
        root = roots[jnp.argmin(jnp.abs(jax.lax.stop_gradient(roots - near)))]
        at = arc.local(position - arc.vertex) + arc.local(direction).scaled(root)
        across = safe_divide(at.x, 2 * arc.half)[0] + 0.5
        bent = Meeting(root, across, unit(arc.left_normal(at)).turned(arc.along), horizon)
        is_arc = jnp.any(curved == surface)
        return jax.tree.map(lambda yes, no: jnp.where(is_arc, yes, no), bent, flat)


def _meet_arc(
    ray: _Ray, arc: Arc, index: Int[Array, ""]
) -> tuple[Float[Array, "2"], Bool[Array, "2"], Float[Array, ""]]:
    position = arc.local(ray.position - arc.vertex)
    return arc.meetings(position, arc.local(ray.direction), index == ray.last)


def _crossing(
    ray: _Ray, start: Vector, end: Vector
) -> tuple[Float[Array, "*n"], Float[Array, "*n"]]:
    """Distance along a ray to lines, and the coordinate along them; 0 and 0 where parallel."""
    toward, step = start - ray.position, end - start
    cross = ray.direction.cross(step)
    distance, _ = safe_divide(toward.cross(step), cross)
    coordinate, _ = safe_divide(toward.cross(ray.direction), cross)
    return distance, coordinate
