"""A mesh within its scene, as checks see it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wdpm.checkup.findings import MOST_PLACES, Finding, Level
from wdpm.checkup.soup import Ints, Soup
from wdpm.scenes.model.bsdfs import Bsdf, ThinDielectric, TwoSided, walk
from wdpm.scenes.model.scene import Scene, Solid


@dataclass(frozen=True)
class Part:
    """A mesh of a scene and its triangles."""

    scene: Scene
    soup: Soup
    number: int

    @property
    def mesh(self) -> Solid:
        return self.scene.meshes[self.number]

    @property
    def bsdf(self) -> Bsdf:
        return self.scene.materials[self.mesh.material].bsdf

    @property
    def rows(self) -> slice:
        return self.soup.rows_of(self.number)

    @property
    def encloses(self) -> bool:
        """Whether light has to know inside from outside: a solid dielectric, or the boundary of a medium."""
        return self.mesh.bounds or is_solid(self.bsdf)

    def finding(
        self, level: Level, kind: str, texts: tuple[str, str, str], triangles: Ints | None = None, **figures: object
    ) -> Finding:
        """A finding in this mesh: what is wrong, what a render does, what to do; triangles by place in the part."""
        places: tuple[int, ...] = ()
        if triangles is not None:
            places = tuple(int(row) for row in self.soup.row[self.rows][triangles[:MOST_PLACES]])
            figures = {"count": len(triangles), "total": len(self.mesh.faces)} | figures
        name = self.scene.materials[self.mesh.material].name
        return Finding(level, kind, *texts, self.mesh.name, name, places=places, **figures)  # type: ignore[arg-type]


def is_solid(bsdf: Bsdf) -> bool:
    """Whether light is refracted into what it covers."""
    nodes = tuple(walk(bsdf))
    return any(node.is_solid for node in nodes) and not any(isinstance(node, ThinDielectric) for node in nodes)


def is_two_sided(bsdf: Bsdf) -> bool:
    """Whether its back is not black."""
    return isinstance(bsdf, TwoSided)


def looks(scene: Scene) -> Ints:
    """A number for each mesh, the same for those that look alike: the same scattering and the same emission."""
    keys = [(id(scene.materials[mesh.material].bsdf), mesh.emission) for mesh in scene.meshes]
    number: dict[object, int] = {}
    return np.array([number.setdefault(key, len(number)) for key in keys], np.int64)
