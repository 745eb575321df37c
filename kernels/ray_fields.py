"""The fields of rays, photons and results that travel between cells and homes.

Which kind of batch has which of these tables: `SCHEMAS` in cluster.batch. The structs of the kernels that compute with
them are made of them, too (columns.py): a field that is added here is loaded, stored and sent.
"""

from __future__ import annotations

from typing import Final

from wdpm.kernels.fields import (
    Field,
    Fields,
    Many,
    chosen,
    integer,
    long_integer,
    long_number,
    long_vector,
    number,
    vector,
)
from wdpm.kernels.limits import CHAIN_LIMIT, MAPS

_SLOT: Final = {"slot": integer("where its home wants the result")}  # homes check it: they know how many they have

RAY: Final[Fields] = {
    **_SLOT,
    "pixel": integer("counted row by row", least=0),
    "sample": integer("of the pixel", least=0),
}
"""Rays of the camera: functions of pixel and sample number."""

START: Final[Fields] = {
    **RAY,
    "together": integer(
        "samples of its pixel from this one on, the next rows, that may come home as one sum; else 0", least=0
    ),
}
"""Such rays as they set out."""

HIT: Final[Fields] = {
    "t": number("distance of the best hit so far [lengths of the direction]"),
    "prim": integer("global triangle number, -1 for none yet", least=-1),
    # In 0 to 1 but for rounding. From others photons would set out from nowhere, and be looked for in cells there.
    "u": number("barycentric coordinate of the triangle's corner 1", least=-1, end=2),
    "v": number("barycentric coordinate of the triangle's corner 2", least=-1, end=2),
    "owner": integer("the cell that contains the hit point, -1 for none", least=-1, end=Many.CELLS),
}

CAMERA_RAY: Final[Fields] = {**RAY, **HIT}

PATH: Final[Fields] = {
    **RAY,
    "bounce": integer("vertices before, those that light goes straight through included", least=0, end=CHAIN_LIMIT + 1),
    "edges": integer("of the path so far, straight passages not counted", least=0),
    "diffuse": integer("scatterings from the first diffuse one on; negative if that was in a medium"),
    "medium": integer("that the ray is in, -1 for none", least=-1, end=Many.MEDIA),
    "origin": vector("[scene units]"),
    "direction": vector("of any length"),
    "left": vector("normal of the surface that the ray left, on its side, where its medium begins there; else zero"),
    "anchor": vector("the last vertex that scattered [scene units]"),
    "throughput": vector("what light that arrives along the ray counts for in the sample"),
    "pdf": number("pdf_solid_angle of the direction at the anchor [1/sr]; 0 for a delta"),
    **HIT,
}
"""Camera paths, and the gather rays of irradiance records."""

PART: Final[Fields] = {
    **_SLOT,
    "place": integer("which part of the sample it is: cluster.work.parts", least=0),
    "radiance": vector("[W/(m² sr)]"),
}
"""Parts of samples."""

GATHERED: Final[Fields] = {
    **_SLOT,
    "radiance": long_vector("sum of all parts, in the order of their places [W/(m² sr)]"),
    "distance": number("of what the ray met first [scene units]"),
}
"""What gather rays of irradiance records bring, all of it."""

SEGMENT: Final[Fields] = {
    **chosen(PART, "slot", "place"),
    "origin": vector("[scene units]"),
    "direction": vector("as long as the segment [scene units]"),
    "radiance": vector("what arrives if nothing blocks it [W/(m² sr)]"),
}
"""Shadow segments, from origin to origin + direction."""

SHOT: Final[Fields] = {**SEGMENT, **chosen(PATH, "medium")}
"""Shadow segments that set out, and the medium that each starts in."""

WALK: Final[Fields] = {**SHOT, **HIT}
"""Shadow segments that may pass through surfaces."""

STRETCH: Final[Fields] = {
    **chosen(PART, "slot", "place"),
    "origin": vector("[scene units]"),
    "direction": vector("unit, away from the camera"),
    "radiance": vector("throughput before the stretch"),
    "length": number("[scene units]"),
    **chosen(PATH, "medium"),
    "start": vector("normal of the surface that the medium begins at, on the stretch's side; zero where there is none"),
    "end": vector("the same where it ends"),
}
"""Stretches of camera rays in a medium."""

_SUM = "scattered towards the camera so far: exact sum in units of World.volume_unit"

