"""Building the bounding volume hierarchy: 8-wide nodes by the binned surface area heuristic.

One Warp kernel, each thread of which builds a subtree, on the host: one thread builds what is small, and of more
triangles the nodes that hold large parts of them are built first, each alone, and then what is below side by side
(build_tree). Each node is built at once with up to eight children, by splitting the child of the largest area again and
again, so no binary tree is stored. A split bins the centroids along all three axes (Wald 2007, "On fast construction of
SAH-based bounding volume hierarchies").

Boxes are kept as vec8 (low xyz, unused, -high xyz, unused): the union of two boxes is then one element-wise minimum.

The tree's depth is bounded: once a range could no longer be finished within MAX_DEPTH by halving, it is halved by
position in the array. So neither a million triangles in one point nor a geometric series of sizes overflows
the traversal's stack.
"""

from __future__ import annotations

import warp as wp

from wdpm.kernels.rays.lanes import vec8, vec8i

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

WIDTH = wp.constant(8)
"""Children a node: one AVX register of float32."""

LEAF_MAX = wp.constant(8)
"""Triangles a leaf at most: what one pass of lanes_inside takes, and what a child code has room for."""

MAX_TRIANGLES = 2**31 // 18
"""Triangles a tree at most: places in `corners` (9 a triangle) and child codes (8 a triangle) stay within int32."""

MAX_DEPTH = wp.constant(11)
"""Levels of nodes at most. MAX_TRIANGLES need 8 by halving; the heuristic takes 8 for Sponza, 7 for a terrain of two
million triangles."""

CHILD_STACK = wp.constant(7 * 11)
"""(WIDTH - 1) * MAX_DEPTH: a traversal leaves at most WIDTH - 1 siblings behind on each level. No larger than need be,
since Warp clears local arrays: that takes a tenth of the time of a ray."""

RANGES = wp.constant(8 * 12)
"""WIDTH * (MAX_DEPTH + 1): ranges that wait while a subtree is built, at most."""

BINS = wp.constant(32)
"""Bins an axis. 16 make coherent rays a fifth slower where sizes vary (Sponza)."""

SMALL_BINS = wp.constant(8)
SMALL_RANGE = wp.constant(64)
"""Ranges up to this size use SMALL_BINS: clearing and sweeping more would cost more than filling them."""

FAR = wp.constant(3.4e38)


@wp.struct
class Scratch:
    """Working memory of the builder. Each of several threads has a room of its own in all arrays but the first two.

    Attributes:
        room: which is this thread's, from 0.
        boxes: box of each triangle, in build order, shape [T].
        order: row of each triangle in the input, in build order, shape [T].
        bin_boxes: shape [rooms * 3 * BINS]; bin_counts: the same shape.
        right_areas: areas of what lies right of a bin boundary, shape [rooms * BINS].
        slot_boxes, slot_begin, slot_end: the children of the node being built, shape [rooms * WIDTH].
        ranges: (begin, end, node, depth) of the ranges to be built, shape [rooms * RANGES].
    """

    room: wp.int32
    boxes: wp.array[vec8]
    order: wp.array[wp.int32]
    bin_boxes: wp.array[vec8]
    bin_counts: wp.array[wp.int32]
    right_areas: wp.array[wp.float32]
    slot_boxes: wp.array[vec8]
    slot_begin: wp.array[wp.int32]
    slot_end: wp.array[wp.int32]
    ranges: wp.array[wp.vec4i]


@wp.func
def empty_box() -> vec8:
    return vec8(FAR)


@wp.func
def half_area(box: vec8) -> float:
    x = -box[4] - box[0]
    y = -box[5] - box[1]
    z = -box[6] - box[2]
    return x * y + y * z + z * x


@wp.func
def centroid(box: vec8) -> wp.vec3:
    """Twice the centre."""
    return wp.vec3(box[0] - box[4], box[1] - box[5], box[2] - box[6])


@wp.func
def bin_of(centre: float, low: float, scale: float, bins: int) -> int:
    return wp.min(int((centre - low) * scale), bins - 1)


@wp.func
def range_box(s: wp.ref[Scratch], begin: int, end: int) -> vec8:
    box = empty_box()
    for i in range(begin, end):
        box = wp.min(box, s.boxes[i])
    return box


@wp.func
def halve(begin: int, end: int) -> int:
    return begin + (end - begin) / 2


@wp.func
def levels_by_halving(count: int) -> int:
    """Levels of nodes that halving needs to get a range down to one leaf."""
    levels = wp.int32(1)
    left = (count + WIDTH - 1) / WIDTH
    while left > LEAF_MAX:
        left = (left + WIDTH - 1) / WIDTH
        levels = levels + 1
    return levels


