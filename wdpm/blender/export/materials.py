"""Blender's materials as ours."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from wdpm.blender.export.images import Images
from wdpm.blender.export.media import read_medium
from wdpm.blender.export.notes import Notes
from wdpm.blender.export.shaders import Look, Shaders, emission_of, on_both_sides
from wdpm.blender.export.sockets import surface_output
from wdpm.blender.export.values import Values
from wdpm.scenes.model.bsdfs import Bsdf, Diffuse, Null, TwoSided, transmits
from wdpm.scenes.model.scene import Material, Medium
from wdpm.scenes.model.textures import RGB, Bitmap

GREY = (0.8, 0.8, 0.8)
"""Blender's colour of what has no material."""


@dataclass(frozen=True, eq=False)
class Surface:
    """A material, and what it asks of the meshes that have it.

    Attributes:
        number: among the materials of the scene.
        emission: radiance, or None.
        uv_map, colors: names of the UV map and the colour attribute that it reads, "" for the active ones, or None.
        medium: what fills the meshes, as its number among the media of the scene, or None.
    """

    number: int
    emission: RGB | Bitmap | None = None
    uv_map: str | None = None
    colors: str | None = None
    medium: int | None = None


class Materials:
    """Reads materials, each once.

    Attributes:
        materials, media: those read so far.
    """

    def __init__(self, images: Images, notes: Notes) -> None:
        self.materials: list[Material] = []
        self.media: list[Medium] = []
        self._images = images
        self._notes = notes
        self._known: dict[str | None, Surface] = {}

    def surface(self, material: Any) -> Surface:
        """A material of Blender's; None for a slot without one."""
        name = None if material is None else material.name_full
        if name not in self._known:
            self._known[name] = self._plain("none", GREY) if material is None else self._read(material)
        return self._known[name]

    def _plain(self, name: str, colour: RGB) -> Surface:
        return self._added(name, TwoSided(Diffuse(colour)))

    def _added(self, name: str, bsdf: Bsdf) -> Surface:
        self.materials.append(Material(name, bsdf))
        return Surface(len(self.materials) - 1)

    def _read(self, material: Any) -> Surface:
        if not material.use_nodes or material.node_tree is None:
            red, green, blue, _ = material.diffuse_color
            return self._plain(material.name, (red, green, blue))
        owner = f'material "{material.name}"'
        values = Values(owner, self._images, self._notes)
        output = surface_output(material.node_tree)
        if output is None:
            self._notes.add(owner, "it has no output node: it is black")
            return self._plain(material.name, (0.0, 0.0, 0.0))
        look = Shaders(values).read(output.input("Surface"))
        if output.has("Displacement") and output.input("Displacement").source is not None:
            self._notes.add(owner, "displacement is not supported: the surface stays as modelled")
        medium = self._medium(material.name, output, values)
        bsdf = _scattering(look, filled=medium is not None)
        number = self._added(material.name, bsdf).number
        return Surface(number, emission_of(look), values.uv_map, values.colors, medium if transmits(bsdf) else None)

    def _medium(self, name: str, output: Any, values: Values) -> int | None:
        medium = read_medium(name, output.input("Volume"), values)
        if medium is None:
            return None
        self.media.append(medium)
        return len(self.media) - 1


def _scattering(look: Look, filled: bool) -> Bsdf:
    """How a surface scatters light.

    Args:
        filled: whether there is a medium behind it; alone, it is the boundary of that.
    """
    if look.bsdf is None:
        return Null() if filled and look.emission is None else TwoSided(Diffuse((0.0, 0.0, 0.0)))
    return on_both_sides(look.bsdf)
