"""Guards of photon maps and gathers: gather.py, photon_map.py, exact_sum.py, surface_points.py, beam.py."""

from __future__ import annotations

from guard import Guard, hard

GATHER = "tests/kernels/photons/test_gather.py::"
FUZZ = "tests/fuzz/test_fuzz_gather.py::"
EXTREMES = "tests/kernels/photons/test_gather_extremes.py::"
BEAM = "tests/kernels/photons/test_beam.py::"
AREA = "tests/kernels/photons/test_surface_area.py::"

GUARDS = (
    Guard(
        name="ties by photon number",
        file="kernels/photons/gather.py",
        prevents="of photons at one distance, the order of the map decides which count",
        changes=(("before = rank[key_place(a)] < rank[key_place(b)]", "before = key_place(a) < key_place(b)"),),
        tests=(FUZZ + "test_the_k_nearest_photons",),
    ),
    Guard(
        name="filters before the count",
        file="kernels/photons/gather.py",
        prevents="photons of another surface take places among the k nearest, and those of the surface are left out",
        changes=(
            (
                "passes = wp.min(vec8(radius2_above) - distance2, facing - vec8(_NORMAL_COS))",
                "passes = wp.min(vec8(radius2_above) - distance2, facing + vec8(9.0))",
            ),
            (
                "        flux = flux * _weight(s - n, m, d)\n    return flux",
                "        flux = flux * _weight(s - n, m, d)\n    at = LEAF_ROWS * (place >> 3)\n    lane = place & 7\n"
                "    facing = photons.leaves[at + 3][lane] * n[0] + photons.leaves[at + 4][lane] * n[1]\n"
                "    facing = facing + photons.leaves[at + 5][lane] * n[2]\n"
                "    if facing <= _NORMAL_COS:\n        flux = wp.vec3(0.0)\n    return flux",
            ),
        ),
        tests=(FUZZ + "test_the_k_nearest_photons", GATHER + "test_photons_of_another_surface_do_not_count"),
    ),
    Guard(
        name="normals alike",
        file="kernels/photons/gather.py",
        prevents="light leaks around edges and through thin walls",
        changes=(("distance2, facing - vec8(_NORMAL_COS))", "distance2, facing + vec8(2.0))"),),
        tests=(hard("walls thinner than the gather radius"),),
    ),
    Guard(
        name="a disc, not a ball",
        file="kernels/photons/gather.py",
        prevents="photons of a parallel surface nearby count",
        changes=(
            (
                "return euclid2 + _FLATTENING * wp.cw_mul(height, height)",
                "return euclid2 + 0.0 * wp.cw_mul(height, height)",
            ),
        ),
        tests=(GATHER + "test_photons_off_the_tangent_plane_count_as_further_away",),
    ),
    Guard(
        name="a radius that includes its photon",
        file="kernels/photons/gather.py",
        prevents="photons exactly as far as the radius are lost, or found, by the order of the search",
        changes=(("return wp.cast(wp.cast(value, wp.uint32) + wp.uint32(1), wp.float32)", "return value"),),
        tests=(EXTREMES + "test_photons_just_as_far_as_the_radius_count",),
    ),
    Guard(
        name="guesses grow",
        file="kernels/photons/gather.py",
        prevents="the gather before decides how many photons this one finds",
        changes=(("searching = count <= k and radius < r_max", "searching = False"),),
        tests=(GATHER + "test_runs_and_chunks_do_not_matter", FUZZ + "test_the_k_nearest_photons"),
    ),
    Guard(
        name="full buffers are halved",
        file="kernels/photons/gather.py",
        prevents="candidates are written past the end of the buffer, over others",
        changes=(("if count > CANDIDATE_CAPACITY - 8:", "if count > 4 * CANDIDATE_CAPACITY:"),),
        tests=(FUZZ + "test_a_full_buffer_loses_no_photon",),
    ),
    Guard(
        name="full lists of leaves are searched",
        file="kernels/photons/gather.py",
        prevents="leaves are written past the end of their list",
        changes=(("while stacked > 0 and leaf_count <= LEAF_CAPACITY - 8:", "while stacked > 0:"),),
        tests=(
            FUZZ + "test_the_k_nearest_photons",
            FUZZ + "test_a_full_buffer_loses_no_photon",
            hard("k above the map"),
        ),
    ),
    Guard(
        name="the boxes' distance is never above the photons'",
        file="kernels/photons/gather.py",
        prevents="a box is pruned that holds a photon within reach",
        changes=(
            (
                "    return wp.cw_mul(dx, dx) + wp.cw_mul(dy, dy) + wp.cw_mul(dz, dz)\n",
                "    return (wp.cw_mul(dz, dz) + wp.cw_mul(dy, dy)) + wp.cw_mul(dx, dx)\n",
            ),
        ),
        tests=(EXTREMES + "test_a_box_without_extent_is_as_far_as_its_photon",),
    ),
    Guard(
        name="the radius is that of the photon after the k",
        file="kernels/photons/gather.py",
        prevents="estimates are k / (k - 1) too bright; with k = 1 they have no mean",
        changes=(
            ("nearest2 = key_distance2(candidates[k])", "nearest2 = key_distance2(candidates[wp.max(k - 1, 0)])"),
        ),
        tests=(GATHER + "test_estimate_is_unbiased", hard("k = 1")),
    ),
    Guard(
        name="photons in one place",
        file="kernels/photons/gather.py",
        prevents="flux over an area of zero is infinite",
        changes=(("if nearest2 >= least2:", "if nearest2 >= 0.0:"),),
        tests=(FUZZ + "test_the_k_nearest_photons", hard("all photons in one place")),
    ),
    Guard(
        name="bounds to the normals' weight",
        file="kernels/constants.py",
        prevents="at grazing arrival single photons outshine all others",
        changes=(("ADJOINT_BOUND = wp.constant(4.0)", "ADJOINT_BOUND = wp.constant(1.0e30)"),),
        tests=(EXTREMES + "test_no_normal_weighs_a_photon_up_without_bound",),
    ),
    Guard(
        name="sums of integers",
        file="kernels/maths/exact_sum.py",
        prevents="the order of the photons changes the last bits of their sum",
        changes=(
            (
                "wp.int64(wp.rint(wp.float64(term) * power_of_two(_BITS - e)))",
                "wp.int64(wp.rint(wp.float64(term) * power_of_two(62 - e)))",
            ),
            ("return wp.float64(quanta) * power_of_two(e - _BITS)", "return wp.float64(quanta) * power_of_two(e - 62)"),
        ),
        tests=(GATHER + "test_exact_sum_is_within_its_bound",),
    ),
    Guard(
        name="a quantum that is a power of two",
        file="kernels/maths/exact_sum.py",
        prevents="terms round before they are integers, so scenes in other units have other bits",
        changes=(
            (
                "return wp.cast(wp.uint64(e + 1023) << wp.uint64(52), wp.float64)",
                "return wp.cast(wp.uint64(e + 1023) << wp.uint64(52), wp.float64) * wp.float64(1.1)",
            ),
        ),
        tests=(GATHER + "test_exact_sum_is_within_its_bound", FUZZ + "test_the_k_nearest_photons"),
    ),
    Guard(
        name="splits without equals",
        file="kernels/photons/kd_order.py",
        prevents="photons in one place make the map take for ever",
        changes=(
            (
                " | (wp.int32(coordinate == pivot) & wp.int32(r.index < pivot_index))",
                "",
            ),
        ),
        tests=(EXTREMES + "test_millions_of_photons_in_one_place_are_split_like_any_others",),
    ),
    Guard(
        name="photons that are no numbers",
        file="kernels/photons/photon_map.py",
        prevents="a NaN spoils every gather that comes near",
        changes=(("if not np.isfinite(together):", "if False:"),),
        tests=(GATHER + "test_bad_photons_are_errors",),
    ),
    Guard(
        name="coordinates whose squares are finite",
        file="kernels/photons/photon_map.py",
        prevents="infinite distances, which are all alike",
        changes=(("if largest > MAX_PHOTON_COORDINATE:", "if False:"),),
        tests=(GATHER + "test_bad_photons_are_errors",),
    ),
    Guard(
        name="photon numbers once",
        file="kernels/photons/photon_map.py",
        prevents="ties that nothing decides",
        changes=(("    if len(same):", "    if False:"),),
        tests=(GATHER + "test_bad_photons_are_errors",),
    ),
    Guard(
        name="radii whose squares float32 holds",
        file="kernels/photons/gather_settings.py",
        prevents="an area of zero, or of infinity",
        changes=(("if not MIN_GATHER_RADIUS <= r_max <= MAX_GATHER_RADIUS:", "if False:"),),
        tests=(GATHER + "test_bad_settings_are_errors",),
    ),
    Guard(
        name="no surface is counted as none",
        file="kernels/photons/surface_points.py",
        prevents="a gather without a surface point is black",
        changes=(("wp.float32(wp.max(found, 1))", "wp.float32(found)"),),
        tests=(AREA + "test_a_tiny_gather_is_measured_by_a_larger_disc",),
    ),
    Guard(
        name="areas are counted by enough points",
        file="kernels/photons/surface_points.py",
        prevents="where photons lie denser than points, the area is noise",
        changes=(("return wp.max(radius, wp.min(wp.sqrt(LEAST_POINTS * point_area / _PI), r_max))", "return radius"),),
        tests=(AREA + "test_a_tiny_gather_is_measured_by_a_larger_disc",),
    ),
    Guard(
        name="surface counts by the gather's own filters",
        file="kernels/photons/surface_points.py",
        prevents="the far side of a wall counts as area of this side, which is then too dark",
        changes=(
            (
                "return wp.min(vec8(next_above(radius2)) - d2, facing - vec8(1.0 - _TURN * larger2))",
                "return vec8(next_above(radius2)) - d2 + 0.0 * facing",
            ),
        ),
        tests=(AREA + "test_edges_corners_and_strips_are_measured",),
    ),
    Guard(
        name="a beam's photon is counted by the cell of its foot",
        file="kernels/photons/beam.py",
        prevents="photons near a plane count once for each cell that has a copy",
        changes=(("if inside and cell_of(cells, point_at(origin, direction, near[0])) == own_cell:", "if inside:"),),
        tests=(BEAM + "test_parts_of_four_cells_add_up_to_the_whole",),
    ),
    Guard(
        name="a beam's distances in double",
        file="kernels/photons/beam.py",
        prevents="far from the origin the kernel over the disc is noise",
        changes=(
            (
                "    across = to - t * d\n    return wp.vec2d(t, wp.dot(across, across))",
                "    rounded = wp.vec3(to) - wp.float32(t) * direction\n"
                "    return wp.vec2d(t, wp.float64(wp.dot(rounded, rounded)))",
            ),
        ),
        tests=(BEAM + "test_equals_the_sum_over_all_photons",),
    ),
    Guard(
        name="boxes of beams are grown",
        file="kernels/photons/beam.py",
        prevents="a box is pruned that holds a photon within reach of the beam",
        changes=(("_BOX_PAD = wp.constant(2.0**-20)", "_BOX_PAD = wp.constant(0.0)"),),
        tests=(BEAM + "test_far_from_the_origin_nothing_is_lost",),
    ),
    Guard(
        name="eight photons at once are rejected with a margin",
        file="kernels/photons/beam.py",
        prevents="float32 rejects photons that double finds within reach",
        changes=(("_LEAF_PAD = wp.constant(2.0**-18)", "_LEAF_PAD = wp.constant(0.0)"),),
        tests=("tests/kernels/photons/test_beam_extremes.py::test_every_photon_within_reach_is_found",),
    ),
    Guard(
        name="beams' sums have one unit",
        file="kernels/photons/beam.py",
        prevents="a contribution too large for the sum wraps around to a negative one",
        changes=(("wp.clamp(x / unit, -_LARGEST_QUANTA, _LARGEST_QUANTA)", "x / unit"),),
        tests=(BEAM + "test_contributions_too_large_for_the_unit_are_told",),
    ),
)
