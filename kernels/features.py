"""The set of effects that a scene calls for: it picks the kernels.

Derived once from the scene by the master and sent along, so that all workers build the same kernels. A kernel that is
specialised to fewer features gives the same bits as one with all of them, on every scene that needs no more.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from enum import Enum
from functools import cached_property
from typing import Any

from wdpm.scenes.model.bsdfs import LEAVES
from wdpm.scenes.model.leaf_kind import LeafKind, never
from wdpm.scenes.model.lights import DELTA_LIGHTS


class Group(Enum):
    """What kind of thing calls for a feature: kernels are made for the groups that they can tell apart."""

    MATERIALS = "materials"
    TEXTURES = "textures"
    LIGHTS = "lights"
    MEDIA = "media"
    CAMERAS = "cameras"
    SETTINGS = "settings"
    GEOMETRY = "geometry"


def _effect(group: Group, words: str, switches_on: str) -> Any:
    """A feature that is off unless something calls for it.

    Args:
        words: its name for people.
        switches_on: what it compiles in, for people.
    """
    return field(default=False, metadata={"group": group, "words": words, "switches_on": switches_on})


@dataclass(frozen=True)
class Features:
    """Which effects kernels are compiled for.

    Attributes:
        conductor ... rough_pane: leaf materials besides the diffuse one, which is always there.
        rough: some microfacet distribution has a roughness above zero.
        blend: some material chooses between two.
        passing: light passes straight through some surface: masks, null boundaries, thin dielectrics.
        bent: bump or normal maps.
        bitmaps, checkerboards, vertex_colors: textures, by kind.
        points, spots, projectors, directionals, environment: lights besides emitting triangles, which are always there.
        textured_lights: the emission of some mesh is textured.
        media: participating media.
        grids: some medium's density changes from place to place.
        lens: the camera has a lens of finite size.
        orthographic: the camera's rays are parallel.
        instances: shapes that are held once stand in several places.
        traced: camera paths go on from diffuse parts too: path tracing, final gathering.
    """

    conductor: bool = _effect(Group.MATERIALS, "metals and mirrors", "Fresnel's formulas for metals")
    dielectric: bool = _effect(Group.MATERIALS, "glass", "refraction and reflection")
    thin_dielectric: bool = _effect(Group.MATERIALS, "thin panes", "light straight through panes")
    plastic: bool = _effect(Group.MATERIALS, "plastic", "a diffuse base under a coat")
    principled: bool = _effect(Group.MATERIALS, "principled", "Disney's lobes")
    translucent: bool = _effect(Group.MATERIALS, "translucent sheets", "diffuse light on the other side")
    rough_pane: bool = _effect(Group.MATERIALS, "rough panes", "microfacets that let light through unbent")
    rough: bool = _effect(Group.MATERIALS, "rough microfacets", "sampling of visible normals")
    blend: bool = _effect(Group.MATERIALS, "blends", "a choice between two at each hit")
    passing: bool = _effect(Group.MATERIALS, "masks, null boundaries", "light goes on behind them")
    bent: bool = _effect(Group.MATERIALS, "bump and normal maps", "normals bent at each hit")
    bitmaps: bool = _effect(Group.TEXTURES, "image textures", "look-ups in images")
    checkerboards: bool = _effect(Group.TEXTURES, "checkerboards", "checkerboard look-ups")
    vertex_colors: bool = _effect(Group.TEXTURES, "vertex colours", "colours interpolated at each hit")
    points: bool = _effect(Group.LIGHTS, "point lights", "their sampling")
    spots: bool = _effect(Group.LIGHTS, "spot lights", "their cones")
    projectors: bool = _effect(Group.LIGHTS, "projectors", "the pictures that they throw")
    directionals: bool = _effect(Group.LIGHTS, "directional lights", "photons and shadow rays from afar")
    environment: bool = _effect(Group.LIGHTS, "light from all around", "importance sampling of its map")
    textured_lights: bool = _effect(Group.LIGHTS, "textured lights", "a look-up for each point on a lamp")
    media: bool = _effect(Group.MEDIA, "participating media", "free paths, transmittance, phase functions")
    grids: bool = _effect(Group.MEDIA, "heterogeneous media", "walks through grids of densities")
    lens: bool = _effect(Group.CAMERAS, "depth of field", "camera rays start on a lens")
    orthographic: bool = _effect(Group.CAMERAS, "parallel camera rays", "camera rays of one direction")
    instances: bool = _effect(Group.GEOMETRY, "instances", "trees below a tree, triangles placed at each hit")
    traced: bool = _effect(Group.SETTINGS, "diffuse parts traced on", "camera paths go on by diffuse parts too")

    def compiles(self, kind: LeafKind) -> bool:
        """Whether kernels have the code of a kind of leaf."""
        return kind.feature is None or bool(getattr(self, kind.feature))

    @cached_property
    def glossy(self) -> bool:
        """Some surface has a part that is traced on, not gathered."""
        return any(leaf.KIND.glossy and self.compiles(leaf.KIND) for leaf in LEAVES)

    @cached_property
    def sheer(self) -> bool:
        """Some surface scatters light to its other side."""
        kinds = (leaf.KIND for leaf in LEAVES)
        return any(kind.glossy and kind.transmits is not never and self.compiles(kind) for kind in kinds)

    @cached_property
    def non_lambertian(self) -> bool:
        """Some diffuse part is not Lambertian."""
        return any(not leaf.KIND.lambertian and self.compiles(leaf.KIND) for leaf in LEAVES)

    @property
    def oriented(self) -> bool:
        """The looks of some surface may depend on the direction of its tangents."""
        return self.rough or self.bent or any(leaf.KIND.always_rough and self.compiles(leaf.KIND) for leaf in LEAVES)

    @property
    def delta_lights(self) -> bool:
        """There are lights without area."""
        return any(getattr(self, light.KIND.feature) for light in DELTA_LIGHTS)

    @property
    def textures(self) -> bool:
        """Some parameter is textured."""
        return self.bitmaps or self.checkerboards or self.vertex_colors

    @property
    def coated(self) -> bool:
        """Some diffuse part is not Lambertian, or lies under bumps: each photon counts by its direction."""
        return self.non_lambertian or self.bent

    @property
    def goes_on(self) -> bool:
        """Camera paths may have more than one vertex."""
        return self.glossy or self.passing or self.traced

    @property
    def walks(self) -> bool:
        """Shadow rays may get through surfaces, or lose light on the way."""
        return self.passing or self.media

    @property
    def misses(self) -> bool:
        """Rays that meet no surface may bring light."""
        return self.environment or self.media

    def names(self) -> tuple[str, ...]:
        """The features that are on."""
        return tuple(feature.name for feature in fields(self) if getattr(self, feature.name))

    def only(self, *groups: Group) -> Features:
        """The features of some groups; the others are off."""
        return Features(**{name: getattr(self, name) for name in names_of(*groups)})


def names_of(*groups: Group) -> tuple[str, ...]:
    """The features that things of some groups call for, in the order of the fields."""
    return tuple(feature.name for feature in fields(Features) if feature.metadata["group"] in groups)


WORDS: dict[str, tuple[str, str]] = {
    feature.name: (feature.metadata["words"], feature.metadata["switches_on"]) for feature in fields(Features)
}
"""Of every feature: its name for people, and what it switches on."""

ALL = Features(**{feature.name: True for feature in fields(Features)})
"""Everything compiled in."""
