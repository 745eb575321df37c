"""Guards of scenes: scenes/*.py."""

from __future__ import annotations

from guard import Guard, hard

GEOMETRY = "tests/scenes/test_scene_geometry.py::"
FILES = "tests/scenes/test_scene_mesh_files.py::"

GUARDS = (
    Guard(
        name="scenes are moved to the origin, in double",
        file="scenes/flat/renderer_space.py",
        prevents="a scene far from the origin has the digits that float32 has left there",
        changes=(
            (
                "moved: Array = (np.asarray(points, np.float64) - self.center)",
                "moved: Array = np.asarray(points, np.float64)",
            ),
        ),
        tests=(GEOMETRY + "test_flat_scene_does_not_depend_on_where_the_scene_lies",),
    ),
    Guard(
        name="scenes are as large as float32 likes",
        file="scenes/flat/renderer_space.py",
        prevents="in other units corners are other floats, and squares leave float32's range",
        changes=(
            (
                "return RendererSpace((low + high) / 2.0, half if half > 0 else 1.0)",
                "return RendererSpace((low + high) / 2.0, 1.0)",
            ),
        ),
        tests=(
            hard("as large as an orbit"),
            hard("cornell box: in other units"),
        ),
    ),
    Guard(
        name="places next to zero are zero",
        file="scenes/flat/renderer_space.py",
        prevents="the sign of a rounding is another in other units",
        changes=(("        moved[np.abs(moved) <= NOTHING] = 0.0\n", ""),),
        tests=("tests/scenes/flat/test_renderer_space.py::test_the_rounding_of_a_difference_is_nothing",),
    ),
    Guard(
        name="triangles that cannot be rendered are dropped",
        file="scenes/flat/dropped.py",
        prevents="NaN for normals and boxes",
        changes=(("    cause = degenerate_cause(positions)", "    cause = np.zeros(len(positions), dtype=np.int8)"),),
        tests=(GEOMETRY + "test_degenerate_triangles_are_dropped_and_counted",),
    ),
    Guard(
        name="duplicates are dropped",
        file="scenes/flat/dropped.py",
        prevents="surface that nobody sees counts as area, so what lies before it is too dark",
        changes=(("cause[(cause == KEPT) & repeated(positions) & ~glows] = DUPLICATE", "pass"),),
        tests=(hard("instanced duplicates"),),
    ),
    Guard(
        name="faces name vertices that are there",
        file="scenes/flat/flatten.py",
        prevents="a traceback, or another vertex counted from the end",
        changes=(
            (
                "    if count and not (mesh.faces.min() >= 0 and mesh.faces.max() < len(mesh.vertices)):\n",
                "    if False:\n",
            ),
        ),
        tests=(hard("an index out of range"),),
    ),
    Guard(
        name="factors that can be meant",
        file="scenes/flat/flatten.py",
        prevents="light that grows at every bounce, beyond all numbers",
        changes=(("and not max(value) <= MOST_FACTOR:", "and False:"),),
        tests=(hard("reflectance of 1e30"),),
    ),
    Guard(
        name="a normal that is missing is not interpolated",
        file="scenes/flat/flatten.py",
        prevents="shading normals that shrink towards a corner",
        changes=(("        block[~(of_corner[:, 0] & of_corner[:, 1] & of_corner[:, 2])] = 0.0\n", "        pass\n"),),
        tests=(FILES + "test_obj_corner_without_normal_makes_its_triangle_flat",),
    ),
    Guard(
        name="areas in double",
        file="scenes/flat/areas.py",
        prevents="lamps of needles have no area, or none that can be trusted",
        changes=(("vertex].T.astype(np.float64) for", "vertex].T for"),),
        tests=("tests/scenes/flat/test_areas.py::test_areas_of_needles",),
    ),
    Guard(
        name="no entities in XML",
        file="scenes/mitsuba/document.py",
        prevents="a file of a kilobyte that unfolds to gigabytes",
        changes=(("        self.parser.StartDoctypeDeclHandler = self._doctype\n", ""),),
        tests=("tests/scenes/test_scene_mitsuba_xml.py::test_entities_are_refused",),
    ),
)
