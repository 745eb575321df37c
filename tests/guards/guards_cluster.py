"""Guards of cells and clusters: kernels/rays/cells.py, overlap.py, cluster/*.py."""

from __future__ import annotations

from guard import Guard, hard

EXACT = "tests/property/test_exactness.py::"
TREE = "tests/kernels/rays/test_top_tree.py::"
PARTITION = "tests/cluster/plan/test_partition.py::"
FUZZ = "tests/fuzz/test_fuzz_traversal.py::"
MASTER = "tests/cluster/master/test_master.py::"
SLAVE = "tests/cluster/slave/test_slave.py::"
WIRE = "tests/cluster/messages/test_wire.py::"

GUARDS = (
    Guard(
        name="half-open cells",
        file="kernels/rays/cells.py",
        prevents="a point in a plane lies in another cell than the one that the plan counts it in",
        changes=(
            ("if point[cells.axis[node]] < cells.split[node]:", "if point[cells.axis[node]] <= cells.split[node]:"),
        ),
        tests=(TREE + "test_every_point_lies_in_one_cell",),
    ),
    Guard(
        name="cells entered at one distance go by number",
        file="kernels/rays/cells.py",
        prevents="of cells that a ray enters together, all but one are left out",
        changes=(("(~earlier) | (equal & above)", "~earlier"),),
        tests=(FUZZ + "test_no_cell_is_missed",),
    ),
    Guard(
        name="routing boxes grown by pad",
        file="kernels/rays/cells.py",
        prevents="a ray in a plane misses the cell that owns its hit",
        changes=(
            (
                "low - np.float32(pad), high + np.float32(pad)",
                "low - np.float32(0.0 * pad), high + np.float32(0.0 * pad)",
            ),
        ),
        tests=(FUZZ + "test_no_cell_is_missed",),
    ),
    Guard(
        name="boxes of outlines grown by pad",
        file="kernels/rays/outlines.py",
        prevents="a ray passes by a cell in which a rounding hides what it hits",
        changes=(
            (
                "low - np.float32(pad), high + np.float32(pad)",
                "low - np.float32(0.0 * pad), high + np.float32(0.0 * pad)",
            ),
        ),
        tests=(FUZZ + "test_no_cell_is_missed",),
    ),
    Guard(
        name="outlines cut two pads outside of cells",
        file="kernels/rays/outline_build.py",
        prevents="a hit near a plane between two cells lies in no box of the cell that owns it",
        changes=(("grow = 2.0 * PAD_SHARE * extent", "grow = -2.0 * PAD_SHARE * extent"),),
        tests=(FUZZ + "test_no_cell_is_missed",),
    ),
    Guard(
        name="slabs of planes where their triangles are",
        file="kernels/rays/outline_build.py",
        prevents="a shadow ray that begins or ends a rounding off a surface passes by what blocks it there",
        changes=(("along.min() - grow, along.max() + grow", "along.min() + 99.0 * grow, along.max() + 99.0 * grow"),),
        tests=(FUZZ + "test_no_cell_is_missed",),
    ),
    Guard(
        name="cells hold what lies two pads outside",
        file="cluster/plan/partition.py",
        prevents="a ray that a rounding let into a cell does not find there what it can hit",
        changes=(
            (
                "grow = 2.0 * PAD_SHARE * extent + band\n    reach",
                "grow = 0.0 * PAD_SHARE * extent\n    reach",
            ),
        ),
        tests=("tests/cluster/plan/test_partition_extremes.py::test_the_cell_of_a_rounded_hit_holds_its_triangle",),
    ),
    Guard(
        name="boxes of cells near enough for the test's arithmetic",
        file="cluster/plan/partition.py",
        prevents="centres of boxes as large as 1e37 have no digits left for a triangle",
        changes=(("reach = 4.0 * extent", "reach = 1e300 * extent"),),
        tests=(PARTITION + "test_a_small_triangle_is_held_by_few_cells",),
    ),
    Guard(
        name="touching is overlapping",
        file="kernels/rays/overlap.py",
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
        file="kernels/photons/paths.py",
        prevents="photons near a plane are stored where no gather of their cell finds them",
        changes=(("elif leg.owner != own_cell:", "elif leg.owner < -1:"),),
        tests=(hard("planes through everything"),),
    ),
    Guard(
        name="bands of the largest radius",
        file="cluster/work/photon_store.py",
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
        file="cluster/work/photon_store.py",
        prevents="a photon that lies a rounding beyond the band is missed",
        changes=(("plan.band + replica.pad if", "plan.band if"),),
        tests=(EXACT + "test_ghosts_are_just_the_photons_of_the_band",),
    ),
    Guard(
        name="gathers that leave the band are counted",
        file="cluster/work/photon_gathers.py",
        prevents="an image that is not exact says that it is",
        changes=(("if plan.band < plan.radius:", "if False:"),),
        tests=(EXACT + "test_a_narrow_band_is_told_and_a_full_one_never_left",),
    ),
    Guard(
        name="orders of trees that others sorted leave nothing out",
        file="cluster/work/tree_orders.py",
        prevents="photons are missing, or a kernel reads outside of its arrays",
        changes=(("        if not found.all():", "        if False:"),),
        tests=("tests/cluster/work/test_tree_orders.py::test_an_order_that_is_none_is_refused",),
    ),
    Guard(
        name="the pilot's photons in the order of their numbers",
        file="cluster/plan/photon_pilot.py",
        prevents="threads decide the gather radius, and how photons are shared out",
        changes=(
            (
                'order = np.argsort(photons["id"])\n    return {name: column[order]',
                'order = np.arange(len(photons["id"]))\n    return {name: column[order]',
            ),
        ),
        tests=(EXACT + "test_photons_that_wait_for_room_change_no_bit",),
    ),
    Guard(
        name="parts of a sample in the order of their places",
        file="cluster/work/bucket_home.py",
        prevents="the order of arrival changes the last bits of a pixel",
        changes=(
            (
                'order = in_order(together["slot"], together["place"])',
                'order = np.argsort(together["slot"], kind="stable")',
            ),
        ),
        tests=("tests/rendering/test_sums_in_order.py::test_parts_are_added_in_the_order_of_their_places",),
    ),
    Guard(
        name="sums go on where the last wave ended",
        file="kernels/camera/add_samples.py",
        prevents="how many samples are under way at once decides the order of additions",
        changes=(
            ("    sum_direct = sums_out.direct[pixel]\n", "    sum_direct = wp.vec3d()\n"),
            (
                "    sums_out.direct[pixel] = sum_direct\n",
                "    sums_out.direct[pixel] = sums_out.direct[pixel] + sum_direct\n",
            ),
        ),
        tests=("tests/rendering/test_sums_in_order.py::test_sums_go_on_where_the_last_wave_ended",),
    ),
    Guard(
        name="merged hits by (distance, number)",
        file="cluster/work/bucket_home.py",
        prevents="of surfaces in one place, the cell that answers first decides",
        changes=((' | ((found["t"] == t) & (found["prim"] < prim))', ""),),
        tests=(
            "tests/cluster/work/test_merged_hits.py::"
            "test_the_nearest_hit_counts_and_of_equally_near_ones_the_least_triangle",
        ),
    ),
    Guard(
        name="credit for all that follows",
        file="cluster/work/bucket_home.py",
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
        file="cluster/master/tasks.py",
        prevents="a broken cluster goes unnoticed",
        changes=(("        if not same:\n            raise", "        if False:\n            raise"),),
        tests=(MASTER + "test_two_different_results_end_the_render",),
    ),
    Guard(
        name="messages of another epoch are dropped",
        file="cluster/master/machine.py",
        prevents="a result of the scene before gets into this one's image",
        changes=(("if message.epoch != self._phases.epoch_of(member):", "if self._phases.epoch_of(member) < 0:"),),
        tests=(MASTER + "test_a_message_of_another_epoch_is_dropped",),
    ),
    Guard(
        name="one version of everything in a cluster",
        file="cluster/master/members.py",
        prevents="slaves of another Warp round otherwise",
        changes=(("        if differing:\n", "        if False:\n"),),
        tests=(MASTER + "test_versions_that_differ_are_named",),
    ),
    Guard(
        name="batches have the arrays of their kind",
        file="cluster/batch.py",
        prevents="a kernel reads past the end of an array",
        changes=(("if array.dtype != dtype or array.shape != (count, *shape):", "if False:"),),
        tests=(WIRE + "test_what_does_not_hold_together_is_refused",),
    ),
    Guard(
        name="indices from the network are within their tables",
        file="cluster/messages/demands.py",
        prevents="a kernel reads outside of a table",
        changes=(("array.item(array.argmin()) >= least and array.item(array.argmax()) < end", "True"),),
        tests=(
            SLAVE + "test_an_index_that_points_outside_is_an_error",
            WIRE + "test_what_does_not_hold_together_is_refused",
        ),
    ),
    Guard(
        name="multiplications and additions stay apart",
        file="kernels/photons/gather.py",
        prevents="the compiler rounds a * b + c once in one kernel and twice in another",
        changes=(
            (
                'wp.set_module_options({"enable_backward": False, "fuse_fp": False})',
                'wp.set_module_options({"enable_backward": False})',
            ),
        ),
        tests=("tests/house/test_kernel_options.py::test_no_contraction_and_no_backward_pass",),
    ),
    Guard(
        name="every worker gets a cell",
        file="cluster/master/cell_holders.py",
        prevents="a slave without work, which the others wait for",
        changes=(
            ("worker = int(empty[0]) if len(empty) else int(np.argmin(load))", "worker = int(np.argmin(load[::-1]))"),
        ),
        tests=(PARTITION + "test_cells_without_any_burden_are_dealt_too",),
    ),
    Guard(
        name="a result is that of a task",
        file="cluster/master/tasks.py",
        prevents="pixels of nobody's task get into the image",
        changes=(
            ('raise ProtocolError(f"a result came for task {result.number}, which it was not handed")', "same = True"),
        ),
        tests=(MASTER + "test_a_result_of_an_unknown_task_ends_the_render",),
    ),
)
