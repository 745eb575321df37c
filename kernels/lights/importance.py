"""Importance: what a node of the light tree may send to a place, of several nodes at once.

It is strength / distance² * cosine, in the terms of Conty Estevez & Kulla 2018: the distance is to the middle of the
node's sphere, at least half the sphere's radius, and the cosine is of the least angle that may lie between an element's
axis and its way to the place. Nothing is asked of the receiver: surfaces may be glossy or let light through. It is zero
only where the angle is certainly (by MARGIN) too large for any light, so all light that arrives may be found.

A choice of a light is little else than this function, so it is a native snippet without branches, as those of
kernels/rays/lanes.py: of a processor's vectors, the two children of a node fill two places, eight heads fill eight.
"""

from __future__ import annotations

from collections.abc import Mapping

import warp as wp

from wdpm.kernels.rays.lanes import vec8

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_MARGIN = 2.0**-8
"""What a cosine may be below that of the reach and still count; and what cosines count for at least.

In float32 a sine near 0 is known to 3e-4 (the root of 1 - cos²), and three angles are combined: 2^-8 is four times as
much.
"""

_CLOSE2 = 0.25
"""Square of the least distance to a node, in radii of its sphere.

Points spread evenly over a ball of radius r send 3 / r² on the mean to its middle: 1 / r² would let a few lights close
by, in a node of many, come off badly. A quarter was best of 1, 1/2 and 1/4 in a hall of 1000 lamps.
"""

_IN_PLANE = 2.0**-12
"""Height over a flat lamp, in radii of its sphere, up to which a place counts as in its plane: what is lit there is lit
at grazing angles, and little. The chance is lowered, not taken away, so the estimate stays unbiased."""


@wp.struct
class LightNode:
    """As scenes.flat.light_tree.LightTree has it; the parent of a head is -1. 64 bytes: a line of a cache.

    Attributes:
        radius2: square of the radius.
        sin_axes: sine that goes with cos_axes.
    """

    center: wp.vec3
    radius: wp.float32
    axis: wp.vec3
    radius2: wp.float32
    cos_axes: wp.float32
    sin_axes: wp.float32
    cos_reach: wp.float32
    strength: wp.float32
    child: wp.int32
    parent: wp.int32
    first: wp.int32
    last: wp.int32


LANES = 8
"""Nodes of a block."""

ASKED = (
    *("center.c[0]", "center.c[1]", "center.c[2]", "radius", "axis.c[0]", "axis.c[1]", "axis.c[2]", "radius2"),
    *("cos_axes", "sin_axes", "cos_reach", "strength", "flat_from"),
)
"""What is asked of a node: the rows of a block.

`flat_from`: the cos_axes from which on it is a flat lamp: 1 of a leaf, 2 (never) of any other.
"""

_IMPORTANCE = f"""
        const lanes way_x = position[0] - center_x;
        const lanes way_y = position[1] - center_y;
        const lanes way_z = position[2] - center_z;
        const lanes distance2 = way_x * way_x + way_y * way_y + way_z * way_z;
        const lanes along = way_x * axis_x + way_y * axis_y + way_z * axis_z;
        const lanes close2 = radius2 * {_CLOSE2}f;
        const lanes beyond2 = distance2 > close2 ? distance2 : close2;
        const lanes value = strength / (beyond2 > least2 ? beyond2 : (lanes)least2);
        const lanes inverse = 1.0f / LANES_SQRT(distance2);
        // Of the angle between axis and way, what the spread of the axes leaves, ...
        lanes cosine = along * inverse;
        cosine = cosine > -1.0f ? cosine : (lanes)-1.0f;
        cosine = cosine < 1.0f ? cosine : (lanes)1.0f;
        const lanes whole = LANES_SQRT(1.0f - cosine * cosine);
        const lanes less = whole * cos_axes - cosine * sin_axes;
        const lanes positive = less > 0.0f ? less : (lanes)0.0f;
        const lanes sine = cosine < cos_axes ? positive : (lanes)0.0f;
        const lanes turned = cosine < cos_axes ? cosine * cos_axes + whole * sin_axes : (lanes)1.0f;
        // ... and then what the sphere's size leaves.
        const lanes size = radius * inverse;
        const lanes rest = 1.0f - size * size;
        const lanes cos_size = LANES_SQRT(rest > 0.0f ? rest : (lanes)0.0f);
        const lanes least = turned < cos_size ? turned * cos_size + sine * size : (lanes)1.0f;
        const lanes counts = least > {_MARGIN}f ? least : (lanes){_MARGIN}f;
        const lanes lit = least < cos_reach - {_MARGIN}f ? (lanes)0.0f : value * counts;
        // A flat lamp seen from a place in its own plane, such as the rest of a glowing wall.
        const lanes low = along <= {_IN_PLANE}f * radius ? value * {_MARGIN}f : value;
        const lanes near = cos_axes >= flat_from ? low : value;
        const lanes by_axes = cos_axes > -1.0f ? lit : near;
        const lanes result = distance2 > radius2 ? by_axes : near;
"""

