"""Which Mitsuba plugins exist, and which of them this reader supports; for precise messages."""

from __future__ import annotations

_READ: dict[str, dict[str, None]] = {"bsdf": {}, "emitter": {}}
"""Plugins of categories whose readers say themselves what they read (`reads`), in the order in which they did."""

_SUPPORTED: dict[str, tuple[str, ...]] = {
    "shape": ("obj", "ply", "serialized", "rectangle", "cube", "sphere", "disk", "cylinder", "shapegroup", "instance"),
    "texture": (
        "bitmap",
        "checkerboard",
        "mesh_attribute",
        "vertexcolors",
        "scale",
        "uniform",
        "srgb",
        "d65",
        "regular",
        "irregular",
        "blackbody",
        "rawconstant",
    ),
    "sensor": ("perspective", "thinlens", "orthographic"),
    "medium": ("homogeneous", "heterogeneous"),
    "phase": ("isotropic", "hg"),
    "volume": ("constvolume", "gridvolume"),
    "film": ("hdrfilm", "ldrfilm", "mfilm"),
    "rfilter": ("box", "gaussian", "tent", "mitchell", "catmullrom", "lanczos"),
    "sampler": ("independent", "stratified", "multijitter", "orthogonal", "ldsampler", "halton", "hammersley", "sobol"),
    # what these do to the paths they find differs, but not which paths there are up to max_depth
    "integrator": (
        "path",
        "volpath",
        "volpathmis",
        "volpath_simple",
        "direct",
        "ptracer",
        "bdpt",
        "pssmlt",
        "mlt",
        "erpt",
        "photonmapper",
        "ppm",
        "sppm",
        "vpl",
        "prb",
        "prb_basic",
        "prbvolpath",
        "direct_projective",
        "prb_projective",
        "aov",
        "moment",
        "adaptive",
        "irrcache",
        "batch",
    ),
}

# Mitsuba 3.9 and Mitsuba 0.6 together; those that are supported need not be here
KNOWN: dict[str, tuple[str, ...]] = {
    "shape": (
        "merge",
        "bsplinecurve",
        "linearcurve",
        "sdfgrid",
        "ellipsoids",
        "ellipsoidsmesh",
        "blender",
        "hair",
        "heightfield",
        "deformable",
        "animatedinstance",
    ),
    "bsdf": (
        "pplastic",
        "hair",
        "measured",
        "measured_polarized",
        "polarizer",
        "circular",
        "retarder",
        "roughdiffuse",
        "hk",
        "irawan",
    ),
    "texture": (
        "volume",
        "gridtexture",
        "ldrtexture",
        "exrtexture",
        "wireframe",
        "curvature",
    ),
    "emitter": (
        "directionalarea",
        "timed_sunsky",
        "collimated",
    ),
    "sensor": (
        "radiancemeter",
        "irradiancemeter",
        "distant",
        "batch",
        "telecentric",
        "spherical",
        "fluencemeter",
        "perspective_rdist",
    ),
    "medium": (),
    "phase": ("blendphase", "rayleigh", "tabphase", "sggx", "kkay", "microflake", "mixturephase"),
    "volume": ("hgridvolume", "volcache"),
    "film": ("specfilm", "tiledhdrfilm"),
    "rfilter": (),
    "sampler": (),
    "integrator": ("depth", "stokes", "volprim_rf_basic", "multichannel", "field"),
}


def reads(category: str, plugin_type: str) -> None:
    """Say that there is a reader of plugins of a type."""
    _READ[category][plugin_type] = None


def supported(category: str) -> tuple[str, ...]:
    """The types of a category that can be read."""
    return tuple(_READ[category]) if category in _READ else _SUPPORTED[category]


def is_known(category: str, plugin_type: str) -> bool:
    """Whether Mitsuba has a plugin of this name that is not supported here."""
    return plugin_type in KNOWN[category]
