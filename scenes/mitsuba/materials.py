"""The materials of a Mitsuba scene: which shape has which, each bsdf element read once."""

from __future__ import annotations

from wdpm.scenes.mitsuba.bsdfs import BsdfReader
from wdpm.scenes.mitsuba.document import Element
from wdpm.scenes.mitsuba.plugin import Plugin
from wdpm.scenes.mitsuba.textures import Pictures, TextureReader
from wdpm.scenes.model.bsdfs import BLACK, GREY, Diffuse
from wdpm.scenes.model.scene import Material


class MaterialReader:
    """Collects the materials of a scene; each bsdf element becomes one, however many shapes refer to it.

    Args:
        pictures: reads the files of textures.

    Attributes:
        materials: what was read so far; Mesh.material indexes it.
        textures: reads textures, for whatever else has some (lights).
    """

    def __init__(self, warnings: list[str], pictures: Pictures) -> None:
        self.materials: list[Material] = []
        self.textures = TextureReader(warnings, pictures)
        self._bsdfs = BsdfReader(self.textures, warnings)
        self._by_element: dict[Element, int] = {}
        self._defaults: dict[bool, int] = {}

    def read(self, plugin: Plugin | None, *, emits: bool) -> int:
        """The number of the material of a bsdf; of Mitsuba's default if there is none (black on lights)."""
        if plugin is None:
            if emits not in self._defaults:
                self._defaults[emits] = self._add(Material("default", Diffuse(BLACK if emits else GREY)))
            return self._defaults[emits]
        if plugin.element not in self._by_element:
            self._by_element[plugin.element] = self._add(Material(plugin.name, self._bsdfs.read(plugin)))
        return self._by_element[plugin.element]

    def _add(self, material: Material) -> int:
        self.materials.append(material)
        return len(self.materials) - 1
