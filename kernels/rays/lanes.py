"""Eight floats side by side: what the tree's nodes and leaves are tested with.

Warp's own vector operators become SIMD code only where the optimiser sees through them (its min and max, which skip
NaNs, do not), and a ray spends its time in these few functions: as native snippets they make it twice as fast
overall. Each is written once: on the CPU `lanes` is a vector of eight floats and the loop runs once, on a GPU it is
one float and the loop runs eight times. Both round alike, operation by operation.
"""

from __future__ import annotations

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

vec8 = wp.types.vector(length=8, dtype=wp.float32)
vec8i = wp.types.vector(length=8, dtype=wp.int32)

_LANES = """
    wp::vec_t<8, wp::float32> result;
#if defined(__CUDA_ARCH__)
    typedef float lanes;
#define LANES_ABS(x) fabsf(x)
    for (int k = 0; k < 8; ++k)
#else
    typedef float lanes __attribute__((ext_vector_type(8), aligned(4)));
#define LANES_ABS(x) __builtin_elementwise_abs(x)
    const int k = 0;
#endif
"""

_ENTER = """
    const float* rows = bounds.data->c + 48 * node;
    const float* x = rows + (inverse[0] > 0.0f ? 0 : 8);
    const float* y = rows + (inverse[1] > 0.0f ? 16 : 24);
    const float* z = rows + (inverse[2] > 0.0f ? 32 : 40);
    @LANES@
    {
        const lanes enter_x = (*(const lanes*)(x + k) - origin[0]) * inverse[0];
        const lanes enter_y = (*(const lanes*)(y + k) - origin[1]) * inverse[1];
        const lanes enter_z = (*(const lanes*)(z + k) - origin[2]) * inverse[2];
        const lanes enter_xy = enter_x > enter_y ? enter_x : enter_y;
        const lanes enter_z0 = enter_z > 0.0f ? enter_z : (lanes)0.0f;
        *(lanes*)(result.c + k) = enter_xy > enter_z0 ? enter_xy : enter_z0;
    }
    return result;
""".replace("@LANES@", _LANES)

_LEAVE = """
    const float* rows = bounds.data->c + 48 * node;
    const float* x = rows + (inverse[0] > 0.0f ? 8 : 0);
    const float* y = rows + (inverse[1] > 0.0f ? 24 : 16);
    const float* z = rows + (inverse[2] > 0.0f ? 40 : 32);
    @LANES@
    {
        const lanes leave_x = (*(const lanes*)(x + k) - origin[0]) * inverse[0];
        const lanes leave_y = (*(const lanes*)(y + k) - origin[1]) * inverse[1];
        const lanes leave_z = (*(const lanes*)(z + k) - origin[2]) * inverse[2];
        const lanes leave_xy = leave_x < leave_y ? leave_x : leave_y;
        const lanes leave_zt = leave_z < t_max ? leave_z : (lanes)t_max;
        *(lanes*)(result.c + k) = leave_xy < leave_zt ? leave_xy : leave_zt;
    }
    return result;
""".replace("@LANES@", _LANES)

_DISTANCE2 = """
    const float* rows = bounds.data->c + 48 * node;
    @LANES@
    {
        const lanes below_x = *(const lanes*)(rows + k) - point[0];
        const lanes below_y = *(const lanes*)(rows + 8 + k) - point[1];
        const lanes below_z = *(const lanes*)(rows + 16 + k) - point[2];
        const lanes above_x = point[0] - *(const lanes*)(rows + 24 + k);
        const lanes above_y = point[1] - *(const lanes*)(rows + 32 + k);
        const lanes above_z = point[2] - *(const lanes*)(rows + 40 + k);
        const lanes off_x = below_x > above_x ? below_x : above_x;
        const lanes off_y = below_y > above_y ? below_y : above_y;
        const lanes off_z = below_z > above_z ? below_z : above_z;
        const lanes x = off_x > 0.0f ? off_x : (lanes)0.0f;
        const lanes y = off_y > 0.0f ? off_y : (lanes)0.0f;
        const lanes z = off_z > 0.0f ? off_z : (lanes)0.0f;
        *(lanes*)(result.c + k) = x * x + y * y + z * z;
    }
    return result;
""".replace("@LANES@", _LANES)

