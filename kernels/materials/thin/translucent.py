"""Translucent sheets: light that gets through leaves at the other side in all directions alike (0.6's `difftrans`).

Both sides scatter. What is seen of a sheet is the light of its other side, as what is seen of a diffuse surface is
that of its own: photons are stored where they arrive, on whichever side, and who sees the sheet gathers those behind
it. So a Surface says that it is DIFFUSE, with its frame on the lit side (Surface.through), and everything that asks
about diffuse parts serves: gathers, shadow rays, rays that go on. Where irradiance is read before a surface is shaded,
places are turned to that side first (kernels.irradiance.lit_places).
"""

from __future__ import annotations

import functools

import warp as wp

from wdpm.kernels.features import Features
from wdpm.kernels.materials.leaf import LeafCode
from wdpm.kernels.materials.nodes import Materials, make_parameters
from wdpm.kernels.materials.texture import Textures
from wdpm.kernels.materials.types import Bsdf
from wdpm.scenes.model.bsdfs import Translucent

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

TRANSLUCENT = wp.constant(Translucent.KIND.number)

_TRANSMITTANCE = wp.constant(Translucent.KIND.slots["transmittance"])


@functools.cache
def make_translucent(features: Features) -> LeafCode:
    """The code of TRANSLUCENT."""
    value = make_parameters(features).value

    @wp.func
    def read(
        materials: wp.ref[Materials], textures: wp.ref[Textures], node: wp.int32, uv: wp.vec2, color: wp.vec3
    ) -> Bsdf:
        b = Bsdf()
        b.kind = TRANSLUCENT
        b.color = value(materials, textures, node, _TRANSMITTANCE, uv, color)
        return b

    return LeafCode(int(TRANSLUCENT), read)
