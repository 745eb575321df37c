"""Guards of cells and clusters: kernels/cells.py, overlap.py, cluster/*.py."""

from __future__ import annotations

from guard import Guard

EXACT = "tests/property/test_exactness.py::"
EFFECTS = "tests/property/test_exactness_effects.py::"
TREE = "tests/property/test_top_tree.py::"
PARTITION = "tests/property/test_partition.py::"
FUZZ = "tests/fuzz/test_fuzz_traversal.py::"
MASTER = "tests/cluster/test_master.py::"
SLAVE = "tests/cluster/test_slave.py::"
WIRE = "tests/cluster/test_wire.py::"

GUARDS = (
    Guard(
        name="half-open cells",
        file="kernels/cells.py",
        prevents="a point in a plane lies in another cell than the one that the plan counts it in",
        changes=(
            ("if point[cells.axis[node]] < cells.split[node]:", "if point[cells.axis[node]] <= cells.split[node]:"),
        ),
        tests=(TREE + "test_every_point_lies_in_one_cell",),
    ),
    Guard(
        name="cells entered at one distance go by number",
        file="kernels/cells.py",
        prevents="of cells that a ray enters together, all but one are left out",
        changes=((" or (e == after and cell > current)", ""),),
        tests=(FUZZ + "test_no_cell_is_missed",),
    ),
    Guard(
        name="routing boxes grown by pad",
        file="kernels/cells.py",
        prevents="a ray in a plane misses the cell that owns its hit",
        changes=(
            ("cells.low = wp.array(low - np.float32(pad)", "cells.low = wp.array(low - np.float32(0.0 * pad)"),
            ("cells.high = wp.array(high + np.float32(pad)", "cells.high = wp.array(high + np.float32(0.0 * pad)"),
        ),
        tests=(FUZZ + "test_no_cell_is_missed",),
    ),
    Guard(
        name="cells hold what lies two pads outside",
        file="cluster/partition.py",
        prevents="a ray that a rounding let into a cell does not find there what it can hit",
        changes=(("grow = 2.0 * PAD_SHARE * extent", "grow = 0.0 * PAD_SHARE * extent"),),
        tests=(
            PARTITION + "test_the_cell_of_every_point_of_a_triangle_holds_it",
            FUZZ + "test_no_cell_is_missed",
        ),
    ),
    Guard(
        name="outer faces of cells are finite",
        file="kernels/cells.py",
        prevents="inf * 0 in slab arithmetic",
        changes=(("FAR_AWAY = 3.0e37", "FAR_AWAY = np.inf"),),
        tests=(
            TREE + "test_rays_visit_every_cell_that_may_hold_their_hit",
            FUZZ + "test_no_cell_is_missed",
        ),
    ),
    Guard(
        name="boxes of cells near enough for the test's arithmetic",
        file="cluster/partition.py",
        prevents="centres of boxes as large as 1e37 have no digits left for a triangle",
        changes=(("reach = 4.0 * extent", "reach = 1e300 * extent"),),
        tests=(
            PARTITION + "test_the_cell_of_every_point_of_a_triangle_holds_it",
            PARTITION + "test_a_small_triangle_is_held_by_few_cells",
        ),
    ),
    Guard(
        name="far faces of cells a few roundings further",
        file="kernels/cells.py",
        prevents="a ray along a plane leaves a cell before it enters it",
        changes=(
            (
                "leave = wp.min(far[0], wp.min(far[1], far[2])) * EXIT_SCALE",
                "leave = wp.min(far[0], wp.min(far[1], far[2]))",
            ),
        ),
        tests=(FUZZ + "test_no_cell_is_missed", TREE + "test_rays_visit_every_cell_that_may_hold_their_hit"),
    ),
    Guard(
        name="touching is overlapping",
        file="kernels/overlap.py",
        prevents="a triangle in a plane between two cells is in neither",
        changes=(
            (
                "wp.min(a[i], wp.min(b[i], c[i])) > half[i] or wp.max(a[i], wp.max(b[i], c[i])) < -half[i]",
                "wp.min(a[i], wp.min(b[i], c[i])) >= half[i] or wp.max(a[i], wp.max(b[i], c[i])) <= -half[i]",
            ),
        ),
        tests=(PARTITION + "test_touching_counts_as_overlap",),
    ),
    Guard(
        name="hits are shaded by the cell that owns them",
        file="kernels/photon_paths.py",
        prevents="photons near a plane are stored where no gather of their cell finds them",
        changes=(("elif owner != own_cell:", "elif owner < -1:"),),
        tests=(EXACT + "test_photons_are_the_same_set_each_with_one_owner",),
    ),
    Guard(
        name="bands of the largest radius",
        file="cluster/photon_store.py",
        prevents="gathers near a plane lack photons of the other side",
        changes=(
            (
                "bands = [plan.band + replica.pad if plan.paths else 0.0 for plan in world.maps]",
                "bands = [0.9 * plan.band if plan.paths else 0.0 for plan in world.maps]",
            ),
        ),
        tests=(EXACT + "test_ghosts_are_just_the_photons_of_the_band",),
    ),
    Guard(
        name="bands grown by pad",
        file="cluster/photon_store.py",
        prevents="a photon that lies a rounding beyond the band is missed",
        changes=(("plan.band + replica.pad if", "plan.band if"),),
        tests=(EXACT + "test_ghosts_are_just_the_photons_of_the_band",),
    ),
    Guard(
        name="gathers that leave the band are counted",
        file="cluster/gathering.py",
        prevents="an image that is not exact says that it is",
        changes=(("if plan.band < plan.radius:", "if False:"),),
        tests=(EXACT + "test_a_narrow_band_is_told_and_a_full_one_never_left",),
    ),
    Guard(
        name="the pilot's photons in the order of their numbers",
        file="cluster/plan.py",
        prevents="threads decide the gather radius, and how photons are shared out",
        changes=(
            (
                'order = np.argsort(photons["id"])\n    return {name: column[order]',
                'order = np.arange(len(photons["id"]))\n    return {name: column[order]',
            ),
        ),
        tests=(EXACT + "test_threads_change_no_bit",),
    ),
    Guard(
        name="parts of a sample in the order of their places",
        file="cluster/home.py",
        prevents="the order of arrival changes the last bits of a pixel",
        changes=(
            (
                'order = np.lexsort((together["place"], together["slot"]))',
                'order = np.argsort(together["slot"], kind="stable")',
            ),
        ),
        tests=(EFFECTS + "test_partition_threads_buckets_and_order_change_no_bit",),
    ),
    Guard(
        name="samples are added up before pixels",
        file="kernels/resolve.py",
        prevents="where one wave of samples ends decides the order of additions",
        changes=(
            (
                "        i = pixel * samples + s\n        direct = wp.vec3d()\n",
                "        i = pixel * samples + s\n        direct = sum_direct\n        sum_direct = wp.vec3d()\n",
            ),
            (
                "            direct = wp.vec3d(slots.emission[i]) + lit * share",
                "            direct = direct + wp.vec3d(slots.emission[i]) + lit * share",
            ),
        ),
        tests=(EFFECTS + "test_small_waves_and_full_photon_regions_change_no_bit",),
    ),
    Guard(
        name="merged hits by (distance, number)",
        file="cluster/home.py",
        prevents="of surfaces in one place, the cell that answers first decides",
        changes=((' | ((found["t"] == t) & (found["prim"] < prim))', ""),),
        tests=(EXACT + "test_random_scenes_have_the_same_bits_in_any_partition",),
    ),
    Guard(
        name="credit for all that follows",
        file="cluster/home.py",
        prevents="a bucket is finished while light is still on its way to it",
        changes=(
            (
                "        self._credit -= batch.credit\n        if self._credit == 0:\n            if self._probing:",
                "        self._credit = 0\n        if self._credit == 0:\n            if self._probing:",
            ),
        ),
        tests=(EXACT + "test_order_of_delivery_changes_no_bit",),
    ),
    Guard(
        name="a repeated result has the same bits",
        file="cluster/master.py",
        prevents="a broken cluster goes unnoticed",
        changes=(("        if not same:\n            raise", "        if False:\n            raise"),),
        tests=(MASTER + "test_two_different_results_end_the_render",),
    ),
    Guard(
        name="messages of another epoch are dropped",
        file="cluster/master.py",
        prevents="a result of the scene before gets into this one's image",
        changes=(("if message.epoch != self._epoch:", "if False:"),),
        tests=(MASTER + "test_a_message_of_another_epoch_is_dropped",),
    ),
    Guard(
        name="one version of everything in a cluster",
        file="cluster/master.py",
        prevents="slaves of another Warp round otherwise",
        changes=(("        if differing:\n", "        if False:\n"),),
        tests=(MASTER + "test_versions_that_differ_are_named",),
    ),
    Guard(
        name="batches have the arrays of their kind",
        file="cluster/batch.py",
        prevents="a kernel reads past the end of an array",
        changes=(("if array.dtype != np.dtype(dtype) or array.shape != (count, *shape):", "if False:"),),
        tests=(
            WIRE + "test_a_right_header_with_wrong_fields_is_a_protocol_error",
            WIRE + "test_the_reason_is_told",
        ),
    ),
    Guard(
        name="indices from the network are within their tables",
        file="cluster/checks.py",
        prevents="a kernel reads outside of a table",
        changes=(("    if len(array) and not (array.min() >= least and array.max() < end):\n", "    if False:\n"),),
        tests=(
            SLAVE + "test_an_index_that_points_outside_is_an_error",
            WIRE + "test_what_does_not_hold_together_is_refused",
        ),
    ),
    Guard(
        name="multiplications and additions stay apart",
        file="kernels/gather.py",
        prevents="the compiler rounds a * b + c once in one kernel and twice in another",
        changes=(
            (
                'wp.set_module_options({"enable_backward": False, "fuse_fp": False})',
                'wp.set_module_options({"enable_backward": False})',
            ),
        ),
        tests=("tests/test_kernel_options.py::test_no_contraction_and_no_backward_pass",),
    ),
)
