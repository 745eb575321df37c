"""A kernel that looks up a texture at given places."""

from __future__ import annotations

import functools

import numpy as np
import warp as wp
from numpy.typing import NDArray

from wdpm.kernels.features import ALL, Features
from wdpm.kernels.materials import texture
from wdpm.kernels.materials.texture import Textures, make_textures
from wdpm.scenes.model.textures import Bitmap, Texture

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


Array = NDArray[np.float64]


@functools.cache
def make_kernel(features: Features) -> wp.Kernel:
    functions = make_textures(features)
    lookup, slope = functions.lookup, functions.slope

    @wp.kernel(module="unique", enable_backward=False, module_options={"fuse_fp": False})
    def lookup_kernel(
        textures: Textures,
        image: wp.array[wp.int32],
        uv: wp.array[wp.vec2],
        vertex_colour: wp.array[wp.vec3],
        colour_out: wp.array[wp.vec3],
        slope_out: wp.array[wp.vec2],
    ):
        i = wp.tid()
        colour_out[i] = lookup(textures, image[i], uv[i], vertex_colour[i])
        slope_out[i] = slope(textures, image[i], uv[i])

    return lookup_kernel


def values(
    textures: list[Texture],
    image: NDArray[np.int32],
    uv: NDArray[np.float32],
    vertex_colour: NDArray[np.float32] | None = None,
    features: Features = ALL,
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Colours, shape [N, 3], and slopes, shape [N, 2]."""
    if vertex_colour is None:
        vertex_colour = np.zeros((len(uv), 3), np.float32)
    colour = wp.empty(len(uv), dtype=wp.vec3, device="cpu")
    slope = wp.empty(len(uv), dtype=wp.vec2, device="cpu")
    inputs = [texture.upload(textures, "cpu"), wp.array(image, dtype=wp.int32, device="cpu")]
    inputs += [wp.array(uv, dtype=wp.vec2, device="cpu"), wp.array(vertex_colour, dtype=wp.vec3, device="cpu")]
    wp.launch(make_kernel(features), len(uv), inputs=[*inputs, colour, slope], device="cpu")
    return colour.numpy(), slope.numpy()


def looked_up(bitmaps: list[Bitmap], image: NDArray[np.int32], uv: NDArray[np.float32]) -> Array:
    return values(list(bitmaps), image, uv)[0].astype(np.float64)
