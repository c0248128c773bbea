"""Mitsuba, its best variant on this machine, and one step of many rays through a scene."""

from __future__ import annotations

import functools
import glob
import importlib
import os
import re
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

OLDEST_LLVM = 16
"""Mitsuba ends the process with older ones."""

PLACES = ("/usr/lib/*-linux-gnu", "/usr/lib/llvm-*/lib", "/usr/lib64", "/opt/homebrew/opt/llvm/lib")

Material = str | tuple[float, float]
"""A name in `TABLES`, or the refractive indices before and behind a smooth interface; "before" is
where a face's normal points."""

TABLES: dict[str, dict[str, Any]] = {
    "opaque": {"type": "diffuse"},
    "mirror": {"type": "conductor", "material": "none"},
    "two-sided mirror": {"type": "twosided", "": {"type": "conductor", "material": "none"}},
}


class Steps(NamedTuple):
    """What rays meet next; arrays are over rays, vectors of the shape (rays, 3).

    Attributes:
        group: number of the material that is met; −1 where nothing is.
        face: number of the face among those of its material.
        point: where.
        normal: of the face, to its front.
        onward: in which direction light goes on, reflected by mirrors, refracted by interfaces.
        light: Mueller matrices of what it does to light, shape (rays, 4, 4), in axes that Mitsuba
            gives every direction: the product over a path, the last one first, has in its first
            entry the part of unpolarised light that comes through.
        mirrored: in which direction interfaces reflect.
        reflection: what that does to light.
    """

    group: np.ndarray
    face: np.ndarray
    point: np.ndarray
    normal: np.ndarray
    onward: np.ndarray
    light: np.ndarray
    mirrored: np.ndarray
    reflection: np.ndarray


def llvm_version(path: str) -> int:
    """The version in the name of a library of LLVM, links followed; 0 where there is none."""
    found = re.search(r"libLLVM(?:-|\.so\.|\.)(\d+)", os.path.basename(os.path.realpath(path)))
    return int(found[1]) if found else 0


def find_llvm() -> str | None:
    """The newest library of LLVM that Mitsuba can use, or the one ``DRJIT_LIBLLVM_PATH`` names."""
    named = os.environ.get("DRJIT_LIBLLVM_PATH")
    paths = (
        [named] if named else [one for place in PLACES for one in glob.glob(f"{place}/libLLVM*")]
    )
    return max((p for p in paths if llvm_version(p) >= OLDEST_LLVM), key=llvm_version, default=None)


@functools.cache
def load_mitsuba() -> Any:
    """The module, all rays at a time where there is LLVM, otherwise ray by ray.

    Raises:
        ModuleNotFoundError: it is not installed.
    """
    mitsuba: Any = importlib.import_module("mitsuba")
    if library := find_llvm():
        os.environ["DRJIT_LIBLLVM_PATH"] = library
    mitsuba.set_variant("llvm_ad_mono_polarized" if library else "scalar_spectral_polarized")
    if library:  # a few thousand rays at a time: threads would wait for each other
        importlib.import_module("drjit").set_thread_count(1)
    return mitsuba


