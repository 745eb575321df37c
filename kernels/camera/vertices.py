"""Vertices of camera paths: what arrives at one, what it starts, and where each of its parts stands in its sample."""

from __future__ import annotations

import warp as wp

from wdpm.kernels.camera.diffuse_light import DiffuseLight
from wdpm.kernels.camera.paths import Paths, Vertex, store_path, without_hit
from wdpm.kernels.columns import FromFields, columns_of, item_of, storer
from wdpm.kernels.constants import ROULETTE_FROM, SURVIVAL_MOST
from wdpm.kernels.fields import chosen
from wdpm.kernels.limits import CHAIN_LIMIT
from wdpm.kernels.materials.types import Bsdf
from wdpm.kernels.maths.random import PURPOSE_BOUNCE, sample_1d, sample_2d, stream_of
from wdpm.kernels.maths.sample_numbers import number_of_sample
from wdpm.kernels.ray_fields import RAY, SAMPLE, SHOT, STRETCH

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_CHAIN_LIMIT = wp.constant(CHAIN_LIMIT)

# Dimensions of a vertex's random numbers.
DIRECTION = wp.constant(0)
LOBE = wp.constant(1)
CHOICE = wp.constant(2)
ROULETTE = wp.constant(3)
DIMENSIONS = wp.constant(4)

SHOTS_LATER = wp.constant(1)
"""Shadow rays of vertices beyond the first: what is seen there is one of many samples already."""

# Where indirect light of diffuse parts comes from.
BY_MAP = wp.constant(int(DiffuseLight.PHOTON_MAP))
BY_PATHS = wp.constant(int(DiffuseLight.PATHS))
BY_FINAL_GATHER = wp.constant(int(DiffuseLight.FINAL_GATHER))

# What the diffuse part of one vertex does in BY_FINAL_GATHER.
TRACE_ON = wp.constant(0)
"""A ray goes on by it."""
CACHED = wp.constant(1)
"""Its indirect light is read: from irradiance records, or as irradiance at photons. Direct light has shadow rays."""

# Parts of a vertex, after its shadow rays: cluster.work.parts.
EMISSION_PART = wp.constant(0)
INDIRECT_PART = wp.constant(1)
CAUSTIC_PART = wp.constant(2)
BEAM_PART = wp.constant(3)
REACH_PART = wp.constant(4)
"""Not light: how far a gather ray of a record of the irradiance cache went (cluster.work.records.record_home)."""
PARTS = wp.constant(5)
BOUNCES = wp.constant(CHAIN_LIMIT + 1)
"""Vertices that a path may have, the one at which it is cut off included."""

# Sections of a sample's places: BOUNCES vertices each, of what comes before and after the first diffuse scattering.
SEEN_SECTION = wp.constant(0)
"""Seen directly, or by glossy parts; and lamps that a ray of the first diffuse scattering meets."""
SURFACE_SECTION = wp.constant(1)
"""By a diffuse part of a surface."""
MEDIUM_SECTION = wp.constant(2)
"""By a medium."""


@columns_of(chosen(SAMPLE, "emission", "depth", "normal", "albedo"))
class Seen(FromFields):
    """What the vertices of camera paths see themselves; all but emission is told of first vertices alone."""


@wp.struct
class Queries:
    """Places where photons are to be gathered; `weight` is zero where none are wanted.

    Attributes:
        weight: what the gathered irradiance / pi counts for: throughput of the path, times the albedo if the diffuse
            part is Lambertian.
        clearance: distance to the nearest edge of the triangle.
        edges: of the path from the camera.
    """

    position: wp.array[wp.vec3]
    normal: wp.array[wp.vec3]
    shading_normal: wp.array[wp.vec3]
    front_normal: wp.array[wp.vec3]
    clearance: wp.array[wp.float32]
    weight: wp.array[wp.vec3]
    edges: wp.array[wp.int32]


