"""What scattering functions take and give: a leaf material with its textures read, and a sampled direction.

Directions are unit vectors in the local frame of a surface point: z is the shading normal of the material's front, x
and y are the shading tangents. `w_from` points to where the path came from, `w_to` to where it goes; both point away
from the surface. A negative z is the back (inside, for a dielectric).

A scattering function is the sum of two parts, and each path knows which one it takes:

* the *diffuse* part: smooth over the hemisphere of `w_from`. Photons are stored where there is one; gathers read it.
* the *glossy* part: everything that comes from a microfacet or a perfectly smooth interface, whatever its roughness.
  It is always traced, never gathered: there is no roughness at which a surface changes from one to the other.
"""

from __future__ import annotations

import warp as wp

from wdpm.scenes.model import leaf_kind
from wdpm.scenes.model.bsdfs import Diffuse, Null

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

# Kinds of leaves that more than their own code asks about; the others are in their modules.
BLACK = wp.constant(leaf_kind.BLACK)
"""Absorbs all light: a one-sided material seen from behind."""
DIFFUSE = wp.constant(Diffuse.KIND.number)
NULL = wp.constant(Null.KIND.number)
"""Lets all light pass straight on: the boundary of a medium, or a hole that a mask leaves."""

BECKMANN = wp.constant(0)
GGX = wp.constant(1)

RADIANCE = wp.constant(0)
"""Mode of paths from the camera: radiance is compressed where light enters a denser medium (factor 1 / eta²)."""
FLUX = wp.constant(1)
"""Mode of photons: their flux is not."""


@wp.struct
class Bsdf:
    """A leaf material at a point, all textures read.

    Attributes:
        kind: number of its kind (scenes.model.leaf_kind).
        color: albedo of the diffuse part; base colour of PRINCIPLED.
        specular, transmittance: factors of what is reflected and transmitted by the interface, 1 for a physical one.
        eta, k: CONDUCTOR: complex index of refraction by channel. Others: eta[0] is the index inside over that outside.
            PLASTIC: eta[1], transmittance and k are the coat's (scenes.flat.plastic_coat, materials.plastic).
        alpha: roughness of the microfacet distribution along the tangents; (0, 0) is perfectly smooth.
        distribution: BECKMANN or GGX.
        nonlinear: PLASTIC: 1 where colour shifts by internal scattering are computed.
        grazing_gain: PLASTIC: see materials.leaf.
        metallic ... clearcoat_gloss: PRINCIPLED, as Mitsuba 3 documents them; roughness is in `alpha`'s place there
            too (alpha = what the plugin derives from roughness and anisotropic).
        layered: PRINCIPLED: 1 where its diffuse part is glTF's, else Disney's.
    """

    kind: wp.int32
    color: wp.vec3
    specular: wp.vec3
    transmittance: wp.vec3
    eta: wp.vec3
    k: wp.vec3
    alpha: wp.vec2
    distribution: wp.int32
    nonlinear: wp.int32
    grazing_gain: wp.float32
    roughness: wp.float32
    metallic: wp.float32
    spec_trans: wp.float32
    spec_tint: wp.float32
    sheen: wp.float32
    sheen_tint: wp.float32
    flatness: wp.float32
    clearcoat: wp.float32
    clearcoat_gloss: wp.float32
    layered: wp.float32


@wp.struct
class BsdfSample:
    """A sampled direction.

    Attributes:
        to: the direction, unit; zero where nothing could be sampled.
        weight: scattering function times |cos| over pdf_solid_angle (for a delta: over the lobe's probability).
        pdf: pdf_solid_angle of the direction over all lobes that the call could have sampled; 0 for a delta.
        delta: 1 where the direction is one of finitely many (mirror, smooth refraction, straight on).
        diffuse: 1 where the diffuse part was sampled.
        straight: 1 where the path goes straight on through NULL or THIN_DIELECTRIC: no scattering at all.
        crosses: 1 where the path goes to the other side of the surface.
    """

    to: wp.vec3
    weight: wp.vec3
    pdf: wp.float32
    delta: wp.int32
    diffuse: wp.int32
    straight: wp.int32
    crosses: wp.int32