class Engine:
    """Flat faces as Mitsuba has them, a mesh for each material.

    Args:
        faces: by material, each face by its four corners, counter-clockwise seen from its front.
    """

    def __init__(self, faces: Mapping[Material, Sequence[np.ndarray]]) -> None:
        self._mi = mi = load_mitsuba()
        meshes = {
            f"group{i}": self._mesh(material, np.stack(quads))
            for i, (material, quads) in enumerate(faces.items())
        }
        self._scene = mi.load_dict({"type": "scene", **meshes})
        self._shapes = list(meshes.values())
        kinds = mi.BSDFFlags.DeltaTransmission, mi.BSDFFlags.DeltaReflection
        self._contexts = [mi.BSDFContext(mi.TransportMode.Importance) for _ in kinds]
        for context, kind in zip(self._contexts, kinds, strict=True):
            context.type_mask = int(kind)
        self._refracts = np.array([isinstance(material, tuple) for material in faces])

    def _mesh(self, material: Material, quads: np.ndarray) -> Any:
        table = TABLES[material] if isinstance(material, str) else {
            "type": "dielectric", "ext_ior": material[0], "int_ior": material[1],
        }  # fmt: skip
        properties = self._mi.Properties()
        properties["bsdf"] = self._mi.load_dict(table)
        mesh = self._mi.Mesh("faces", 4 * len(quads), 2 * len(quads), props=properties)
        corners = 4 * np.arange(len(quads))[:, None, None] + np.array([[0, 1, 2], [0, 2, 3]])
        values = self._mi.traverse(mesh)
        values["vertex_positions"] = quads.ravel().astype(np.float32)
        values["faces"] = corners.ravel().astype(np.uint32)
        values.update()
        return mesh

    def step(self, origins: np.ndarray, directions: np.ndarray, reflecting: bool = True) -> Steps:
        """Follow rays to what they meet next; origins and unit vectors of the shape (rays, 3).

        What interfaces reflect is left empty where it is not asked for.
        """
        if not self._mi.variant().startswith("scalar"):
            return self._step_together(origins, directions, reflecting)
        one_by_one = [self._step_alone(*ray) for ray in zip(origins, directions, strict=True)]
        return Steps(*map(np.array, zip(*one_by_one, strict=True)))

    def _light(self, met: Any) -> list[Any]:
        """Where light goes on by transmission, what it becomes, and both by reflection."""
        onward = []
        for context in self._contexts:
            sample, light = met.bsdf().sample(context, met, 0.5, self._mi.Point2f(0.5))
            light = met.to_world_mueller(light, -met.wi, sample.wo)
            onward += [met.to_world(sample.wo), light]
        return onward

    def _step_together(
        self, origins: np.ndarray, directions: np.ndarray, reflecting: bool
    ) -> Steps:
        mi, dr = self._mi, importlib.import_module("drjit")
        origin, way = (
            [mi.Float(np.ascontiguousarray(one, np.float32)) for one in vectors.T]
            for vectors in (origins, directions)
        )
        met = self._scene.ray_intersect(mi.Ray3f(mi.Point3f(*origin), mi.Vector3f(*way)))
        dr.eval(met)  # what depends on the scene's address apart: the rest is compiled once
        onward = self._light(met)
        number = dr.reinterpret_array(mi.UInt32, met.shape)
        arrays = number, met.prim_index // 2, met.p, met.n, *onward
        dr.eval(arrays)
        number, face, point, normal, *onward = map(_numbers, arrays)
        known = [int(dr.reinterpret_array(mi.UInt32, mi.ShapePtr(s))[0]) for s in self._shapes]
        group = np.full(len(number), -1)
        for i, one in enumerate(known):
            group[number == one] = i
        through = self._refracts[group][:, None]
        way = np.where(through, onward[0], onward[2])
        light = np.where(through[..., None], onward[1], onward[3])
        back = onward[2:] if reflecting else (way[:0], light[:0])
        return Steps(group, face, point, normal, way, light, *back)

    def _step_alone(self, origin: np.ndarray, direction: np.ndarray) -> tuple[Any, ...]:
        ray = self._mi.Ray3f(self._mi.Point3f(*origin), self._mi.Vector3f(*direction))
        met = self._scene.ray_intersect(ray)
        if not met.is_valid():
            return -1, 0, *np.zeros((3, 3)), np.zeros((4, 4)), np.zeros(3), np.zeros((4, 4))
        onward = self._light(met)
        group = self._shapes.index(met.shape)
        way, light = onward[:2] if self._refracts[group] else onward[2:]
        found = (met.p, met.n, way, light, *onward[2:])
        point, normal, way, light, back, reflection = (np.array(one) for one in found)
        light, reflection = light[:, :, 0], reflection[:, :, 0]
        return group, met.prim_index // 2, point, normal, way, light, back, reflection


def _numbers(array: Any) -> np.ndarray:
    """Numbers, vectors or Mueller matrices of rays.

    They come, as rays go, entry by entry: for whole arrays Dr.Jit compiles a program for every
    number of rays.
    """
    if array.ndim == 1:
        return np.array(array)
    if array.ndim == 2:
        return np.stack([np.array(one) for one in array], axis=-1)
    rows = [np.stack([np.array(entry[0]) for entry in row], axis=-1) for row in array]
    return np.stack(rows, axis=1)