@wp.struct
class Coats:
    """What a query needs besides where its diffuse part is not Lambertian, or its normal is bent.

    Attributes:
        bsdf, s, t, n, w_from: material, local frame, direction to the viewer in it.
        unbent, bumps2: as in surface.Surface.
        even: whether irradiance, and how much it grazes, tell what the diffuse part reflects.
        reflectance: what the irradiance / pi counts for then, besides the query's weight, if light is alike from all
            sides.
        grazing_gain: by what share more for each unit by which it grazes more (kernels.maths.schlick).
    """

    bsdf: wp.array[Bsdf]
    s: wp.array[wp.vec3]
    t: wp.array[wp.vec3]
    n: wp.array[wp.vec3]
    w_from: wp.array[wp.vec3]
    unbent: wp.array[wp.vec3]
    bumps2: wp.array[wp.float32]
    even: wp.array[wp.bool]
    reflectance: wp.array[wp.vec3]
    grazing_gain: wp.array[wp.float32]


@wp.func
def share_by_grazing(gain: wp.float32, grazing: wp.float32) -> wp.float32:
    """What a diffuse part reflects of light, over what it would of as much that comes alike from all sides.

    Args:
        gain: its grazing_gain.
        grazing: how much the light grazes the surface.
    """
    return wp.max(0.0, 1.0 + gain * grazing)


@columns_of(SHOT)
class Shots(FromFields):
    """Shadow segments that set out."""


@item_of(SHOT)
class Shot(FromFields):
    """One of them."""


store_shot = storer(Shots, Shot)

_STRETCH_OF_SAMPLE = {**STRETCH, **chosen(RAY, "sample")}


@columns_of(_STRETCH_OF_SAMPLE)
class Stretches(FromFields):
    """Stretches of camera rays before a vertex, in a medium or (medium < 0) not."""


@item_of(_STRETCH_OF_SAMPLE)
class Stretch(FromFields):
    """One of them."""


store_stretch = storer(Stretches, Stretch)


@wp.struct
class Shaded:
    """What shading leaves behind of each vertex.

    Attributes:
        coats: only in scenes where a diffuse part may not be Lambertian, or a normal is bent.
        shots: of vertex i, segments i * orders.shots to (i + 1) * orders.shots - 1.
        paths: only where paths go on; one that does not has a throughput of zero, and its number of vertices alone.
        stretches: only in scenes with media.
    """

    seen: Seen
    queries: Queries
    coats: Coats
    shots: Shots
    paths: Paths
    stretches: Stretches


@wp.struct
class Orders:
    """What is asked of all vertices of a launch.

    Attributes:
        light_samples: shadow segments of what the camera sees: places are counted by them.
        shots: shadow segments of each vertex of the launch.
        max_depth: longest path in edges; 0 for no limit.
        diffuse_light: BY_MAP, BY_PATHS or BY_FINAL_GATHER.
        asks: 1 where some vertices may ask for photons; else their queries hold nothing but weights.
    """

    light_samples: wp.int32
    shots: wp.int32
    max_depth: wp.int32
    diffuse_light: wp.int32
    asks: wp.int32


@wp.func
def number_1d(seed: wp.uint32, p: Vertex, dimension: wp.int32) -> wp.float32:
    """A random number of a vertex, in [0, 1)."""
    stream = stream_of(seed, PURPOSE_BOUNCE, p.item, DIMENSIONS * p.bounce + dimension)
    return wp.float32(sample_1d(number_of_sample(p.sample), stream))


@wp.func
def numbers_2d(seed: wp.uint32, p: Vertex) -> wp.vec2:
    """The random numbers of the direction in which a path goes on."""
    return sample_2d(
        number_of_sample(p.sample), stream_of(seed, PURPOSE_BOUNCE, p.item, DIMENSIONS * p.bounce + DIRECTION)
    )


@wp.func
def place_of(bounce: wp.int32, diffuse: wp.int32, light_samples: wp.int32, part: wp.int32) -> wp.int32:
    """Where a part of a vertex, its shadow rays first, stands in its sample: cluster.work.parts.

    Args:
        diffuse: as in kernels.ray_fields.PATH.
    """
    section = wp.int32(SEEN_SECTION)
    if diffuse > 0:
        section = SURFACE_SECTION
    elif diffuse < 0:
        section = MEDIUM_SECTION
    return (section * BOUNCES + bounce) * (light_samples + PARTS) + part


@wp.func
def scattered_again(diffuse: wp.int32) -> wp.int32:
    """`diffuse` of a path after one more scattering of any kind; before the first diffuse one it stays 0."""
    if diffuse > 0:
        return diffuse + 1
    if diffuse < 0:
        return diffuse - 1
    return 0