_LANES = """
#if defined(__CUDA_ARCH__)
    typedef float lanes;
#define LANES_SQRT(x) sqrtf(x)
    for (int k = 0; k < @COUNT@; ++k)
#else
    typedef float lanes __attribute__((ext_vector_type(@COUNT@), aligned(4)));
#define LANES_SQRT(x) __builtin_elementwise_sqrt(x)
    const int k = 0;
#endif
    {
@LOADS@@IMPORTANCE@        *(lanes*)(importances.c + k) = result;
    }
    return importances;
"""


def _snippet(start: str, lanes: int, loads: Mapping[str, str]) -> str:
    """A snippet for some nodes at once; `loads` says what each number of theirs is read by."""
    lines = [f"        const lanes {_NAMES[asked]} = {load};\n" for asked, load in loads.items()]
    text = _LANES.replace("@COUNT@", str(lanes)).replace("@LOADS@", "".join(lines))
    return start + text.replace("@IMPORTANCE@", _IMPORTANCE)


_NAMES = {asked: asked.replace(".c[0]", "_x").replace(".c[1]", "_y").replace(".c[2]", "_z") for asked in ASKED}

_OF_BLOCK = _snippet(
    f"""
    wp::vec_t<{LANES}, wp::float32> importances;
    const float* first_row = rows.data->c + {LANES * len(ASKED)} * block;
""",
    LANES,
    {asked: f"*(const lanes*)(first_row + {LANES * row} + k)" for row, asked in enumerate(ASKED)},
)


@wp.func_native(_OF_BLOCK)
def importances_of_block(rows: wp.array[vec8], block: wp.int32, position: wp.vec3, least2: wp.float32) -> vec8:
    """What the nodes of a block may send to a place.

    Args:
        rows: a vector of eight nodes for each of ASKED, block after block.
        least2: square of the least distance that counts.
    """
    ...


_PAIR = """
    wp::vec_t<2, wp::float32> importances;
#if defined(__CUDA_ARCH__)
#define OF_PAIR(member) nodes.data[first + k].member
#define FLAT_FROM (nodes.data[first + k].child < 0 ? 1.0f : 2.0f)
#else
#define OF_PAIR(member) {nodes.data[first].member, nodes.data[first + 1].member}
#define FLAT_FROM {nodes.data[first].child < 0 ? 1.0f : 2.0f, nodes.data[first + 1].child < 0 ? 1.0f : 2.0f}
#endif
"""

_OF_PAIR = _snippet(_PAIR, 2, {asked: "FLAT_FROM" if asked == "flat_from" else f"OF_PAIR({asked})" for asked in ASKED})


@wp.func_native(_OF_PAIR)
def importances_of_pair(nodes: wp.array[LightNode], first: wp.int32, position: wp.vec3, least2: wp.float32) -> wp.vec2:
    """As importances_of_block, of two nodes that follow each other."""
    ...


_EXPECT_PAIR = """
#if !defined(__CUDA_ARCH__)
    if (first >= 0) {
        __builtin_prefetch(nodes.data + first);
        __builtin_prefetch(nodes.data + first + 1);
    }
#endif
"""


@wp.func_native(_EXPECT_PAIR)
def expect_pair(nodes: wp.array[LightNode], first: wp.int32) -> None:
    """Have a processor fetch two nodes, a cache line each, while others are looked at; none for a number below 0.

    A tree of many lights is larger than its second-level cache, and each node says where the next ones lie: without
    this, a walk waits for memory at each level, which takes as long as all that is computed there.
    """
    ...