_NOT_ABOVE = """
#if defined(__CUDA_ARCH__)
    int mask = 0;
    for (int k = 0; k < 8; ++k)
        mask |= (a.c[k] > b.c[k] ? 0 : 1) << k;
    return mask;
#else
    typedef float lanes __attribute__((ext_vector_type(8), aligned(4)));
    typedef bool bits __attribute__((ext_vector_type(8)));
    const bits above = __builtin_convertvector(*(const lanes*)a.c > *(const lanes*)b.c, bits);
    return 255 & ~__builtin_bit_cast(unsigned char, above);
#endif
"""

_SLABS = """
#if defined(__CUDA_ARCH__)
    typedef double wide;
#define WIDE(x, k) ((double)(x).c[k])
#define WIDE_ABS(x) fabs(x)
    int mask = 0;
    for (int k = 0; k < 8; ++k)
#else
    typedef double wide __attribute__((ext_vector_type(8), aligned(8)));
    typedef float lanes __attribute__((ext_vector_type(8), aligned(4)));
    typedef bool bits __attribute__((ext_vector_type(8)));
#define WIDE(x, k) __builtin_convertvector(*(const lanes*)(x).c, wide)
#define WIDE_ABS(x) __builtin_elementwise_abs(x)
    int mask;
    const int k = 0;
#endif
    {
        const double* rows = slabs.data + 48 * block + k;
        const wide x = *(const wide*)rows;
        const wide y = *(const wide*)(rows + 8);
        const wide z = *(const wide*)(rows + 16);
        const wide low = *(const wide*)(rows + 24);
        const wide high = *(const wide*)(rows + 32);
        const wide reach = *(const wide*)(rows + 40);
        const wide along = x * (double)direction[0] + y * (double)direction[1] + z * (double)direction[2];
        const wide at = x * (double)origin[0] + y * (double)origin[1] + z * (double)origin[2];
        const wide speed = WIDE_ABS(along);
        const wide near = along < 0.0 ? at - high : low - at;
        const wide far = along < 0.0 ? at - low : high - at;
        const wide last = WIDE(leave, k) * (1.0 + 0x1p-24) * speed;
        const auto before = near * (1.0 - 0x1p-45) <= last;
        const auto ahead = far * (1.0 + 0x1p-45) >= WIDE(enter, k) * (1.0 - 0x1p-24) * speed;
        const wide farthest = WIDE_ABS(near) > WIDE_ABS(far) ? WIDE_ABS(near) : WIDE_ABS(far);
        const auto edge_on = speed <= longest * 0x1p-5;
        const auto beyond = farthest * (double)longest > reach * speed;
        const auto met = (before & ahead) | edge_on | beyond;
#if defined(__CUDA_ARCH__)
        mask |= (met != 0) << k;
    }
    return mask;
#else
        mask = __builtin_bit_cast(unsigned char, __builtin_convertvector(met, bits));
    }
    return mask;
#endif
"""