@wp.func
def path_from(p: Vertex) -> Vertex:
    """The path that goes on from a vertex, which as yet carries nothing and is otherwise as it arrived."""
    p.throughput = wp.vec3(0.0)
    return p


@wp.func
def carry_on(
    p: Vertex,
    onward: Vertex,
    roulette_from: wp.int32,
    survival_most: wp.float32,
    worth: wp.float32,
    weak: wp.float32,
    seed: wp.uint32,
    paths_out: wp.ref[Paths],
) -> None:
    """Write down the ray that goes on from a vertex, unless Russian roulette ends it: a throughput of zero says so.

    Args:
        p: the path as it arrived.
        onward: as it goes on, before Russian roulette; its hit and its number of vertices are seen to here.
        roulette_from: vertices before Russian roulette begins.
        survival_most: largest probability of survival.
        worth: radiance that is expected along the ray, over that along others.
        weak: throughput below which it begins at once; 0 for none.
    """
    carries = onward.throughput
    survival = wp.float32(1.0)
    if p.bounce >= roulette_from:
        survival = wp.min(survival_most, wp.max(carries) * worth)
    elif weak > 0.0:
        survival = wp.min(wp.max(carries) / weak, 1.0)
    if wp.max(carries) > 0.0 and survival < 1.0:
        if number_1d(seed, p, ROULETTE) < survival:
            carries = carries / survival
        else:
            carries = wp.vec3(0.0)
    if p.bounce + 1 >= _CHAIN_LIMIT:
        carries = wp.vec3(0.0)
    sent = without_hit(onward)
    sent.bounce = p.bounce + 1
    sent.throughput = carries
    if wp.max(carries) > 0.0:
        store_path(sent, p.row, paths_out)
    else:  # nobody looks at the rest of it
        paths_out.bounce[p.row] = sent.bounce
        paths_out.throughput[p.row] = carries


@wp.func
def stretch(p: Vertex, length: wp.float32, light_samples: wp.int32, stretches_out: wp.ref[Stretches]) -> None:
    """Write down the stretch of the ray before a vertex, if it is in a medium; it ends at no surface yet."""
    passed = Stretch()
    passed.slot = p.slot
    passed.sample = p.sample
    passed.place = place_of(p.bounce, p.diffuse, light_samples, light_samples + BEAM_PART)
    passed.origin = p.origin
    passed.direction = wp.normalize(p.direction)
    passed.length = length
    passed.radiance = p.throughput
    passed.medium = p.medium
    passed.start = p.left
    store_stretch(passed, p.row, stretches_out)


@wp.func
def nothing_seen(p: Vertex, seen_out: wp.ref[Seen], queries_out: wp.ref[Queries]) -> None:
    """A vertex on no surface has nothing to show, and asks for no photons."""
    i = p.row
    seen_out.emission[i] = wp.vec3(0.0)
    if p.bounce == 0:
        seen_out.depth[i] = -1.0
        seen_out.normal[i] = wp.vec3(0.0)
        seen_out.albedo[i] = wp.vec3(0.0)
    queries_out.weight[i] = wp.vec3(0.0)


@wp.func
def shot_of(p: Vertex, diffuse: wp.int32, orders: Orders, j: wp.int32) -> Shot:
    """Shadow ray j of a vertex, which as yet carries nothing.

    Args:
        diffuse: as in kernels.ray_fields.PATH, of the path that the shadow ray ends.
    """
    shot = Shot()
    shot.slot = p.slot
    shot.place = place_of(p.bounce, diffuse, orders.light_samples, j)
    shot.medium = p.medium
    return shot


@wp.func
def shoot(p: Vertex, orders: Orders, j: wp.int32, shot: Shot, shots_out: wp.ref[Shots]) -> None:
    """Write down shadow ray j of a vertex."""
    store_shot(shot, p.row * orders.shots + j, shots_out)


@wp.func
def nothing_goes_on(p: Vertex, seed: wp.uint32, paths_out: wp.ref[Paths]) -> None:
    """A path ends at a vertex."""
    ended = path_from(p)
    carry_on(p, ended, ROULETTE_FROM, SURVIVAL_MOST, 1.0, 0.0, seed, paths_out)
