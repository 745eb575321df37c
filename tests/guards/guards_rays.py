"""Guards of rays and triangles: kernels/rays/triangle.py, lanes.py, bvh.py, bvh_build.py, ball_bounds.py."""

from __future__ import annotations

from guard import Guard, hard

TRAVERSAL = "tests/kernels/rays/test_traversal.py::"
EXTREMES = "tests/kernels/rays/test_traversal_extremes.py::"
BALLS = "tests/kernels/rays/test_ball_bounds.py::"
FUZZ = "tests/fuzz/test_fuzz_traversal.py::"

GUARDS = (
    Guard(
        name="ties by triangle number",
        file="kernels/rays/bvh.py",
        prevents="of two surfaces in one place, the tree decides which is seen",
        changes=(("if t < nearest.t or prim < nearest.prim:", "if t < nearest.t:"),),
        tests=(TRAVERSAL + "test_coplanar_duplicates_give_the_smaller_id",),
    ),
    Guard(
        name="nodes as far as the best hit",
        file="kernels/rays/bvh.py",
        prevents="a tie in a node that begins at the best hit is not seen",
        changes=(("found = stack_enter[height] <= nearest.t", "found = stack_enter[height] < nearest.t"),),
        tests=(EXTREMES + "test_copies_in_one_plane_without_any_pad",),
    ),
    Guard(
        name="doubt looks closer",
        file="kernels/rays/lanes.py",
        prevents="a NaN of the float32 test of eight triangles, by overflow, is a miss",
        changes=(
            (
                "const bits above = __builtin_convertvector(*(const lanes*)a.c > *(const lanes*)b.c, bits);",
                "const bits above = ~__builtin_convertvector(*(const lanes*)a.c <= *(const lanes*)b.c, bits);",
            ),
        ),
        tests=(EXTREMES + "test_any_unit_of_length",),
    ),
    Guard(
        name="places that a leaf does not fill",
        file="kernels/rays/bvh.py",
        prevents="of a leaf of fewer than eight, the next leaf's triangles are tested by its layout",
        changes=((" & ((1 << size) - 1)", ""),),
        tests=(FUZZ + "test_nearest_and_any_hits",),
    ),
    Guard(
        name="margin of eight at once",
        file="kernels/rays/lanes.py",
        prevents="the float32 test rejects hits that the exact one accepts",
        changes=(("(d_max * 0x1p-17f) + 1.0e-36f)", "(d_max * 0x1p-30f) + 1.0e-36f)"),),
        tests=(FUZZ + "test_nearest_and_any_hits",),
    ),
    Guard(
        name="margin for underflow",
        file="kernels/rays/lanes.py",
        prevents="triangles of 1e-20 vanish",
        changes=((" + 1.0e-36f)", ")"),),
        tests=(EXTREMES + "test_any_unit_of_length",),
    ),
    Guard(
        name="edges belong to both neighbours",
        file="kernels/rays/triangle.py",
        prevents="rays slip between two triangles, through their common edge",
        changes=(
            (
                "(u < zero or v < zero or w < zero) and (u > zero or v > zero or w > zero)",
                "(u <= zero or v <= zero or w <= zero) and (u >= zero or v >= zero or w >= zero)",
            ),
            (
                "wp.min(weights) < -doubt and wp.max(weights) > doubt",
                "wp.min(weights) <= 0.0 and wp.max(weights) >= 0.0",
            ),
        ),
        tests=(TRAVERSAL + "test_axis_rays_through_grid_corners_leak_nothing",),
    ),
    Guard(
        name="T-junctions overlap",
        file="kernels/rays/triangle.py",
        prevents="rays slip between triangles that meet along a line, but share no corners",
        changes=(("if not on_edge(x, y, wp.vec3d(pa[2], pb[2], pc[2]), wp.vec3d(u, v, w)):", "if True:"),),
        tests=(hard("aimed at T-junctions exactly"),),
    ),
    Guard(
        name="corners less origin in double",
        file="kernels/rays/triangle.py",
        prevents="hits are off by float32's rounding of the distance to the triangle",
        changes=(
            ("pa = wp.vec3d(a) - o", "pa = wp.vec3d(a - ray.turned_origin)"),
            ("pb = wp.vec3d(b) - o", "pb = wp.vec3d(b - ray.turned_origin)"),
            ("pc = wp.vec3d(c) - o", "pc = wp.vec3d(c - ray.turned_origin)"),
        ),
        tests=(FUZZ + "test_nearest_and_any_hits",),
    ),
    Guard(
        name="hits within the triangle's own box",
        file="kernels/rays/triangle.py",
        prevents="a hit that rounds a hair before its box is found by one tree and pruned by another",
        changes=(("t = wp.min(wp.max(t, enter), leave)", "t = t + 0.0 * leave"),),
        tests=(FUZZ + "test_nearest_and_any_hits",),
    ),
    Guard(
        name="boxes grown by pad",
        file="kernels/constants.py",
        prevents="hits on flat triangles along an axis fall out of their own boxes",
        changes=(("PAD_SHARE = 2.0**-19", "PAD_SHARE = 0.0"),),
        tests=(FUZZ + "test_no_cell_is_missed",),
    ),
    Guard(
        name="nodes' boxes hold grown triangles",
        file="kernels/rays/bvh_build.py",
        prevents="a node is pruned whose triangle's grown box the ray enters",
        changes=(
            ("low = wp.min(a, wp.min(b, c)) - wp.vec3(pad)", "low = wp.min(a, wp.min(b, c))"),
            ("high = wp.max(a, wp.max(b, c)) + wp.vec3(pad)", "high = wp.max(a, wp.max(b, c))"),
        ),
        tests=(TRAVERSAL + "test_tree_is_well_formed", FUZZ + "test_nearest_and_any_hits"),
    ),
    Guard(
        name="far faces a few roundings further",
        file="kernels/rays/triangle.py",
        prevents="rays along a wall far from their origin leave its box before they enter it",
        changes=(("EXIT_SCALE = wp.constant(1.0 + 2.0**-21)", "EXIT_SCALE = wp.constant(1.0)"),),
        tests=(FUZZ + "test_closed_meshes_leak_nothing",),
    ),
    Guard(
        name="balls hold their meshes",
        file="kernels/rays/ball_bounds.py",
        prevents="a ray into a round lamp passes by it",
        changes=(("GROW = 1.0 + 2.0**-18", "GROW = 1.0 - 2.0**-8"),),
        tests=(BALLS + "test_balls_skip_no_hit",),
    ),
    Guard(
        name="balls hold what is met beside rays along triangles",
        file="kernels/rays/ball_bounds.py",
        prevents="a ray from far away that grazes a round lamp and ends there passes by it, or not, as cells are cut",
        changes=(("DISTANT = wp.constant(wp.float64(2.0**-23))", "DISTANT = wp.constant(wp.float64(0.0))"),),
        tests=(BALLS + "test_balls_skip_no_hit_of_far_rays_along_triangles",),
    ),
    Guard(
        name="shadow rays end before balls",
        file="kernels/lights/balls.py",
        prevents="shadow rays to round lamps look for blockers in vain among the lamps' own triangles",
        changes=(("CLEARANCE * node.radius + ROUNDINGS * (place + distance)", "0.0"),),
        tests=(BALLS + "test_shadow_rays_pass_by_the_balls_that_they_lead_to",),
    ),
    Guard(
        name="a finite inverse of zero",
        file="kernels/rays/triangle.py",
        prevents="along an axis, slab arithmetic sees 0 * inf, a NaN, where the origin lies in a box's face",
        changes=(("if wp.abs(d) < SMALLEST_DIRECTION:", "if False:"),),
        tests=(EXTREMES + "test_inverses_are_finite",),
    ),
    Guard(
        name="triangles seen from their side",
        file="kernels/rays/triangle.py",
        prevents="weights of a triangle that the ray lies in are those of any of its points",
        changes=(("EDGE_ON = wp.constant(2.0**-28)", "EDGE_ON = wp.constant(0.0)"),),
        tests=(FUZZ + "test_nearest_and_any_hits",),
    ),
    Guard(
        name="no division by an area of zero",
        file="kernels/rays/triangle.py",
        prevents="a needle seen from its side gives NaN for a distance",
        changes=(("if not (wp.abs(det) > zero):", "if False:"),),
        tests=(FUZZ + "test_nearest_and_any_hits",),
    ),
    Guard(
        name="hits begin above zero",
        file="kernels/rays/triangle.py",
        prevents="a ray hits the surface that it starts on",
        changes=(("if not (t > 0.0 and t < NO_HIT):", "if not (t >= 0.0 and t < NO_HIT):"),),
        tests=(TRAVERSAL + "test_origin_on_a_triangle_does_not_hit_it",),
    ),
    Guard(
        name="segments end before their end",
        file="kernels/rays/bvh.py",
        prevents="a lamp shadows itself",
        changes=(("if hit[0] < t_max and hit[0] < NO_HIT:", "if hit[0] <= t_max and hit[0] < NO_HIT:"),),
        tests=(FUZZ + "test_nearest_and_any_hits",),
    ),
    Guard(
        name="a bound to the tree's depth",
        file="kernels/rays/bvh_build.py",
        prevents="a geometric series of sizes overflows the traversal's stack",
        changes=(("halving = depth + levels_by_halving(task[1] - task[0]) >= MAX_DEPTH", "halving = False"),),
        tests=(TRAVERSAL + "test_geometric_series_of_sizes_stays_within_the_stack",),
    ),
    Guard(
        name="splits of what has one centre",
        file="kernels/rays/bvh_build.py",
        prevents="a thousand triangles in one place are split for ever",
        changes=(
            (
                "        return halve(begin, end)  # all centroids in one point, or areas beyond float32\n",
                "        return end\n",
            ),
        ),
        tests=(TRAVERSAL + "test_a_hundred_thousand_triangles_in_one_place",),
    ),
    Guard(
        name="triangles that are no numbers",
        file="kernels/rays/build_tree.py",
        prevents="a NaN in a box hides all that is in it",
        changes=(("if count and not (np.isfinite(positions.min()) and np.isfinite(positions.max())):", "if False:"),),
        tests=(TRAVERSAL + "test_bad_arguments",),
    ),
)
