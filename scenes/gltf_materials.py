"""Materials and textures of glTF 2.0, reduced to their diffuse part."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.gltf_container import GltfFile
from wdpm.scenes.images import decode_texture
from wdpm.scenes.model import RGB, Bitmap, Interpolation, Material, Wrap

_WRAPS = {33071: Wrap.CLAMP, 33648: Wrap.MIRROR, 10497: Wrap.REPEAT}
_NEAREST = 9728
_UPWARDS = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 1.0], [0.0, 0.0, 1.0]])  # glTF's v = 0 is the top of the image


@dataclass(frozen=True, eq=False)
class GltfMaterial:
    """A material with what does not fit into `Material`.

    Attributes:
        emission: radiance, or None.
        uv_set: which TEXCOORD_n its texture uses.
    """

    material: Material
    emission: RGB | None
    uv_set: int


class GltfMaterials:
    """Reads materials on demand; None is glTF's default material."""

    def __init__(self, gltf: GltfFile, warnings: list[str]) -> None:
        self._gltf = gltf
        self._warnings = warnings
        self._images: dict[int, NDArray[np.float32]] = {}
        self._found: dict[int | None, int] = {}
        self.materials: list[GltfMaterial] = []

    def read(self, index: int | None) -> int:
        """The position in `materials` of a material of the file."""
        if index not in self._found:
            self._found[index] = len(self.materials)
            owner = {"name": "default"} if index is None else self._gltf.item("materials", index)
            self.materials.append(self._convert(owner, f"material {index}"))
        return self._found[index]

    def _convert(self, owner: dict[str, Any], fallback: str) -> GltfMaterial:
        get = self._gltf.get
        name = get(owner, "name", str, fallback)
        pbr = get(owner, "pbrMetallicRoughness", dict, {})
        factor = self._gltf.numbers(pbr, "baseColorFactor", [1.0, 1.0, 1.0, 1.0])
        colour = factor[0], factor[1], factor[2]
        if not all(0.0 <= channel <= 1.0 for channel in factor):
            raise self._gltf.error(f'material "{name}": baseColorFactor must lie between 0 and 1, got {factor}')
        reflectance: RGB | Bitmap = colour
        uv_set = 0
        if "baseColorTexture" in pbr:
            reflectance, uv_set = self._bitmap(get(pbr, "baseColorTexture", dict, {}), colour, name)
        self._warn_about_rest(owner, pbr, factor[3], name)
        material = Material(name, reflectance, twosided=get(owner, "doubleSided", bool, False))
        return GltfMaterial(material, self._emission(owner, name), uv_set)

    def _warn_about_rest(self, owner: dict[str, Any], pbr: dict[str, Any], alpha: float, name: str) -> None:
        found = []
        # metallic and roughness default to 1, so a file that says nothing asks for metal
        if self._gltf.number(pbr, "metallicFactor", 1.0) > 0:
            found.append("metallic")
        if owner.get("alphaMode", "OPAQUE") != "OPAQUE" or alpha < 1:
            found.append("alpha")
        found += [key for key in ("normalTexture", "occlusionTexture") if key in owner]
        extensions = self._gltf.get(owner, "extensions", dict, {})
        found += [key for key in extensions if key not in ("KHR_materials_emissive_strength", "KHR_materials_unlit")]
        if found:
            self._warnings.append(f'material "{name}": treated as diffuse, without {", ".join(found)}')

    def _emission(self, owner: dict[str, Any], name: str) -> RGB | None:
        factor = np.array(self._gltf.numbers(owner, "emissiveFactor", [0.0, 0.0, 0.0]))
        extensions = self._gltf.get(owner, "extensions", dict, {})
        strength = self._gltf.get(extensions, "KHR_materials_emissive_strength", dict, {})
        factor = factor * self._gltf.number(strength, "emissiveStrength", 1.0)
        if factor.min() < 0:
            raise self._gltf.error(f'material "{name}": emission must not be negative')
        if "emissiveTexture" in owner and factor.max() > 0:
            pixels, _ = self._pixels(self._gltf.get(owner, "emissiveTexture", dict, {}))
            factor = factor * pixels.mean(axis=(0, 1), dtype=np.float64)
            self._warnings.append(f'material "{name}": its emissive texture is replaced by its mean')
        return (float(factor[0]), float(factor[1]), float(factor[2])) if factor.max() > 0 else None

    def _pixels(self, info: dict[str, Any]) -> tuple[NDArray[np.float32], dict[str, Any]]:
        texture = self._gltf.item("textures", info.get("index"))
        source = self._gltf.get(texture, "source", int, -1)
        if source < 0:
            raise self._gltf.error("a texture has no PNG or JPEG source; other image formats are not supported")
        if source not in self._images:
            image = self._gltf.item("images", source)
            data = (
                self._gltf.uri_bytes(self._gltf.get(image, "uri", str, ""))
                if "uri" in image
                else self._gltf.view_bytes(image.get("bufferView"))
            )
            self._images[source] = decode_texture(data, f"{self._gltf.file} (image {source})", raw=False)
        return self._images[source], texture

    def _bitmap(self, info: dict[str, Any], colour: RGB, name: str) -> tuple[Bitmap, int]:
        pixels, texture = self._pixels(info)
        sampler = self._gltf.item("samplers", texture["sampler"]) if "sampler" in texture else {}
        wrap, wrap_t = (self._wrap(sampler, key) for key in ("wrapS", "wrapT"))
        if wrap != wrap_t:
            self._warnings.append(f'material "{name}": wrapT is ignored, wrapS is used for both directions')
        nearest = sampler.get("magFilter") == _NEAREST
        extensions = self._gltf.get(info, "extensions", dict, {})
        transform = self._gltf.get(extensions, "KHR_texture_transform", dict, {})
        uv_set = self._gltf.get(info, "texCoord", int, 0)
        tinted = pixels if colour == (1.0, 1.0, 1.0) else pixels * np.array(colour, dtype=np.float32)
        bitmap = Bitmap(
            self._gltf.get(texture, "name", str, name),
            tinted,
            wrap,
            Interpolation.NEAREST if nearest else Interpolation.BILINEAR,
            _UPWARDS @ self._texture_transform(transform),
        )
        return bitmap, self._gltf.get(transform, "texCoord", int, uv_set)

    def _wrap(self, sampler: dict[str, Any], key: str) -> Wrap:
        code = self._gltf.get(sampler, key, int, 10497)
        if code not in _WRAPS:
            raise self._gltf.error(f"broken glTF: {key} {code}")
        return _WRAPS[code]

    def _texture_transform(self, owner: dict[str, Any]) -> NDArray[np.float64]:
        """KHR_texture_transform: offset * rotation * scale, as in the extension's text."""
        dx, dy = self._gltf.numbers(owner, "offset", [0.0, 0.0])
        sx, sy = self._gltf.numbers(owner, "scale", [1.0, 1.0])
        angle = self._gltf.number(owner, "rotation", 0.0)
        c, s = np.cos(angle), np.sin(angle)
        move = np.array([[1.0, 0.0, dx], [0.0, 1.0, dy], [0.0, 0.0, 1.0]])
        turn = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        return move @ turn @ np.diag([sx, sy, 1.0])