@wp.func
def blocks(count: int) -> float:
    """What testing so many triangles costs, in fours: a leaf tests up to eight at once, and is seldom full."""
    return float((count + 3) >> 2)


@wp.func
def partition(
    s: wp.ref[Scratch], begin: int, end: int, axis: int, low: float, scale: float, bins: int, last_left: int
) -> int:
    """Move the triangles whose bin is at most `last_left` to the front; returns where the others begin."""
    i = int(begin)
    j = int(end - 1)
    while i <= j:
        box = s.boxes[i]
        if bin_of(box[axis] - box[axis + 4], low, scale, bins) <= last_left:
            i = i + 1
        else:
            row = s.order[i]
            s.boxes[i] = s.boxes[j]
            s.order[i] = s.order[j]
            s.boxes[j] = box
            s.order[j] = row
            j = j - 1
    return i


@wp.func
def split(s: wp.ref[Scratch], begin: int, end: int) -> int:
    """Reorder a range of at least two triangles and return where its second part begins; neither part is empty."""
    count = end - begin
    own = s.room * 3 * BINS
    own_areas = s.room * BINS
    low = wp.vec3(FAR)
    high = wp.vec3(-FAR)
    for i in range(begin, end):
        c = centroid(s.boxes[i])
        low = wp.min(low, c)
        high = wp.max(high, c)

    bins = int(BINS)
    if count <= SMALL_RANGE:
        bins = int(SMALL_BINS)
    extent = high - low
    scale = wp.vec3()
    for axis in range(3):
        if extent[axis] > 0.0:
            scale[axis] = wp.min(float(bins) / extent[axis], FAR)
    for k in range(3 * bins):
        s.bin_boxes[own + k] = empty_box()
        s.bin_counts[own + k] = 0
    for i in range(begin, end):
        box = s.boxes[i]
        c = centroid(box)
        kx = own + bin_of(c[0], low[0], scale[0], bins)
        ky = own + bin_of(c[1], low[1], scale[1], bins) + bins
        kz = own + bin_of(c[2], low[2], scale[2], bins) + 2 * bins
        s.bin_boxes[kx] = wp.min(s.bin_boxes[kx], box)
        s.bin_boxes[ky] = wp.min(s.bin_boxes[ky], box)
        s.bin_boxes[kz] = wp.min(s.bin_boxes[kz], box)
        s.bin_counts[kx] = s.bin_counts[kx] + 1
        s.bin_counts[ky] = s.bin_counts[ky] + 1
        s.bin_counts[kz] = s.bin_counts[kz] + 1

    best_cost = float(FAR)
    best_axis = wp.int32(-1)
    best_bin = wp.int32(0)
    for axis in range(3):
        if scale[axis] > 0.0:
            right = empty_box()
            for back in range(bins - 1):
                k = bins - 1 - back
                right = wp.min(right, s.bin_boxes[own + axis * bins + k])
                s.right_areas[own_areas + k] = half_area(right)
            left = empty_box()
            left_count = wp.int32(0)
            for k in range(bins - 1):
                left = wp.min(left, s.bin_boxes[own + axis * bins + k])
                left_count = left_count + s.bin_counts[own + axis * bins + k]
                if left_count > 0 and left_count < count:
                    right_count = count - left_count
                    right_area = s.right_areas[own_areas + k + 1]
                    cost = half_area(left) * blocks(left_count) + right_area * blocks(right_count)
                    if cost < best_cost:
                        best_cost = cost
                        best_axis = axis
                        best_bin = k
    if best_axis < 0:
        return halve(begin, end)  # all centroids in one point, or areas beyond float32
    return partition(s, begin, end, best_axis, low[best_axis], scale[best_axis], bins, best_bin)


@wp.func
def next_slot(s: wp.ref[Scratch], slots: int, halving: bool) -> int:
    """Which child to split next: that of the largest area (when halving, the most triangles); -1 if all are leaves.

    A range that fits a leaf is not split even where there is room: a leaf of eight costs no more than a leaf of one.
    """
    own = s.room * WIDTH
    best = wp.int32(-1)
    best_score = wp.float32(-1.0)
    for k in range(slots):
        count = s.slot_end[own + k] - s.slot_begin[own + k]
        if count > LEAF_MAX:
            score = half_area(s.slot_boxes[own + k])
            if halving or not (score < FAR):
                score = float(count)
            if score > best_score:
                best = k
                best_score = score
    return best


@wp.kernel
def box_triangles(positions: wp.array2d(dtype=wp.vec3), pad: wp.float32, s: Scratch, offset: wp.int32) -> None:
    i = offset + wp.tid()
    a = positions[i, 0]
    b = positions[i, 1]
    c = positions[i, 2]
    low = wp.min(a, wp.min(b, c)) - wp.vec3(pad)
    high = wp.max(a, wp.max(b, c)) + wp.vec3(pad)
    s.boxes[i] = vec8(low[0], low[1], low[2], 0.0, -high[0], -high[1], -high[2], 0.0)
    s.order[i] = i


