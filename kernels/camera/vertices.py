"""Vertices of camera paths: what arrives at one, what it starts, and where each of its parts stands in its sample."""

from __future__ import annotations

import warp as wp

from wdpm.kernels.camera.camera import CameraView, whole_pixel
from wdpm.kernels.camera.diffuse_light import DiffuseLight
from wdpm.kernels.camera.rays import Paths
from wdpm.kernels.constants import ROULETTE_FROM, SURVIVAL_MOST
from wdpm.kernels.limits import CHAIN_LIMIT
from wdpm.kernels.materials.types import Bsdf
from wdpm.kernels.maths.random import PURPOSE_BOUNCE, sample_1d, sample_2d, stream_of
from wdpm.kernels.rays.triangle import NO_HIT

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_CHAIN_LIMIT = wp.constant(CHAIN_LIMIT)

# Dimensions of a vertex's random numbers.
DIRECTION = wp.constant(0)
LOBE = wp.constant(1)
CHOICE = wp.constant(2)
ROULETTE = wp.constant(3)
DIMENSIONS = wp.constant(4)

# Where indirect light of diffuse parts comes from.
BY_MAP = wp.constant(int(DiffuseLight.PHOTON_MAP))
BY_PATHS = wp.constant(int(DiffuseLight.PATHS))
BY_FINAL_GATHER = wp.constant(int(DiffuseLight.FINAL_GATHER))

# What the diffuse part of one vertex does in BY_FINAL_GATHER.
TRACE_ON = wp.constant(0)
"""A ray goes on by it."""
READ_MAP = wp.constant(1)
"""All of its light is read from the photon map: it ends a gather ray."""
CACHED = wp.constant(2)
"""Its indirect light comes from the irradiance cache, its direct light from shadow rays."""

# Parts of a vertex, after its shadow rays: cluster.parts.
EMISSION_PART = wp.constant(0)
BEAM_PART = wp.constant(3)
REACH_PART = wp.constant(4)
"""Not light: how far a gather ray of a record of the irradiance cache went (cluster.work.record_home)."""
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


@wp.struct
class Seen:
    """What the vertices of camera paths see themselves."""

    emission: wp.array[wp.vec3]
    depth: wp.array[wp.float32]
    normal: wp.array[wp.vec3]
    albedo: wp.array[wp.vec3]


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
    """

    bsdf: wp.array[Bsdf]
    s: wp.array[wp.vec3]
    t: wp.array[wp.vec3]
    n: wp.array[wp.vec3]
    w_from: wp.array[wp.vec3]
    unbent: wp.array[wp.vec3]
    bumps2: wp.array[wp.float32]


@wp.struct
class Shots:
    """Shadow segments as shadow_rays.Segments, and the medium that each starts in."""

    slot: wp.array[wp.int32]
    place: wp.array[wp.int32]
    origin: wp.array[wp.vec3]
    direction: wp.array[wp.vec3]
    radiance: wp.array[wp.vec3]
    medium: wp.array[wp.int32]


@wp.struct
class Stretches:
    """Stretches of camera rays before a vertex, in a medium or (medium < 0) not. See cluster.batch.SCHEMAS."""

    slot: wp.array[wp.int32]
    sample: wp.array[wp.int32]
    place: wp.array[wp.int32]
    origin: wp.array[wp.vec3]
    direction: wp.array[wp.vec3]  # unit
    length: wp.array[wp.float32]
    radiance: wp.array[wp.vec3]  # throughput before the stretch
    medium: wp.array[wp.int32]


@wp.struct
class Vertex:
    """A camera path as it arrives at a surface, or (prim < 0) in a medium; for the fields see cluster.batch.SCHEMAS.

    Attributes:
        item: of the pixel's random numbers.
    """

    slot: wp.int32
    pixel: wp.int32
    item: wp.uint32
    sample: wp.int32
    bounce: wp.int32
    edges: wp.int32
    diffuse: wp.int32
    medium: wp.int32
    origin: wp.vec3
    direction: wp.vec3
    anchor: wp.vec3
    throughput: wp.vec3
    pdf: wp.float32
    t: wp.float32
    prim: wp.int32
    u: wp.float32
    v: wp.float32


@wp.struct
class Orders:
    """What is asked of a vertex.

    Attributes:
        i: number of the vertex in its launch, and of what is written of it.
        light_samples: shadow segments of what the camera sees: places are counted by them.
        shots: shadow segments of each vertex of the launch; segment j is number i * shots + j.
        max_depth: longest path in edges; 0 for no limit.
        diffuse_light: BY_MAP, BY_PATHS or BY_FINAL_GATHER.
        action: in BY_FINAL_GATHER, what the diffuse part of this vertex does.
        eye: where depths are measured from.
        offset_min: least distance at which rays leave a surface.
    """

    i: wp.int32
    light_samples: wp.int32
    shots: wp.int32
    max_depth: wp.int32
    diffuse_light: wp.int32
    action: wp.int32
    seed: wp.uint32
    eye: wp.vec3
    offset_min: wp.float32


@wp.func
def orders_of(
    camera: CameraView,
    offset_min: wp.float32,
    light_samples: wp.int32,
    shots: wp.int32,
    max_depth: wp.int32,
    diffuse_light: wp.int32,
    action: wp.int32,
    i: wp.int32,
) -> Orders:
    """Orders for one vertex of a launch."""
    orders = Orders()
    orders.i = i
    orders.light_samples = light_samples
    orders.shots = shots
    orders.max_depth = max_depth
    orders.diffuse_light = diffuse_light
    orders.action = action
    orders.seed = camera.seed
    orders.eye = camera.eye
    orders.offset_min = offset_min
    return orders


@wp.func
def camera_path(camera: CameraView, paths: Paths, i: wp.int32) -> Vertex:
    """Where a camera path arrives."""
    p = Vertex()
    p.slot = paths.slot[i]
    p.pixel = paths.pixel[i]
    p.item = wp.uint32(whole_pixel(camera, p.pixel))
    p.sample = paths.sample[i]
    p.bounce = paths.bounce[i]
    p.edges = paths.edges[i]
    p.diffuse = paths.diffuse[i]
    p.medium = paths.medium[i]
    p.origin = paths.origin[i]
    p.direction = paths.direction[i]
    p.anchor = paths.anchor[i]
    p.throughput = paths.throughput[i]
    p.pdf = paths.pdf[i]
    p.t = paths.t[i]
    p.prim = paths.prim[i]
    p.u = paths.u[i]
    p.v = paths.v[i]
    return p


@wp.func
def number_1d(seed: wp.uint32, p: Vertex, dimension: wp.int32) -> wp.float32:
    """A random number of a vertex, in [0, 1)."""
    stream = stream_of(seed, PURPOSE_BOUNCE, p.item, DIMENSIONS * p.bounce + dimension)
    return wp.float32(sample_1d(wp.uint32(p.sample), stream))


@wp.func
def numbers_2d(seed: wp.uint32, p: Vertex) -> wp.vec2:
    """The random numbers of the direction in which a path goes on."""
    return sample_2d(wp.uint32(p.sample), stream_of(seed, PURPOSE_BOUNCE, p.item, DIMENSIONS * p.bounce + DIRECTION))


@wp.func
def place_of(bounce: wp.int32, diffuse: wp.int32, light_samples: wp.int32, part: wp.int32) -> wp.int32:
    """Where a part of a vertex, its shadow rays first, stands in its sample: cluster.parts.

    Args:
        diffuse: as in cluster.batch.SCHEMAS.
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
def carry_on(
    p: Vertex,
    carries: wp.vec3,
    origin: wp.vec3,
    direction: wp.vec3,
    anchor: wp.vec3,
    pdf: wp.float32,
    edges: wp.int32,
    diffuse: wp.int32,
    medium: wp.int32,
    roulette_from: wp.int32,
    survival_most: wp.float32,
    seed: wp.uint32,
    i: wp.int32,
    paths_out: Paths,
) -> None:
    """Write down the ray that goes on, unless Russian roulette ends it: a throughput of zero says so.

    Args:
        roulette_from: vertices before Russian roulette begins.
        survival_most: largest probability of survival.
    """
    if wp.max(carries) > 0.0 and p.bounce >= roulette_from:
        survival = wp.min(survival_most, wp.max(carries))
        if number_1d(seed, p, ROULETTE) < survival:
            carries = carries / survival
        else:
            carries = wp.vec3(0.0)
    if p.bounce + 1 >= _CHAIN_LIMIT:
        carries = wp.vec3(0.0)
    paths_out.slot[i] = p.slot
    paths_out.pixel[i] = p.pixel
    paths_out.sample[i] = p.sample
    paths_out.bounce[i] = p.bounce + 1
    paths_out.edges[i] = edges
    paths_out.diffuse[i] = diffuse
    paths_out.medium[i] = medium
    paths_out.origin[i] = origin
    paths_out.direction[i] = direction
    paths_out.anchor[i] = anchor
    paths_out.throughput[i] = carries
    paths_out.pdf[i] = pdf
    paths_out.t[i] = NO_HIT
    paths_out.prim[i] = -1
    paths_out.u[i] = 0.0
    paths_out.v[i] = 0.0
    paths_out.owner[i] = -1