BEAM: Final[Fields] = {**STRETCH, "red": long_integer(_SUM), "green": long_integer(_SUM), "blue": long_integer(_SUM)}
"""Stretches, and what photons near them scatter towards the camera."""

PHOTON: Final[Fields] = {
    "path": long_integer("number of the path; those of the caustic pass come after those of the global pass", least=0),
    "bounce": integer("landings behind it, those included at which it went straight on", least=0),
    "edges": integer("of the path up to its next landing: scatterings behind it, plus 1", least=0),
    "state": integer("what scattered it so far: bits of kernels.photons.flight"),
    **chosen(PATH, "medium"),
    "light": integer("that it comes from", least=0, end=Many.LIGHTS),
    "origin": vector("of its ray [scene units]"),
    "direction": vector("of its ray, in which it travels, unit"),
    "flux": vector("that of a map of one path [W]"),
    **HIT,
}
"""Photons in flight. `t` is how far the ray is looked along where it has met nothing, NO_HIT for no end."""

STORED_PHOTON: Final[Fields] = {
    "id": long_integer("path * 2^16 + bounce", least=0),
    "edges": integer("of its path from the light", least=0),
    "front": integer("1 where it arrived at the front of a surface, and in a medium", least=0, end=2),
    "map": integer("which photon map it is in: kernels.photons.deposits", least=0, end=MAPS),
    "position": vector("[scene units]"),
    "flux": vector("that arrives, in a map of one path [W]"),
    "normal": vector("unit, geometric, on the side that it arrived at; in a medium, (number of the medium, 0, 0)"),
    "direction": vector("to where it came from, unit"),
}

SURFACE_POINT: Final[Fields] = {
    **chosen(STORED_PHOTON, "map"),
    "position": vector("[scene units]"),
    "normal": vector("unit, geometric, of the front"),
}
"""Points that measure how much surface there is: kernels.photons.surface_points."""

IRRADIANCE_POINT: Final[Fields] = {
    **chosen(STORED_PHOTON, "id", "position", "normal"),
    "radiance": vector("that a white surface sends back [W/(m² sr)]"),
    "grazing": number("how much that light grazes the surface: kernels.maths.schlick"),
    "radius": number("of the gather that it comes from [scene units]"),
    "room": number("how far off it may be read: no wall is so near [scene units]"),
}
"""Irradiance at photons, as light that a white surface reflects: kernels.irradiance.at_photons."""

PLACES_A_RUN = 16
"""Whose items travel together, so that their place costs little."""

TREE_PLACES: Final[Fields] = {
    "place": integer("of the first of some places in the leaves of the cell's trees, one tree after another", least=0),
    "items": Field(
        "<i4", (PLACES_A_RUN,), "photons or surface points that stand there, as their trees number them; -1: none", -1
    ),
}
"""A part of the order in which trees of photons and points are laid out: cluster.work.tree_orders."""

SAMPLE: Final[Fields] = {
    **_SLOT,
    "emission": vector("light of the first surface itself [W/(m² sr)]"),
    "indirect": vector("what that reflects of indirect light [W/(m² sr)]"),
    "depth": number("distance from the eye [scene units], negative where nothing was hit"),
    "normal": vector("unit, shading normal"),
    "albedo": vector("of the surface"),
    "cell": integer("that contains it", least=-1, end=Many.CELLS),
}
"""What first surfaces show."""

PIXEL: Final[Fields] = {
    "slot": integer("of its first sample"),
    "direct": long_vector("[W/(m² sr)], as all that its samples come to"),
    "indirect": long_vector("[W/(m² sr)]"),
    "caustic": long_vector("[W/(m² sr)]"),
    "normal": long_vector("of unit, shading normals"),
    "albedo": long_vector("of the surfaces"),
    "depth": long_number("of distances from the eye [scene units]"),
    "hits": integer("samples that met a surface", least=0),
    "cell": integer("that contains what the first sample met, -1 if that met nothing", least=-1, end=Many.CELLS),
}
"""Sums over the samples of pixels, added in the order of their numbers."""

SITE: Final[Fields] = {
    **_SLOT,
    "position": vector("[scene units]"),
    "normal": vector("unit, geometric, of the seen side"),
    "shading_normal": vector("unit, on the same side"),
    "footprint": number("width of a pixel there [scene units]"),
}
"""Places where an irradiance record is wanted."""
