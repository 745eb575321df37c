"""Guards of photons, surfaces, materials and media: kernels/photons/paths.py, surface.py, bsdf*.py, medium.py, ..."""

from __future__ import annotations

from guard import Guard, hard

BSDF = "tests/kernels/materials/test_bsdf.py::"
MATERIALS = "tests/kernels/materials/test_materials.py::"
MEDIA = "tests/kernels/materials/test_media.py::"
LIGHTS = "tests/kernels/lights/test_lights.py::"
EMISSION = "tests/kernels/lights/test_emission.py::"
EXACT = "tests/property/test_exactness.py::"
ENDS = "tests/kernels/test_ends_of_ranges.py::"
SURFACE = "tests/kernels/materials/test_surface.py::"
SIDES = "tests/property/test_photon_sides.py::"
STRICT = "tests/rendering/test_strict.py::"
ELEMENTARY = "tests/kernels/maths/test_elementary.py::"
VOLUME = "tests/analytic/test_volume_light.py::"

GUARDS = (
    Guard(
        name="rays leave a surface at an offset",
        file="kernels/materials/surface.py",
        prevents="surfaces shadow themselves, and light gets to the other side",
        changes=(
            (
                "return position + normal * (OFFSET_SHARE * size + offset_min)",
                "return position + normal * (0.0 * size)",
            ),
        ),
        tests=("tests/analytic/test_white_furnace.py::test_a_sphere",),
    ),
    Guard(
        name="the offset follows the place",
        file="kernels/constants.py",
        prevents="away from the origin a hit is rounded to the far side of its surface",
        changes=(("OFFSET_SHARE = wp.constant(2.0**-22)", "OFFSET_SHARE = wp.constant(0.0)"),),
        tests=(SURFACE + "test_rays_leave_on_their_side",),
    ),
    Guard(
        name="the offset has a least length",
        file="kernels/constants.py",
        prevents="on surfaces through the scene's middle rays start on the surface",
        changes=(("OFFSET_MIN_SHARE = 2.0**-48", "OFFSET_MIN_SHARE = 0.0"),),
        tests=(SURFACE + "test_rays_leave_on_their_side",),
    ),
    Guard(
        name="hits are combined in double",
        file="kernels/rays/cell_triangles.py",
        prevents="a hit is further off its surface than the offset covers",
        changes=(
            (
                "return wp.vec3(wp.vec3d(p0) * a + wp.vec3d(p1) * b + wp.vec3d(p2) * c)",
                "return p0 * float(a) + p1 * u + p2 * v",
            ),
        ),
        tests=(SURFACE + "test_rays_leave_on_their_side",),
    ),
    Guard(
        name="normals in double",
        file="kernels/rays/instances.py",
        prevents="needles have normals of noise, or none",
        changes=(
            (
                "n = wp.vec3d(e[1] * f[2] - e[2] * f[1], e[2] * f[0] - e[0] * f[2], e[0] * f[1] - e[1] * f[0])",
                "n = wp.vec3d(wp.cross(b - a, c - a))",
            ),
        ),
        tests=(SURFACE + "test_normals_of_needles",),
    ),
    Guard(
        name="a shading normal on the seen side",
        file="kernels/materials/surface.py",
        prevents="interpolated normals make the front black, or lit from behind",
        changes=(
            (
                "        if (wp.dot(shading, towards) > 0.0) != front:\n            shading = front_normal",
                "        if False:\n            shading = front_normal",
            ),
        ),
        tests=(SURFACE + "test_shading_normals_are_on_the_seen_side",),
    ),
    Guard(
        name="a shading normal on the front's side",
        file="kernels/materials/surface.py",
        prevents="a blend of normals that cancels is no direction",
        changes=(("            if wp.dot(blend, front_normal) > 0.0:\n", "            if True:\n"),),
        tests=(SURFACE + "test_shading_normals_are_on_the_seen_side",),
    ),
    Guard(
        name="light from the side where both normals agree",
        file="kernels/camera/picked_light.py",
        prevents="direct light leaks through walls with interpolated normals; "
        "what lets light through is asked by its shading normal alone",
        changes=(("reflects = side > 0.0 and w_to[2] * seen_from > 0.0", "reflects = w_to[2] * seen_from > 0.0"),),
        tests=(hard("wild normals"), hard("leaning normals")),
    ),
    Guard(
        name="photons leave on the side that they are sent to",
        file="kernels/photons/paths.py",
        prevents="bent normals send photons through walls",
        changes=(("if wp.dot(a.leaves, a.goes_to) <= 0.0:", "if False:"),),
        tests=(SIDES + "test_a_flat_floor_does_not_light_itself",),
    ),
    Guard(
        name="no division by a grazing cosine of zero",
        file="kernels/photons/shading_normals.py",
        prevents="a photon along a surface becomes NaN",
        changes=(("if in_geometric <= 0.0 or out_shading <= 0.0:", "if False:"),),
        tests=(SIDES + "test_grazing_photons_have_finite_factors",),
    ),
    Guard(
        name="bumps that face away from a lamp stay dark",
        file="kernels/photons/paths.py",
        prevents="photons that graze bumps bring light that no path finds",
        changes=(("make_surface(features).surface_of_light", "make_surface(features).surface_at"),),
        tests=("tests/analytic/surfaces/test_light_off_bumps.py::test_what_bumps_throw_on_walls_is_what_paths_find",),
    ),
    Guard(
        name="neighbours that know nothing of a stratum's numbers",
        file="kernels/maths/sample_numbers.py",
        prevents="a record's bright strata draw fewer further rays than dark ones, which makes it too bright",
        changes=(
            ("item = hash_combine(item, wp.uint32(sample) & _BLOCK)", "item = item"),
            ("number = number >> wp.uint32(2)", "number = number"),
        ),
        tests=("tests/analytic/surfaces/test_light_through_sheets.py::test_what_lets_all_light_through_is_not_seen",),
    ),
    Guard(
        name="sheets are lit from their other side",
        file="kernels/irradiance/lit_places.py",
        prevents="gather rays and samples read irradiance on the side of a curtain that they see",
        changes=(("if s.through == 1:", "if s.through == 2:"),),
        tests=("tests/analytic/surfaces/test_light_through_sheets.py::test_a_curtained_room_is_what_paths_find",),
    ),
    Guard(
        name="collisions away from walls",
        file="kernels/constants.py",
        prevents="a collision within a rounding of a wall starts behind it",
        changes=(("COLLISION_MARGIN = wp.constant(2.0**28)", "COLLISION_MARGIN = wp.constant(0.0)"),),
        tests=(VOLUME + "test_no_photon_gets_through_a_wall_from_within_a_medium",),
    ),
    Guard(
        name="photons wait for room",
        file="kernels/photons/paths.py",
        prevents="photons are lost where a launch stores more than it has room for",
        changes=(("                        status = WAITS\n", "                        cut += wp.float64(0.0)\n"),),
        tests=(EXACT + "test_photons_that_wait_for_room_change_no_bit",),
    ),
    Guard(
        name="a limit to bounces",
        file="kernels/photons/paths.py",
        prevents="between perfect mirrors a photon never ends",
        changes=((" or p.bounce >= BOUNCE_LIMIT\n", " or p.bounce >= 2 * BOUNCE_LIMIT\n"),),
        tests=("tests/rendering/test_limits.py::test_a_photon_path_has_no_bounce_beyond_the_limit",),
    ),
    Guard(
        name="a limit to vertices",
        file="kernels/camera/vertices.py",
        prevents="between perfect mirrors a camera path has no end, and no credit left",
        changes=(("if p.bounce + 1 >= _CHAIN_LIMIT:", "if False:"),),
        tests=("tests/rendering/test_limits.py::test_a_camera_path_has_no_vertex_beyond_the_limit",),
    ),
    Guard(
        name="what is not finite is black, and counted",
        file="cluster/work/guards.py",
        prevents="one NaN spoils its pixel",
        changes=(("        blackened[bad] = 0.0\n", ""),),
        tests=("tests/hard_cases/test_nonfinite.py::test_an_overflow_is_counted_and_black",),
    ),
    Guard(
        name="photons that are not finite are dropped",
        file="cluster/work/photon_store.py",
        prevents="one photon spoils its neighbourhood",
        changes=(("if not there.all():", "if False:"),),
        tests=(STRICT + "test_guards_of_photons",),
    ),
    Guard(
        name="lamps too bright for photons are refused",
        file="wdpm/rendering/automatic_settings.py",
        prevents="a flux beyond single precision ends a render, and no word names the lamp",
        changes=(("lights.power.max() <= BRIGHTEST:", "True:"),),
        tests=("tests/hard_cases/test_nonfinite.py::test_a_lamp_whose_photons_would_overflow_is_named",),
    ),
    Guard(
        name="roughness that float32 holds",
        file="kernels/materials/microfacet.py",
        prevents="a roughness of 1e-8 has a density beyond float32",
        changes=(("return wp.vec2(wp.max(alpha[0], ALPHA_LEAST), wp.max(alpha[1], ALPHA_LEAST))", "return alpha"),),
        tests=(BSDF + "test_nothing_is_ever_infinite",),
    ),
    Guard(
        name="slopes of facets stay finite",
        file="kernels/materials/microfacet.py",
        prevents="random numbers next to 1 give infinite slopes",
        changes=(("_ERF_MOST = wp.constant(wp.float32(1 - 2.0**-23))", "_ERF_MOST = wp.constant(wp.float32(1.0))"),),
        tests=(ENDS + "test_facets_of_the_last_random_numbers",),
    ),
    Guard(
        name="a facet is never edge-on",
        file="kernels/materials/microfacet.py",
        prevents="a normal of length zero",
        changes=(("z = wp.max(height - down, 1.0e-7)", "z = height - down"),),
        tests=(ENDS + "test_facets_of_the_last_random_numbers",),
    ),
    Guard(
        name="total reflection refracts nothing",
        file="kernels/materials/dielectric.py",
        prevents="a random number of 1 goes where there is no direction",
        changes=(
            (
                "w_from[2], b.eta[0])\n    reflects = u_lobe < at.reflectance or at.cos_to == 0.0",
                "w_from[2], b.eta[0])\n    reflects = u_lobe < at.reflectance",
            ),
            (
                "c_from, b.eta[0])\n    reflects = u_lobe < at.reflectance or at.cos_to == 0.0",
                "c_from, b.eta[0])\n    reflects = u_lobe < at.reflectance",
            ),
        ),
        tests=(BSDF + "test_total_reflection_is_total",),
    ),
    Guard(
        name="an index of 1 does nothing",
        file="kernels/materials/fresnel.py",
        prevents="light grazes a boundary that is not there",
        changes=(
            ("    if eta == 1.0:\n        s.reflectance = 0.0\n        s.cos_to = -cos_from\n    elif c2", "    if c2"),
        ),
        tests=(BSDF + "test_matched_indices_do_nothing",),
    ),
    Guard(
        name="metals of index 0",
        file="kernels/materials/fresnel.py",
        prevents="0 / 0 for a mirror without a material",
        changes=(
            ("    if sum_1 + cross_1 > 0.0:\n", "    if True:\n"),
            ("    if sum_2 + cross_2 > 0.0:\n", "    if True:\n"),
        ),
        tests=(ENDS + "test_metals_without_index_or_at_grazing",),
    ),
    Guard(
        name="bent normals have a length",
        file="kernels/materials/frames.py",
        prevents="a normal map of (0, 0, 0) is NaN",
        changes=(("    if not (length > 1.0e-12 and length < 1.0e30):\n", "    if False:\n"),),
        tests=(ENDS + "test_normals_of_any_length",),
    ),
    Guard(
        name="tangents only where they are seen across the normal",
        file="kernels/materials/frames.py",
        prevents="a frame of NaN, where texture coordinates say nothing",
        changes=(("    if length > 1.0e-6 * wp.length(dp_du):", "    if True:"),),
        tests=(ENDS + "test_tangents_that_say_nothing",),
    ),
    Guard(
        name="a tangent where the normal lies along the old one",
        file="kernels/materials/frames.py",
        prevents="a frame of NaN",
        changes=(("    if across < 1.0e-6:", "    if False:"),),
        tests=(ENDS + "test_normals_bent_onto_the_tangent",),
    ),
    Guard(
        name="texture coordinates within integers",
        file="kernels/materials/texture.py",
        prevents="an infinite coordinate is a NaN, a huge one no integer",
        changes=(
            (
                "return wp.vec2(wp.clamp(u, -1048576.0, 1048576.0), wp.clamp(v, -1048576.0, 1048576.0))",
                "return wp.vec2(u, v)",
            ),
        ),
        tests=(ENDS + "test_coordinates_beyond_all_numbers_are_in_the_image",),
    ),
    Guard(
        name="no medium absorbs nothing, however far",
        file="kernels/materials/medium.py",
        prevents="0 * inf",
        changes=(("    if sigma_t == 0.0:\n        return 1.0\n", ""),),
        tests=(MEDIA + "test_empty_space_and_infinite_distances",),
    ),
    Guard(
        name="free paths of channels without extinction",
        file="kernels/materials/medium.py",
        prevents="division by zero",
        changes=(("    if sigma_t == 0.0:\n        return _INF\n", ""),),
        tests=(ENDS + "test_free_paths_of_the_last_random_numbers",),
    ),
    Guard(
        name="free paths of a random number of 1",
        file="kernels/materials/medium.py",
        prevents="an infinite path in a dense medium",
        changes=(("-log1p_of(-wp.min(u_distance, _BELOW_ONE))", "-log1p_of(-u_distance)"),),
        tests=(ENDS + "test_free_paths_of_the_last_random_numbers",),
    ),
    Guard(
        name="arc cosines of 1 and a bit",
        file="kernels/maths/elementary.py",
        prevents="NaN for the angle between a direction and itself",
        changes=(("    c = wp.clamp(wp.float64(x), -_ONE, _ONE)\n", "    c = wp.float64(x)\n"),),
        tests=(ELEMENTARY + "test_zeros_infinities_and_the_rest",),
    ),
    Guard(
        name="directions of a disc's rim",
        file="kernels/maths/directions.py",
        prevents="the square root of a rounding below zero",
        changes=(
            (
                "    z = wp.sqrt(wp.max(0.0, 1.0 - d[0] * d[0] - d[1] * d[1]))\n    return around",
                "    z = wp.sqrt(1.0 - d[0] * d[0] - d[1] * d[1])\n    return around",
            ),
        ),
        tests=(ENDS + "test_directions_of_a_squares_border",),
    ),
    Guard(
        name="the middle of a disc",
        file="kernels/maths/directions.py",
        prevents="0 / 0 for the random point (1/2, 1/2)",
        changes=(("    if y == 0.0:\n        return wp.vec2(0.0, 0.0)\n", ""),),
        tests=("tests/kernels/maths/test_directions.py::test_cosine_hemisphere_keeps_strata_together",),
    ),
    Guard(
        name="random numbers below 1",
        file="kernels/maths/random.py",
        prevents="32 random bits round to 1, which is beyond the last of all shares",
        changes=(
            (
                "return wp.vec2(float(x >> wp.uint32(8)) * TO_UNIT, float(y >> wp.uint32(8)) * TO_UNIT)",
                "return wp.vec2(float(x) * TO_UNIT * 0.00390625, float(y) * TO_UNIT * 0.00390625)",
            ),
        ),
        tests=("tests/kernels/maths/test_random.py::test_points_are_a_net",),
    ),
    Guard(
        name="the brightest patch of the sky is the unit",
        file="kernels/lights/environment.py",
        prevents="squares of radiance overflow",
        changes=(("    scale = 1.0 / wp.max(a, b)", "    scale = 1.0"),),
        tests=(ENDS + "test_patches_of_the_sky_of_any_radiance",),
    ),
    Guard(
        name="lamps are seen from their front",
        file="kernels/lights/direct.py",
        prevents="a division by a cosine of zero",
        changes=(("    if cosine <= 0.0:\n        return 0.0\n", ""),),
        tests=(LIGHTS + "test_triangle_samples_agree_with_their_density",),
    ),
    Guard(
        name="lamps are left at an offset",
        file="kernels/lights/direct.py",
        prevents="a lamp shadows the light that it sends",
        changes=(
            (
                "leave(point, normal, lights.offset_min)",
                "point",
            ),
        ),
        tests=("tests/analytic/test_direct_light.py::test_a_rectangle_lights_a_patch",),
    ),
    Guard(
        name="the sky has no density at its poles",
        file="kernels/lights/environment.py",
        prevents="a division by the sine of an angle of zero",
        changes=(("    if seen.sine > 0.0:\n        found.pdf", "    if True:\n        found.pdf"),),
        tests=(ENDS + "test_the_poles_of_the_sky",),
    ),
)