_INSIDE = """
    const float* rows = corners.data + 9 * first;
    const float ox = origin[0], oy = origin[1], oz = origin[2];
    const float dx = direction[0], dy = direction[1], dz = direction[2];
    @LANES@
    {
        const lanes ax = *(const lanes*)(rows + k);
        const lanes ay = *(const lanes*)(rows + size + k);
        const lanes az = *(const lanes*)(rows + 2 * size + k);
        const lanes e1x = *(const lanes*)(rows + 3 * size + k) - ax;
        const lanes e1y = *(const lanes*)(rows + 4 * size + k) - ay;
        const lanes e1z = *(const lanes*)(rows + 5 * size + k) - az;
        const lanes e2x = *(const lanes*)(rows + 6 * size + k) - ax;
        const lanes e2y = *(const lanes*)(rows + 7 * size + k) - ay;
        const lanes e2z = *(const lanes*)(rows + 8 * size + k) - az;
        const lanes cx = ax - ox;
        const lanes cy = ay - oy;
        const lanes cz = az - oz;
        const lanes rx = cy * dz - cz * dy;
        const lanes ry = cz * dx - cx * dz;
        const lanes rz = cx * dy - cy * dx;
        const lanes u = rx * e2x + ry * e2y + rz * e2z;
        const lanes v = -(rx * e1x + ry * e1y + rz * e1z);
        const lanes nx = e1y * e2z - e1z * e2y;
        const lanes ny = e1z * e2x - e1x * e2z;
        const lanes nz = e1x * e2y - e1y * e2x;
        const lanes w = nx * dx + ny * dy + nz * dz - u - v;
        lanes low = u < v ? u : v;
        low = low < w ? low : w;
        lanes high = u > v ? u : v;
        high = high > w ? high : w;
        const lanes inside = low > -high ? low : -high;
        lanes e = LANES_ABS(e1x);
        e = LANES_ABS(e1y) > e ? LANES_ABS(e1y) : e;
        e = LANES_ABS(e1z) > e ? LANES_ABS(e1z) : e;
        e = LANES_ABS(e2x) > e ? LANES_ABS(e2x) : e;
        e = LANES_ABS(e2y) > e ? LANES_ABS(e2y) : e;
        e = LANES_ABS(e2z) > e ? LANES_ABS(e2z) : e;
        lanes c = LANES_ABS(cx);
        c = LANES_ABS(cy) > c ? LANES_ABS(cy) : c;
        c = LANES_ABS(cz) > c ? LANES_ABS(cz) : c;
        const lanes reach = c + e;
        *(lanes*)(result.c + k) = inside + (reach * (e + reach * 0x1p-26f) * (d_max * 0x1p-17f) + 1.0e-36f);
    }
    return result;
""".replace("@LANES@", _LANES)


_CONES = """
#if defined(__CUDA_ARCH__)
    typedef float lanes;
    int mask = 0;
    for (int k = 0; k < 8; ++k)
#else
    typedef float lanes __attribute__((ext_vector_type(8), aligned(4)));
    typedef bool bits __attribute__((ext_vector_type(8)));
    int mask;
    const int k = 0;
#endif
    {
        const float* rows = cones.data + 32 * block + k;
        const lanes x = *(const lanes*)rows - origin[0];
        const lanes y = *(const lanes*)(rows + 8) - origin[1];
        const lanes z = *(const lanes*)(rows + 16) - origin[2];
        const lanes along = x * direction[0] + y * direction[1] + z * direction[2];
        const lanes square = x * x + y * y + z * z;
        const auto met = (along > 0.0f) & (along * along > *(const lanes*)(rows + 24) * square);
#if defined(__CUDA_ARCH__)
        mask |= (met != 0) << k;
    }
    return mask;
#else
        mask = __builtin_bit_cast(unsigned char, __builtin_convertvector(met, bits));
    }
    return mask;
#endif
"""


@wp.func_native(_ENTER)
def children_enter(bounds: wp.array[vec8], node: int, origin: wp.vec3, inverse: wp.vec3) -> vec8:
    """Where a ray enters the boxes of a node's children, not before its origin.

    Args:
        bounds: six rows a node: low x, high x, low y, high y, low z, high z.
        node: the node's number.
        origin: of the ray.
        inverse: 1 / direction, see triangle.Ray.
    """
    ...


@wp.func_native(_LEAVE)
def children_leave(bounds: wp.array[vec8], node: int, origin: wp.vec3, inverse: wp.vec3, t_max: float) -> vec8:
    """Where a ray leaves the boxes of a node's children, not after t_max; `inverse` as scaled for leaving."""
    ...


@wp.func_native(_DISTANCE2)
def children_distance2(bounds: wp.array[vec8], node: int, point: wp.vec3) -> vec8:
    """Squared distances from a point to the boxes of a node's children, inf for empty boxes.

    Args:
        bounds: six rows a node: low x, y, z, high x, y, z; empty boxes are +inf .. -inf.
        node: the node's number.
        point: finite.
    """
    ...


@wp.func_native(_NOT_ABOVE)
def lanes_not_above(a: vec8, b: vec8) -> int:
    """Bit k is set unless a[k] > b[k]; a NaN sets it: when in doubt, look closer."""
    ...


