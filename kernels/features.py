"""The set of effects that a scene calls for: it picks the kernels.

Derived once from the scene by the master and sent along, so that all workers build the same kernels. A kernel that is
specialised to fewer features gives the same bits as one with all of them, on every scene that needs no more.
"""

from __future__ import annotations

from dataclasses import dataclass, fields


@dataclass(frozen=True)
class Features:
    """Which effects kernels are compiled for.

    Attributes:
        conductor ... principled: leaf materials besides the diffuse one, which is always there.
        rough: some microfacet distribution has a roughness above zero.
        blend: some material chooses between two.
        passing: light passes straight through some surface: masks, null boundaries, thin dielectrics.
        bent: bump or normal maps.
        bitmaps, checkerboards, vertex_colors: textures, by kind.
        points, spots, directionals, environment: lights besides emitting triangles, which are always there.
        textured_lights: the emission of some mesh is textured.
        media: participating media.
        lens: the camera has a lens of finite size.
        orthographic: the camera's rays are parallel.
        traced: camera paths go on from diffuse parts too: path tracing, final gathering.
    """

    conductor: bool = False
    dielectric: bool = False
    thin_dielectric: bool = False
    plastic: bool = False
    principled: bool = False
    rough: bool = False
    blend: bool = False
    passing: bool = False
    bent: bool = False
    bitmaps: bool = False
    checkerboards: bool = False
    vertex_colors: bool = False
    points: bool = False
    spots: bool = False
    directionals: bool = False
    environment: bool = False
    textured_lights: bool = False
    media: bool = False
    lens: bool = False
    orthographic: bool = False
    traced: bool = False

    @property
    def glossy(self) -> bool:
        """Some surface has a part that is traced on, not gathered."""
        return self.conductor or self.dielectric or self.thin_dielectric or self.plastic or self.principled

    @property
    def textures(self) -> bool:
        """Some parameter is textured."""
        return self.bitmaps or self.checkerboards or self.vertex_colors

    @property
    def coated(self) -> bool:
        """Some diffuse part is not Lambertian, or lies under bumps: each photon counts by its direction."""
        return self.plastic or self.principled or self.bent

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
        return tuple(field.name for field in fields(self) if getattr(self, field.name))


ALL = Features(**{field.name: True for field in fields(Features)})
"""Everything compiled in."""