@wp.kernel
def build_nodes(
    scratch: Scratch,
    tasks: wp.array[wp.vec4i],
    whole: wp.int32,
    bounds_out: wp.array[vec8],
    children_out: wp.array[vec8i],
    sizes_out: wp.array[wp.vec2i],
    offset: wp.int32,
) -> None:
    """Build the subtrees of some ranges of triangles, or their roots alone.

    Args:
        scratch: with a room for each task.
        tasks: begin and end of each range, number of its root, which those of others follow, and how deep that lies.
        whole: 1 to build all; 0 for the roots alone: then their children that are no leaves are numbered as if they
            came next, and their ranges are left in `scratch.ranges`.
        sizes_out: of each task, nodes that have numbers, and levels of the tree.
    """
    s = scratch
    s.room = offset + wp.tid()
    own = s.room * WIDTH
    own_ranges = s.room * RANGES
    given = tasks[s.room]
    first = given[2]
    nodes = wp.int32(1)
    deepest = given[3]
    pending = wp.int32(1)
    s.ranges[own_ranges] = wp.vec4i(given[0], given[1], 0, given[3])
    while pending > 0:
        pending = pending - 1
        task = s.ranges[own_ranges + pending]
        node = first + task[2]
        depth = task[3]
        deepest = wp.max(deepest, depth)
        s.slot_begin[own] = task[0]
        s.slot_end[own] = task[1]
        s.slot_boxes[own] = range_box(s, task[0], task[1])
        slots = wp.int32(1)
        if given[0] == given[1]:
            slots = 0
        halving = depth + levels_by_halving(task[1] - task[0]) >= MAX_DEPTH

        while slots < WIDTH:
            k = next_slot(s, slots, halving)
            if k < 0:
                break
            begin = s.slot_begin[own + k]
            end = s.slot_end[own + k]
            middle = wp.int32(0)
            if halving:
                middle = halve(begin, end)
            else:
                middle = split(s, begin, end)
            s.slot_end[own + k] = middle
            s.slot_begin[own + slots] = middle
            s.slot_end[own + slots] = end
            s.slot_boxes[own + k] = range_box(s, begin, middle)
            s.slot_boxes[own + slots] = range_box(s, middle, end)
            slots = slots + 1

        low_x = vec8(wp.inf)
        low_y = vec8(wp.inf)
        low_z = vec8(wp.inf)
        high_x = vec8(-wp.inf)
        high_y = vec8(-wp.inf)
        high_z = vec8(-wp.inf)
        codes = vec8i()
        for k in range(slots):
            box = s.slot_boxes[own + k]
            low_x[k] = box[0]
            low_y[k] = box[1]
            low_z[k] = box[2]
            high_x[k] = -box[4]
            high_y[k] = -box[5]
            high_z[k] = -box[6]
            begin = s.slot_begin[own + k]
            size = s.slot_end[own + k] - begin
            if size <= LEAF_MAX:
                codes[k] = -(8 * begin + size)
            else:
                codes[k] = first + nodes
                s.ranges[own_ranges + pending] = wp.vec4i(begin, begin + size, nodes, depth + 1)
                pending = pending + 1
                nodes = nodes + 1
        bounds_out[6 * node] = low_x
        bounds_out[6 * node + 1] = high_x
        bounds_out[6 * node + 2] = low_y
        bounds_out[6 * node + 3] = high_y
        bounds_out[6 * node + 4] = low_z
        bounds_out[6 * node + 5] = high_z
        children_out[node] = codes
        if whole == 0:
            break
    sizes_out[s.room] = wp.vec2i(nodes, deepest + 1)


@wp.kernel
def pack_leaves(
    positions: wp.array2d(dtype=wp.vec3),
    ids: wp.array[wp.int32],
    order: wp.array[wp.int32],
    children: wp.array[vec8i],
    corners_out: wp.array[wp.float32],
    ids_out: wp.array[wp.int32],
    offset: wp.int32,
) -> None:
    """Write the triangles of each leaf: nine rows (corner, axis), each as long as the leaf has triangles."""
    node = offset + wp.tid()
    codes = children[node]
    for k in range(WIDTH):
        if codes[k] < 0:
            first = (-codes[k] - 1) >> 3
            size = -codes[k] - 8 * first
            for lane in range(size):
                row = order[first + lane]
                ids_out[first + lane] = ids[row]
                for corner in range(3):
                    p = positions[row, corner]
                    for axis in range(3):
                        corners_out[9 * first + (3 * corner + axis) * size + lane] = p[axis]