@wp.func_native(_SLABS)
def slabs_met(
    slabs: wp.array[wp.float64],
    block: int,
    origin: wp.vec3,
    direction: wp.vec3,
    longest: float,
    enter: vec8,
    leave: vec8,
) -> int:
    """Bit k is set unless a ray does not come to slab k of a block, from enter[k], which is not below 0, to leave[k].

    A slab is what lies between two parallel planes. It is set, too, where that can't be told: at a cosine of less than
    2^-5 / sqrt(3) between normal and direction, and from further away than the slab's reach. Sides are compared times
    the ray's speed along the normal, so that nothing is divided: 1 - 2^-45 covers the roundings of the products, and
    what is not above a float times 1 + 2^-24, nor below another times 1 - 2^-24, may be rounded to that float.

    Args:
        slabs: six rows of eight numbers a block: a unit normal's x, y and z, the least and the largest distance along
            it, and the reach. A normal of 0 is met by every ray.
        longest: the direction's largest absolute component.
    """
    ...


@wp.func_native(_CONES)
def cones_met(cones: wp.array[wp.float32], block: int, origin: wp.vec3, direction: wp.vec3) -> int:
    """Bit k is set if a direction lies in cone k of a block, about the way from the origin to the cone's target.

    Args:
        cones: four rows of eight numbers a block: a target's x, y and z, and the squared cosine of the half angle,
            which is a right angle at most.
        direction: of length 1.
    """
    ...


@wp.func_native(_INSIDE)
def lanes_inside(
    corners: wp.array[wp.float32], first: int, size: int, origin: wp.vec3, direction: wp.vec3, d_max: float
) -> vec8:
    """Which triangles of a leaf a ray may hit: below 0 only where intersect_triangle says miss.

    Lanes from `size` on hold anything.

    Möller & Trumbore 1997 in float32, behind and before the origin. With c the first corner less the origin, e1 and e2
    the edges, u = (c x d) . e2, v = -(c x d) . e1 and w = (e1 x e2) . d - u - v have one sign on a hit: the least of
    them is not below 0, or the greatest not above. Errors, with r = 2^-24 and c, e, d for largest absolute components,
    to first order: a component of c x d is off by 6 r c d; u and v by 3 e (6 + 8) r c d = 42 r c e d; the determinant
    by 42 r e^2 d; w, a sum of these, by at most 108 r (c + e) e d. The margin added is 128 r (c + e) e d.
    intersect_triangle itself rounds corners by 2^-53 c, which moves its edge functions by less than 2^-48 c^2 d, and
    counts as inside what is within 2^-52 of size times distance (triangle.ON_EDGE): its size is less than
    12 (c + e) and its distance less than 15 (c + e), so within 2^-44 (c + e)^2 d. Adding 2^-26 (c + e) to e pays for
    both, and 1e-36 for underflow. Overflow gives NaN, which lanes_not_above counts
    as a candidate.

    Args:
        corners: leaf after leaf nine rows (corner, axis) of `size` floats.
        first, size: the leaf: how many triangles come before it, and its own.
        origin, direction: the ray.
        d_max: the direction's largest absolute component.
    """
    ...


@wp.func_native("return children.data->c[8 * node + lane];")
def child_code(children: wp.array[vec8i], node: int, lane: int) -> int:
    """children[node][lane]; plain indexing would copy all eight first."""
    ...


_EXPECT = """
#if !defined(__CUDA_ARCH__)
    __builtin_prefetch(children.data->c + 8 * node);
#endif
"""


@wp.func_native(_EXPECT)
def expect_codes(children: wp.array[vec8i], node: int) -> None:
    """Have a processor fetch a node's child codes while its boxes are tested."""
    ...


_LEAF_CORNER = """
    const float* x = corners.data + at;
    return wp::vec_t<3, wp::float32>(x[axes[0] * size], x[axes[1] * size], x[axes[2] * size]);
"""


@wp.func_native(_LEAF_CORNER)
def leaf_corner(corners: wp.array[wp.float32], at: int, size: int, axes: wp.vec3i) -> wp.vec3:
    """A corner whose x lies at `at`, in a leaf of `size` triangles; its components in the order of `axes`."""
    ...


@wp.func
def lowest_bit(mask: int) -> int:
    """Number of the lowest bit that is set; mask is not 0."""
    return wp.bit_count((mask & -mask) - 1)