@wp.func
def stretch(p: Vertex, length: wp.float32, light_samples: wp.int32, i: wp.int32, stretches_out: Stretches) -> None:
    """Write down the stretch of the ray before a vertex, if it is in a medium."""
    stretches_out.slot[i] = p.slot
    stretches_out.sample[i] = p.sample
    stretches_out.place[i] = place_of(p.bounce, p.diffuse, light_samples, light_samples + BEAM_PART)
    stretches_out.origin[i] = p.origin
    stretches_out.direction[i] = wp.normalize(p.direction)
    stretches_out.length[i] = length
    stretches_out.radiance[i] = p.throughput
    stretches_out.medium[i] = p.medium


@wp.func
def nothing_seen(p: Vertex, orders: Orders, seen_out: Seen, queries_out: Queries) -> None:
    """A vertex on no surface has nothing to show, and asks for no photons."""
    i = orders.i
    seen_out.emission[i] = wp.vec3(0.0)
    seen_out.depth[i] = -1.0
    seen_out.normal[i] = wp.vec3(0.0)
    seen_out.albedo[i] = wp.vec3(0.0)
    queries_out.weight[i] = wp.vec3(0.0)
    queries_out.edges[i] = p.edges


@wp.func
def nothing_lit(p: Vertex, orders: Orders, j: wp.int32, shots_out: Shots) -> None:
    """Shadow ray j of a vertex is not there."""
    row = orders.i * orders.shots + j
    shots_out.slot[row] = p.slot
    shots_out.place[row] = place_of(p.bounce, p.diffuse, orders.light_samples, j)
    shots_out.radiance[row] = wp.vec3(0.0)


@wp.func
def nothing_goes_on(p: Vertex, orders: Orders, paths_out: Paths) -> None:
    """A path ends at a vertex."""
    ends = wp.vec3(0.0)
    carry_on(
        p,
        ends,
        p.origin,
        p.direction,
        p.anchor,
        p.pdf,
        p.edges,
        p.diffuse,
        p.medium,
        ROULETTE_FROM,
        SURVIVAL_MOST,
        orders.seed,
        orders.i,
        paths_out,
    )
