"""What a pinch asks of motor, pins and bars: every link in balance, in closed form.

A pinch holds a force on the straight distal pad. Rod, bar and coupler are two-force members, so the
balance of crank, plate and distal phalanx gives their forces one after the other. Both sides of the
finger carry half of them. Without friction, weight and deformation.
"""

from __future__ import annotations

import math

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from designopt.numerics import safe_divide
from designopt.vectors import Vector, rotation
from studies.models.finger import Finger, links_of, spring_of
from studies.models.linkage_design.postures import find_postures
from studies.models.links import AXLES

SIDES = 2
"""Linkages side by side."""


class Loads(eqx.Module):
    """What pins and bars carry over angles of PIP; all of both sides together.

    Attributes:
        pins: size of the force on every pin, N, by its name.
        bending: largest bending moment in a bar, N mm, by its name.
        axial: largest force along a bar, N, by its name.
    """

    pins: dict[str, Float[Array, " pip"]]
    bending: dict[str, Float[Array, " pip"]]
    axial: dict[str, Float[Array, " pip"]]


class PinchForces(Loads):
    """A pinch over angles of PIP.

    Attributes:
        crank_moment: T_a, with which the motor holds it, N mm.
        stop: λ, moment of the DIP joint's stop, N mm, positive while the pad stays straight.
    """

    crank_moment: Float[Array, " pip"]
    stop: Float[Array, " pip"]


def find_pinch_forces(
    finger: Finger, pip: Float[Array, " pip"], force: ArrayLike, place: ArrayLike
) -> PinchForces:
    """The balance of a pinch with the straight distal pad.

    Args:
        finger: with pins and spring.
        pip: flexion of PIP, rad.
        force: on the pad at right angles, N.
        place: k₂ along the pad from the DIP axis, mm.

    Source: Birglen, Laliberté & Gosselin, *Underactuated Robotic Hands*, 2008, ch. 3, for moment
    and stop; the links' balances are this project's.

    Example:
        >>> from studies.models import packaged_finger
        >>> found = find_pinch_forces(packaged_finger(), jnp.zeros(1), 5.0, 30.5)
        >>> round(float(found.crank_moment[0]))  # N mm
        289
    """
    found = find_postures(finger, pip, jnp.zeros(1))
    knuckle, body, spring = rotation(-pip), finger.body, spring_of(finger)
    at = {name: _column(where).turned(knuckle) for name, where in found.inner.items()}
    at |= {name: _column(where) for name, where in found.outer.items()}
    zero = jnp.zeros_like(body.intermediate)
    at["B"] = Vector(body.intermediate, zero).turned(knuckle)
    touched = Vector(body.intermediate + place, zero + body.palmar).turned(knuckle)
    push = Vector(zero, zero + force).turned(knuckle)

    moment = jnp.asarray(force * (place + body.intermediate) / found.pip_ratio[:, 0])
    arm, along = at["E"] - at["F"], _unit(at["D"] - at["E"])
    rod = along.scaled(_over(-moment, arm.cross(along)))
    pull = None
    if finger.motor is not None:
        towards = _unit(at["M"] - at["F"])
        pull = towards.scaled(_over(-moment, (at["K"] - at["F"]).cross(towards)))
    # The spring turns the plate clockwise, which closes, and the distal phalanx back.
    wound = spring.stiffness * spring.preload
    along = _unit(at["G"] - at["H"])
    free = wound - (at["D"] - at["C"]).cross(rod)
    bar = along.scaled(_over(free, (at["H"] - at["C"]).cross(along)))
    on_distal = rod + bar
    axle_b = -(on_distal + push)
    stop = (at["C"] - at["B"]).cross(on_distal) + (touched - at["B"]).cross(push) + wound

    at_crank = rod if pull is None else rod - pull
    forces = {"A": axle_b + bar, "B": axle_b, "C": on_distal, "D": rod, "E": rod, "F": at_crank}
    forces |= {"G": bar, "H": bar}
    bending = {
        "crank": moment if pull is None else jnp.abs((at["E"] - at["K"]).cross(rod)),
        "plate": jnp.maximum(
            jnp.abs((at["H"] - at["D"]).cross(bar)), jnp.abs((at["D"] - at["H"]).cross(rod))
        ),
    }
    axial = {
        "crank": jnp.maximum(rod.length(), at_crank.length()),
        "plate": jnp.maximum(rod.length(), on_distal.length()),
        "rod": rod.length(),
        "bar": bar.length(),
    }
    if pull is not None:
        forces |= {"K": pull, "N": pull, "M": pull}
        axial |= {"coupler": pull.length(), "driver": pull.length()}
        bending["driver"] = moment
    sizes = {name: each.length() for name, each in forces.items()}
    return PinchForces(sizes, bending, axial, moment, stop)


