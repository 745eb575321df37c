"""The side of a surface that its diffuse part is lit from, where it is to be known before the surface is shaded.

Gather rays read irradiance, and samples records, at the place where they arrive. Of a sheet that light comes through
that is the place on its other side, if the material's choice, by the same number as in shading, is that part of it.
"""

from __future__ import annotations

import functools

import warp as wp

from wdpm.kernels.camera.paths import Paths, Vertex, camera_path
from wdpm.kernels.camera.scene import Scene
from wdpm.kernels.camera.vertices import CHOICE, number_1d
from wdpm.kernels.features import Features
from wdpm.kernels.irradiance.gather_places import Place, Places
from wdpm.kernels.made_for import made_for
from wdpm.kernels.materials.surface import make_surface
from wdpm.scenes.flat.material_sides import THROUGH

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_THROUGH = wp.constant(THROUGH)


@functools.cache
def make_lit_place(features: Features) -> wp.Function:
    """The function `lit_place` for surfaces with a set of features."""
    surface_at = make_surface(features).surface_at

    @wp.func
    def lit_place(scene: wp.ref[Scene], p: Vertex, place: Place) -> Place:
        """A place on the side that its diffuse part is lit from.

        Args:
            p: that has arrived there.
            place: on the seen side.
        """
        if (scene.materials.gathers[place.side >> 1] & _THROUGH) != 0:
            u_choice = wp.float32(0.0)
            if wp.static(features.blend or features.passing):
                u_choice = number_1d(scene.camera.seed, p, CHOICE)
            to_viewer = -wp.normalize(p.direction)
            s = surface_at(scene.surfaces, scene.materials, scene.textures, p.prim, p.u, p.v, to_viewer, u_choice)
            if s.through == 1:
                place.normal = -place.normal
                place.shading_normal = -place.shading_normal
                place.side = place.side ^ 1
        return place

    return lit_place


@functools.cache
def make_light_places(features: Features) -> wp.Kernel:
    """The kernel that does so with places of paths."""
    lit_place = make_lit_place(features)

    @made_for(features)
    def light_places(scene: Scene, paths: Paths, offset: wp.int32, places: Places) -> None:
        """Turn places to the sides that their diffuse parts are lit from, in place.

        Args:
            places: of the paths, on the seen side.
        """
        i = offset + wp.tid()
        place = Place()
        place.normal = places.normal[i]
        place.shading_normal = places.shading_normal[i]
        place.side = places.side[i]
        place = lit_place(scene, camera_path(scene.camera, paths, i), place)
        places.normal[i] = place.normal
        places.shading_normal[i] = place.shading_normal
        places.side[i] = place.side

    return light_places
