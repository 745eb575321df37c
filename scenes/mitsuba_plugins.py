"""Which Mitsuba plugins exist, and which of them this reader supports; for precise messages."""

from __future__ import annotations

SUPPORTED: dict[str, tuple[str, ...]] = {
    "shape": ("obj", "ply", "serialized", "rectangle", "cube", "sphere", "disk", "cylinder"),
    "bsdf": ("diffuse", "twosided"),
    "texture": ("bitmap",),
    "emitter": ("area", "point"),
    "sensor": ("perspective",),
    "film": ("hdrfilm", "ldrfilm", "mfilm"),
    "rfilter": ("box", "gaussian"),
    "sampler": ("independent", "stratified", "multijitter", "orthogonal", "ldsampler", "halton", "hammersley", "sobol"),
    "integrator": (
        # what these do to the paths they find differs, but not which paths there are up to max_depth
        ("path", "volpath", "volpathmis", "volpath_simple", "direct", "ptracer", "bdpt", "pssmlt", "mlt", "erpt")
        + ("photonmapper", "ppm", "sppm", "vpl", "prb", "prb_basic", "prbvolpath", "direct_projective")
        + ("prb_projective", "aov", "moment", "adaptive", "irrcache", "batch")
    ),
}

# Mitsuba 3.9 and Mitsuba 0.6 together, without the supported ones
_KNOWN: dict[str, tuple[str, ...]] = {
    "shape": (
        ("instance", "shapegroup", "merge", "bsplinecurve", "linearcurve", "sdfgrid", "ellipsoids", "ellipsoidsmesh")
        + ("blender", "hair", "heightfield", "deformable", "animatedinstance")
    ),
    "bsdf": (
        ("conductor", "roughconductor", "dielectric", "roughdielectric", "thindielectric", "plastic", "roughplastic")
        + ("pplastic", "principled", "principledthin", "blendbsdf", "mask", "bumpmap", "normalmap", "null", "hair")
        + ("measured", "measured_polarized", "polarizer", "circular", "retarder", "roughdiffuse", "coating")
        + ("roughcoating", "phong", "ward", "mixturebsdf", "difftrans", "hk", "irawan")
    ),
    "texture": (
        ("checkerboard", "mesh_attribute", "volume", "blackbody", "d65", "irregular", "regular", "uniform", "srgb")
        + ("rawconstant", "gridtexture", "scale", "vertexcolors", "wireframe", "curvature")
    ),
    "emitter": (
        ("constant", "envmap", "spot", "projector", "directional", "directionalarea", "sunsky", "timed_sunsky", "sky")
        + ("sun", "collimated")
    ),
    "sensor": (
        ("thinlens", "orthographic", "radiancemeter", "irradiancemeter", "distant", "batch", "telecentric", "spherical")
        + ("fluencemeter", "perspective_rdist")
    ),
    "film": ("specfilm", "tiledhdrfilm"),
    "rfilter": ("tent", "mitchell", "catmullrom", "lanczos"),
    "sampler": (),
    "integrator": ("depth", "stokes", "volprim_rf_basic", "multichannel", "field"),
}


def is_known(category: str, plugin_type: str) -> bool:
    """Whether Mitsuba has a plugin of this name that is not supported here."""
    return plugin_type in _KNOWN[category]