def find_held_force(
    finger: Finger, pip: Float[Array, " pip"], place: Float[Array, "*places"]
) -> Float[Array, "*places pip"]:
    """The largest force that the straight distal pad holds, N; infinite where it never gives way.

    With T_a φ₁ = f (k₂ + l) and T_a φ₂ = f k₂ + k γ_p γ' − λ it gives way where λ = 0, so at
    f = k γ_p γ' / (φ₂/φ₁ (k₂ + l) − k₂).

    Args:
        finger: with pins and spring.
        pip: flexion of PIP, rad.
        place: k₂, mm.

    Example:
        >>> from studies.models import packaged_finger
        >>> held = find_held_force(packaged_finger(), jnp.zeros(1), jnp.array([12.0, 20.0]))
        >>> bool(held[0, 0] < held[1, 0])
        True
    """
    found, spring = find_postures(finger, pip, jnp.zeros(1)), spring_of(finger)
    ratio = (found.dip_ratio / found.pip_ratio)[:, 0]
    place, ratio = place[..., None], ratio.reshape((1,) * place.ndim + (-1,))
    lever = ratio * (place + finger.body.intermediate) - place
    wound = spring.stiffness * spring.preload * found.gamma_slope[0]
    held, gives_way = safe_divide(jnp.broadcast_to(wound, lever.shape), lever)
    return jnp.where(gives_way & (lever > 0), held, jnp.inf)


class Stresses(eqx.Module):
    """Largest stresses by the name of the part, N/mm²."""

    bars: dict[str, Float[Array, " pip"]]
    pins: dict[str, Float[Array, " pip"]]


def find_stresses(finger: Finger, forces: Loads) -> Stresses:
    """Stresses in bars and pins under loads, such as of a pinch.

    In a bar that of the force along it and of bending, added up, over the section with a pin's
    hole; the plate counts as a bar, though it is wider. In a pin bending and single shear between
    the layers of its two bodies, by von Mises.

    Source: R. G. Budynas, J. K. Nisbett, *Shigley's Mechanical Engineering Design*, 10th ed., 2015,
    chapters 3 and 8 (beams, pins in shear and bending), 5 (von Mises).

    Example:
        >>> from studies.models import packaged_finger
        >>> forces = find_pinch_forces(packaged_finger(), jnp.zeros(1), 5.0, 30.5)
        >>> sorted(find_stresses(packaged_finger(), forces).bars)
        ['bar', 'coupler', 'crank', 'driver', 'plate', 'rod']
    """
    links = links_of(finger)
    width, hole = links.bar_width, links.pin_diameter
    bars = {}
    for bar, axial in forces.axial.items():
        thickness = links.thickness[links.layer_of(bar)]
        area, modulus = thickness * (width - hole), thickness * (width**3 - hole**3) / (6 * width)
        bending = forces.bending.get(bar, jnp.zeros_like(axial))
        bars[bar] = (axial / area + bending / modulus) / SIDES
    pins, middles = {}, jnp.mean(links.edges, axis=-1)
    for pin, bodies in finger.joined().items():
        first, second = (middles[links.layer_of(body)] for body in bodies)
        diameter = links.axle_diameter if pin in AXLES else hole
        each = forces.pins[pin] / SIDES
        shear = each / (math.pi * diameter**2 / 4)
        # Each body loads the pin in the middle of its layer: a couple over what lies between.
        bending = 32 * each * jnp.abs(second - first) / 2 / (math.pi * diameter**3)
        pins[pin] = jnp.sqrt(bending**2 + 3 * shear**2)
    return Stresses(bars, pins)


def _column(where: Vector) -> Vector:
    """One place per PIP angle."""
    return where[:, 0] if where.x.ndim == 2 else where[0] if where.x.ndim else where


def _unit(along: Vector) -> Vector:
    length = along.length()
    return Vector(_over(along.x, length), _over(along.y, length))


def _over(one: Float[Array, "..."], other: Float[Array, "..."]) -> Float[Array, "..."]:
    return safe_divide(one, other)[0]
