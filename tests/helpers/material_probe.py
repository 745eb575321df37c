"""What tests of materials share: a kernel that resolves materials at points, points, and images."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.kernels.features import ALL, Features
from wdpm.kernels.materials import resolve as kernel_materials
from wdpm.kernels.materials import texture
from wdpm.kernels.materials.frames import bump_shadowing
from wdpm.kernels.materials.resolve import Materials, Resolved, make_materials, medium_beyond
from wdpm.kernels.materials.texture import Textures
from wdpm.scenes.flat import material_table as mt
from wdpm.scenes.flat.material_table import tabulate
from wdpm.scenes.model.bsdfs import Bsdf
from wdpm.scenes.model.textures import Bitmap

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

Floats = NDArray[np.float32]
Wide = NDArray[np.float64]


@functools.cache
def make_probe(features: Features) -> wp.Kernel:
    functions = make_materials(features)
    resolve = functions.resolve
    straight_transmittance = functions.straight_transmittance
    opacity_at = functions.opacity_at

    @wp.kernel(module="unique", enable_backward=False, module_options={"fuse_fp": False})
    def probe(
        materials: Materials,
        textures: Textures,
        root: wp.array[wp.int32],
        uv: wp.array[wp.vec2],
        color: wp.array[wp.vec3],
        dp_du: wp.array[wp.vec3],
        dp_dv: wp.array[wp.vec3],
        normal: wp.array[wp.vec3],
        front: wp.array[wp.int32],
        u_choice: wp.array[wp.float32],
        towards: wp.array[wp.vec3],
        to_light: wp.array[wp.vec3],
        resolved_out: wp.array[Resolved],
        straight_out: wp.array[wp.vec3],
        opacity_out: wp.array[wp.float32],
        beyond_out: wp.array[wp.int32],
        lit_out: wp.array[wp.float32],
    ):
        i = wp.tid()
        r = resolve(
            materials,
            textures,
            root[i],
            uv[i],
            color[i],
            dp_du[i],
            dp_dv[i],
            normal[i],
            front[i] == 1,
            u_choice[i],
            towards[i],
        )
        resolved_out[i] = r
        cos_theta = wp.abs(wp.dot(normal[i], towards[i]))
        straight_out[i] = straight_transmittance(materials, textures, root[i], uv[i], color[i], cos_theta)
        opacity_out[i] = opacity_at(materials, textures, root[i], uv[i], color[i])
        beyond_out[i] = medium_beyond(materials, root[i], front[i], 7)
        lit_out[i] = bump_shadowing(r.bumps2, wp.dot(r.unbent, to_light[i]))

    return probe


@dataclass(frozen=True, eq=False)
class Found:
    """What kernels say of points.

    Attributes:
        resolved: a record array with the fields of Resolved.
        straight, opacity, beyond: of straight_transmittance, opacity_at and medium_beyond (from medium 7).
        lit: bump_shadowing.
    """

    resolved: NDArray[Any]
    straight: Floats
    opacity: Floats
    beyond: NDArray[np.int32]
    lit: Floats

    @property
    def kind(self) -> NDArray[np.int32]:
        return np.asarray(self.resolved["bsdf"]["kind"])

    def bytes(self) -> tuple[bytes, ...]:
        return tuple(np.ascontiguousarray(a).tobytes() for a in (self.resolved, self.straight, self.opacity, self.lit))


UP = np.array([0.0, 0.0, 1.0])


def probe(
    bsdfs: list[Bsdf], features: Features = ALL, media: tuple[int, int] = (mt.SAME_MEDIUM, mt.SAME_MEDIUM), **given: Any
) -> Found:
    """Points of materials; what is not given is a point with z up, seen from above. Arrays of different lengths fit."""
    points: dict[str, Any] = {
        "root": 0,
        "uv": (0.3, 0.4),
        "color": (1.0, 1.0, 1.0),
        "dp_du": (1.0, 0.0, 0.0),
        "dp_dv": (0.0, 1.0, 0.0),
        "normal": UP,
        "front": 1,
        "u_choice": 0.5,
        "towards": (0.48, 0.0, 0.8772684879784524),
        "to_light": UP,
    } | given
    kinds: dict[str, Any] = {"root": wp.int32, "front": wp.int32, "u_choice": wp.float32, "uv": wp.vec2}
    table, textures = tabulate([(bsdf, *media) for bsdf in bsdfs])
    widths = {name: 0 if kinds.get(name) in (wp.int32, wp.float32) else 2 if name == "uv" else 3 for name in points}
    count = max(np.size(values) // max(widths[name], 1) for name, values in points.items())
    inputs = [kernel_materials.upload(table, "cpu"), texture.upload(textures, "cpu")]
    for name, values in points.items():
        shape = (count, widths[name]) if widths[name] else (count,)
        whole = np.ascontiguousarray(np.broadcast_to(np.asarray(values), shape))
        kind = kinds.get(name, wp.vec3)
        inputs.append(wp.array(whole.astype(np.int32 if kind is wp.int32 else np.float32), dtype=kind, device="cpu"))
    out = [wp.empty(count, dtype=kind, device="cpu") for kind in (Resolved, wp.vec3, wp.float32, wp.int32, wp.float32)]
    wp.launch(make_probe(features), count, inputs=inputs, outputs=out, device="cpu")
    return Found(*(array.numpy() for array in out))


def leaf(bsdf: Bsdf, **given: Any) -> Any:
    """The leaf that a material of one point resolves to, as a record."""
    return probe([bsdf], **given).resolved["bsdf"][0]


def image(seed: int, height: int = 4, width: int = 4) -> Bitmap:
    pixels = np.random.default_rng(seed).uniform(0.05, 0.95, (height, width, 3)).astype(np.float32)
    return Bitmap(f"image {seed}", pixels)


def flat(colour: Any) -> Bitmap:
    """An image of one colour."""
    return Bitmap("flat", np.tile(np.asarray(colour, np.float32), (2, 2, 1)))


def random_points(seed: int, count: int, smooth: bool) -> dict[str, Wide]:
    """Points with tangents that are skew, of any length, of either orientation; smooth ones not across the normal."""
    rng = np.random.default_rng(seed)
    normal = rng.normal(size=(count, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    tangents = rng.normal(size=(2, count, 3)) * rng.uniform(0.5, 2, (2, count, 1))
    slant = 0.3 if smooth else 1.0
    tangents -= slant * normal * np.sum(normal * tangents, axis=2, keepdims=True)
    towards, light = normal + 0.5 * rng.normal(size=(2, count, 3))
    side = np.where(rng.random(count) < 0.5, 1.0, -1.0)[:, None]
    towards, light = (
        v - normal * np.minimum(np.sum(normal * v, axis=1, keepdims=True) - 0.05, 0) for v in (towards, light)
    )
    towards, light = (v / np.linalg.norm(v, axis=1, keepdims=True) for v in (towards, light))
    return {
        "normal": normal,
        "dp_du": tangents[0],
        "dp_dv": tangents[1] * side,
        "uv": rng.uniform(-1, 2, (count, 2)),
        "towards": towards,
        "to_light": light,
    }
