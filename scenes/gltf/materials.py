"""Materials of glTF 2.0 as scattering functions.

Source: Khronos Group, "glTF 2.0 Specification", section 3.9 and appendix B, and the extensions in
`MATERIAL_EXTENSIONS`. Metallic-roughness is a `principled` material. What is see-through by KHR_materials_transmission
is a thin pane, as the extension wants it, and refracts only with KHR_materials_volume.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.gltf.container import GltfFile
from wdpm.scenes.gltf.reflection import (
    Reflection,
    grey_of,
    head_on,
    index_of_pane,
    reflection_of,
    textured_reflection,
)
from wdpm.scenes.gltf.textures import BLUE as BLUE_CHANNEL
from wdpm.scenes.gltf.textures import GREEN, RED, GltfTextures, Images
from wdpm.scenes.gltf.textures import each as each_texel
from wdpm.scenes.model.bsdfs import (
    HARDLY_ANY,
    WHITE,
    Blend,
    Bsdf,
    Diffuse,
    Mask,
    NormalMap,
    Principled,
    RoughPane,
    ThinDielectric,
    Translucent,
    TwoSided,
)
from wdpm.scenes.model.scene import Material, Medium
from wdpm.scenes.model.textures import RGB, Bitmap, Color, Number, VertexColors

COLOR_ATTRIBUTE: Final = "COLOR_0"

SPECULAR_GLOSSINESS: Final = "KHR_materials_pbrSpecularGlossiness"

DIFFUSE_TRANSMISSION: Final = "KHR_materials_diffuse_transmission"

MATERIAL_EXTENSIONS: Final = frozenset(
    (
        "KHR_materials_anisotropy",
        "KHR_materials_clearcoat",
        DIFFUSE_TRANSMISSION,
        "KHR_materials_emissive_strength",
        "KHR_materials_ior",
        SPECULAR_GLOSSINESS,
        "KHR_materials_sheen",
        "KHR_materials_specular",
        "KHR_materials_transmission",
        "KHR_materials_unlit",
        "KHR_materials_volume",
    )
)
"""Extensions of materials that are read here; a file that requires others cannot be read."""


_Numbers = TypeVar("_Numbers", float, NDArray[np.float32])

_DARKEST = 1e-6
"""Share of light that the darkest attenuation lets pass: none at all would be infinitely dense."""


@dataclass(frozen=True, eq=False)
class GltfMaterial:
    """A material with what does not fit into `Material`.

    Attributes:
        emission: radiance, or None.
        uv_set: which TEXCOORD_n its textures use.
        vertex_tint: the factor that the mesh's vertex colours (COLOR_0) must be multiplied by, where the material reads
            them; else None.
        medium: what is behind its surfaces, or None.
        opaque: whether its alphaMode takes no notice of opacity.
        double_sided: whether it is seen, and glows, from both sides.
    """

    material: Material
    emission: Color | None
    uv_set: int
    vertex_tint: RGB | None = None
    medium: Medium | None = None
    opaque: bool = True
    double_sided: bool = False


class GltfMaterials:
    """Reads materials on demand; None is glTF's default material."""

    def __init__(self, gltf: GltfFile, warnings: list[str], images: Images) -> None:
        self._gltf = gltf
        self._warnings = warnings
        self._textures = GltfTextures(gltf, warnings, images)
        self._found: dict[tuple[int | None, bool], int] = {}
        self.materials: list[GltfMaterial] = []

    def read(self, index: int | None, *, colored: bool = False) -> int:
        """The position in `materials` of a material of the file.

        Args:
            colored: whether the mesh has vertex colours (COLOR_0), which then tint the material.
        """
        key = index, colored
        if key not in self._found:
            owner = {"name": "default"} if index is None else self._gltf.item("materials", index)
            converter = _Converter(self._gltf, self._textures, self._warnings, owner, f"material {index}")
            self._found[key] = len(self.materials)
            self.materials.append(converter.convert(colored=colored))
        return self._found[key]


class _Converter:
    """One material."""

    def __init__(
        self, gltf: GltfFile, textures: GltfTextures, warnings: list[str], owner: dict[str, Any], fallback: str
    ) -> None:
        self._gltf = gltf
        self._textures = textures
        self._warnings = warnings
        self._owner = owner
        self._name: str = gltf.get(owner, "name", str, fallback)
        self._pbr: dict[str, Any] = gltf.get(owner, "pbrMetallicRoughness", dict, {})
        self._extensions: dict[str, Any] = gltf.get(owner, "extensions", dict, {})
        self._glossy: dict[str, Any] | None = self._extensions.get(SPECULAR_GLOSSINESS)
        if self._glossy is not None:
            self._glossy = self._extension(SPECULAR_GLOSSINESS)
            names = {"diffuseFactor": "baseColorFactor", "diffuseTexture": "baseColorTexture"}
            self._pbr = {new: self._glossy[old] for old, new in names.items() if old in self._glossy}
        self._double_sided: bool = gltf.get(owner, "doubleSided", bool, False)
        self._uv_set: int | None = None
        self._medium: Medium | None = None

    def convert(self, *, colored: bool) -> GltfMaterial:
        factor = self._base_factor()
        base: Color = self._base_color(factor)
        tint: RGB | None = None
        if colored and isinstance(base, Bitmap):  # the factor is in it
            base, tint = replace(base, tinted=True), WHITE
        elif colored:
            base, tint = VertexColors(COLOR_ATTRIBUTE), (factor[0], factor[1], factor[2])
        bsdf = self._with_opacity(self._scattering(base), factor[3])
        emission = self._emission()
        self._warn_about_rest()
        opaque = self._owner.get("alphaMode", "OPAQUE") == "OPAQUE"
        sides = self._double_sided and self._medium is None
        return GltfMaterial(Material(self._name, bsdf), emission, self._uv_set or 0, tint, self._medium, opaque, sides)

    def _warn(self, message: str) -> None:
        self._warnings.append(f'material "{self._name}": {message}')

    def _extension(self, name: str) -> dict[str, Any]:
        values: dict[str, Any] = self._gltf.get(self._extensions, name, dict, {})
        return values

    def _share(self, owner: dict[str, Any], key: str, default: float) -> float:
        value = self._gltf.number(owner, key, default)
        if not 0.0 <= value <= 1.0:
            raise self._gltf.error(f'material "{self._name}": {key} must lie between 0 and 1, got {value:g}')
        return value

    def _base_factor(self) -> list[float]:
        factor = self._gltf.numbers(self._pbr, "baseColorFactor", [1.0, 1.0, 1.0, 1.0])
        if not all(0.0 <= channel <= 1.0 for channel in factor):
            raise self._gltf.error(f'material "{self._name}": baseColorFactor must lie between 0 and 1, got {factor}')
        return factor

    def _base_color(self, factor: list[float]) -> Color:
        colour = factor[0], factor[1], factor[2]
        info = self._info(self._pbr, "baseColorTexture")
        return colour if info is None else self._textures.color(info, colour, self._name)

    def _info(self, owner: dict[str, Any], key: str) -> dict[str, Any] | None:
        """The object that names a texture; all textures of a material share one set of texture coordinates."""
        if key not in owner:
            return None
        info: dict[str, Any] = self._gltf.get(owner, key, dict, {})
        uv_set = self._textures.uv_set(info)
        if self._uv_set is None:
            self._uv_set = uv_set
        elif uv_set != self._uv_set:
            self._warn(f"{key} uses TEXCOORD_{uv_set}: TEXCOORD_{self._uv_set} is used instead, as for the others")
        return info

    def _number(self, owner: dict[str, Any], factor: str, default: float, texture: str, channel: int) -> float | Bitmap:
        """A factor times a channel of a texture."""
        value = self._share(owner, factor, default)
        info = self._info(owner, texture)
        return value if info is None or value == 0.0 else self._textures.channel(info, channel, value, self._name)

    def _scattering(self, base: Color) -> Bsdf:
        if "KHR_materials_unlit" in self._extensions:
            self._warn("unlit: it is lit like any diffuse surface")
            return TwoSided(Diffuse(base)) if self._double_sided else Diffuse(base)
        bent = self._bending()
        transmission = self._extension("KHR_materials_transmission")
        through = self._number(transmission, "transmissionFactor", 0.0, "transmissionTexture", RED)
        if through != 0.0 and self._index() < math.inf and self._is_solid():
            return bent(self._solid(base, through))
        metallic = self._metallic()

        def sided(surface: Bsdf) -> Bsdf:
            return TwoSided(bent(surface)) if self._double_sided else bent(surface)

        if metallic == 1.0:  # what is said of dielectrics is of no matter
            return sided(self._metal(base))
        sheet = self._sheet(sided)
        reflection = self._reflection()
        whole = through == 0.0 and sheet is None and reflection.share == 0.0
        inner: Number = metallic if whole else 0.0  # else the metal is mixed with all the rest, at the end
        surface = sided(reflection.over(lambda eta: self._principled(base, eta, inner), self._metal))
        if sheet is not None:
            surface = Blend(surface, reflection.over(sheet[1], lambda color: sided(self._metal(color))), sheet[0])
        if through != 0.0:
            pane = reflection.over(lambda eta: self._pane(base, eta), lambda color: sided(self._metal(color)))
            surface = Blend(surface, pane, through)
        return surface if whole or metallic == 0.0 else Blend(surface, sided(self._metal(base)), metallic)

    def _metal(self, color: Color) -> Bsdf:
        return self._principled(color, 1.5, 1.0)

    def _solid(self, base: Color, through: Number) -> Bsdf:
        """Glass of KHR_materials_volume, bent by the index of refraction alone."""
        if self._extension("KHR_materials_specular"):
            self._warn("KHR_materials_specular is ignored: it refracts, and reflects by its index of refraction")
        return self._principled(base, self._index(), self._metallic(), through)

    def _pane(self, base: Color, eta: float) -> Bsdf:
        """What KHR_materials_transmission lets through without a volume: a thin pane, rough where the surface is.

        From an index of 1.5 on it blurs by the lobe of its reflection; below, by less, as Khronos' own viewer has it.
        """
        roughness = self._roughness()
        if roughness == 0.0:
            return ThinDielectric(index_of_pane(eta), WHITE, base)
        return RoughPane(base, roughness, eta, blur=min(max(2.0 * self._index() - 2.0, 1e-3), 1.0))

    def _sheet(self, sided: Callable[[Bsdf], Bsdf]) -> tuple[Number, Callable[[float], Bsdf]] | None:
        """Which share of a surface lets light diffusely through, and that share by its index of refraction.

        It reflects towards all angles what it reflects head-on.
        """
        extension = self._extension(DIFFUSE_TRANSMISSION)
        share = self._share(extension, "diffuseTransmissionFactor", 0.0)
        info = self._info(extension, "diffuseTransmissionTexture")
        if share == 0.0:
            return None
        weight: Number = share if info is None else self._alpha_of(info, share)
        factor = self._colour(extension, "diffuseTransmissionColorFactor", (1.0, 1.0, 1.0))
        colours = self._info(extension, "diffuseTransmissionColorTexture")
        colour: Color = factor if colours is None else self._textures.color(colours, factor, self._name)

        def sheet(eta: float) -> Bsdf:
            return Blend(Translucent(colour), sided(self._metal(WHITE)), head_on(eta))

        return weight, sheet

    def _alpha_of(self, info: dict[str, Any], factor: float) -> Number:
        """The alpha channel of a texture times a factor; the factor where it has none."""
        alpha = self._textures.alpha(info, self._name)
        return factor if alpha is None else each_texel(alpha, lambda pixels: pixels * np.float32(factor))

    def _colour(self, owner: dict[str, Any], key: str, default: RGB, most: float = 1.0) -> RGB:
        red, green, blue = self._gltf.numbers(owner, key, list(default))
        if not (min(red, green, blue) >= 0.0 and max(red, green, blue) <= most):
            allowed = f"lie between 0 and {most:g}" if most < math.inf else "not be negative"
            raise self._gltf.error(f'material "{self._name}": {key} must {allowed}, got {[red, green, blue]}')
        return red, green, blue

    def _roughness(self) -> Number:
        if self._glossy is None:
            return self._number(self._pbr, "roughnessFactor", 1.0, "metallicRoughnessTexture", GREEN)
        factor = self._share(self._glossy, "glossinessFactor", 1.0)
        info = self._info(self._glossy, "specularGlossinessTexture")
        glossiness = factor if info is None else self._alpha_of(info, factor)
        if isinstance(glossiness, Bitmap):
            return each_texel(glossiness, lambda pixels: np.float32(1.0) - pixels)
        return 1.0 - factor

    def _metallic(self) -> float | Bitmap:
        if self._glossy is not None:
            return 0.0
        return self._number(self._pbr, "metallicFactor", 1.0, "metallicRoughnessTexture", BLUE_CHANNEL)

    def _principled(self, base: Color, eta: float, metallic: Number, spec_trans: Number = 0.0) -> Bsdf:
        index = max(eta, HARDLY_ANY)  # a metal reflects whatever is said of dielectrics
        return replace(self._gloss, base_color=base, eta=index, metallic=metallic, spec_trans=spec_trans)

    @cached_property
    def _gloss(self) -> Principled:
        """What the leaves of the material have in common."""
        roughness, anisotropic = self._anisotropic(self._roughness())
        sheen = self._sheen()
        principled = Principled(roughness=roughness, anisotropic=anisotropic, sheen=sheen, layered=True)
        if "KHR_materials_clearcoat" not in self._extensions:
            return principled
        coat = self._extension("KHR_materials_clearcoat")
        clearcoat = self._number(coat, "clearcoatFactor", 0.0, "clearcoatTexture", RED)
        if clearcoat != 0.0:
            self._warn("its clear coat is Disney's, weaker than glTF's, most so at grazing angles")
        rough = self._number(coat, "clearcoatRoughnessFactor", 0.0, "clearcoatRoughnessTexture", GREEN)
        gloss = _clearcoat_gloss(rough) if isinstance(rough, float) else each_texel(rough, _clearcoat_gloss)
        return replace(principled, clearcoat=clearcoat, clearcoat_gloss=gloss)

    def _anisotropic(self, roughness: Number) -> tuple[Number, float]:
        """Disney's roughness and anisotropy for those of the extension: alpha is longer along the texture's u.

        There, alpha along u is a mixture of roughness² and 1 by the strength squared, and roughness² across; Disney's
        are roughness² over and times the root of 1 - 0.9 anisotropic.
        """
        extension = self._extension("KHR_materials_anisotropy")
        strength = self._share(extension, "anisotropyStrength", 0.0)
        if strength == 0.0:
            return roughness, 0.0
        if not isinstance(roughness, float) or roughness == 0.0:
            self._warn("its anisotropy is ignored: it is read together with one roughness above 0 alone")
            return roughness, 0.0
        if self._gltf.number(extension, "anisotropyRotation", 0.0) != 0.0:
            self._warn("anisotropyRotation is ignored: its highlights are stretched along u")
        across = roughness * roughness
        along = across + (1.0 - across) * strength * strength
        anisotropic = (1.0 - across / along) / 0.9
        if anisotropic > 1.0:
            self._warn("its anisotropy is lowered to Disney's largest, of one to ten")
        return (across * along) ** 0.25, min(anisotropic, 1.0)

    def _sheen(self) -> Number:
        """The strength of Disney's sheen, which has no colour of its own and is as broad at any roughness."""
        sheen = self._extension("KHR_materials_sheen")
        colour = self._colour(sheen, "sheenColorFactor", (0.0, 0.0, 0.0))
        info = self._info(sheen, "sheenColorTexture")
        if max(colour) == 0.0:
            return 0.0
        self._warn("its sheen is Disney's, grey and as broad at any roughness")
        return (
            sum(colour) / 3.0 if info is None else each_texel(self._textures.color(info, colour, self._name), grey_of)
        )

    def _index(self) -> float:
        """Of refraction; infinite where KHR_materials_ior has 0, which says that all is reflected."""
        ior = self._gltf.number(self._extension("KHR_materials_ior"), "ior", 1.5)
        if ior != 0.0 and ior < 1.0:
            raise self._gltf.error(f'material "{self._name}": ior must be 0 or at least 1, got {ior:g}')
        return math.inf if ior == 0.0 else ior

    def _reflection(self) -> Reflection:
        """What the dielectric reflects, by KHR_materials_ior and _specular or by the archived specular-glossiness."""
        if self._glossy is not None:
            colour = self._colour(self._glossy, "specularFactor", WHITE, 1.0)
            return self._reflection_of(self._glossy, "specularGlossinessTexture", colour, math.inf)
        index = self._index()
        specular = self._extension("KHR_materials_specular")
        colour = self._colour(specular, "specularColorFactor", WHITE, math.inf)
        strength = self._share(specular, "specularFactor", 1.0)
        info = self._info(specular, "specularTexture")
        reflection = self._reflection_of(specular, "specularColorTexture", colour, index).weakened(strength)
        return reflection if info is None else reflection.weakened(self._alpha_of(info, 1.0))

    def _reflection_of(self, owner: dict[str, Any], texture: str, factor: RGB, index: float) -> Reflection:
        """By a colour, times a texture, of what an index of refraction reflects head-on."""
        most = head_on(index) if index < math.inf else 1.0
        red, green, blue = (most * channel for channel in factor)
        info = self._info(owner, texture)
        if info is not None:
            colours = self._textures.color(info, (red, green, blue), self._name)
            found = textured_reflection(colours, max(red, green, blue))
        elif factor == WHITE and index < math.inf:
            return Reflection(index)
        else:
            found = reflection_of((min(red, 1.0), min(green, 1.0), min(blue, 1.0)))
        if found.greyed:
            self._warn("the colour of its reflection is taken as grey")
        return found

    def _is_solid(self) -> bool:
        volume = self._extension("KHR_materials_volume")
        if not self._gltf.number(volume, "thicknessFactor", 0.0) > 0.0:
            return False
        self._medium = self._absorption(volume)
        return True

    def _absorption(self, volume: dict[str, Any]) -> Medium | None:
        """What a solid absorbs: over `attenuationDistance`, light becomes `attenuationColor`."""
        colour = self._gltf.numbers(volume, "attenuationColor", [1.0, 1.0, 1.0])
        if not all(0.0 <= channel <= 1.0 for channel in colour):
            raise self._gltf.error(f'material "{self._name}": attenuationColor must lie between 0 and 1, got {colour}')
        if "attenuationDistance" not in volume or min(colour) == 1.0:
            return None
        distance = self._gltf.number(volume, "attenuationDistance", 1.0)
        if not distance > 0.0:
            raise self._gltf.error(f'material "{self._name}": attenuationDistance must be above 0, got {distance:g}')
        red, green, blue = (-math.log(max(channel, _DARKEST)) / distance for channel in colour)
        return Medium(self._name, (red, green, blue), (0.0, 0.0, 0.0))

    def _bending(self) -> Callable[[Bsdf], Bsdf]:
        info = self._info(self._owner, "normalTexture")
        if info is None:
            return lambda bsdf: bsdf
        normals = self._textures.normals(info, self._name)
        return lambda bsdf: NormalMap(bsdf, normals, along_v=-1.0)  # v grows downwards

    def _with_opacity(self, bsdf: Bsdf, factor: float) -> Bsdf:
        mode = self._gltf.get(self._owner, "alphaMode", str, "OPAQUE")
        if mode == "OPAQUE":
            return bsdf
        if mode not in ("MASK", "BLEND"):
            raise self._gltf.error(f'broken glTF: alphaMode "{mode}"')
        cutoff = self._gltf.number(self._owner, "alphaCutoff", 0.5) if mode == "MASK" else None
        info = self._info(self._pbr, "baseColorTexture")
        bitmap = None if info is None else self._textures.alpha(info, self._name)
        if bitmap is None:
            opacity = factor if cutoff is None else float(factor >= cutoff)
            return bsdf if opacity == 1.0 else Mask(bsdf, opacity)
        pixels = bitmap.pixels * np.float32(factor)
        if pixels.min() >= (1.0 if cutoff is None else np.float32(cutoff)):
            return bsdf
        # a little less than the cutoff, which texels of just this opacity are not to miss by rounding
        return Mask(bsdf, replace(bitmap, pixels=pixels), 0.0 if cutoff is None else cutoff * (1.0 - 1e-6))

    def _emission(self) -> RGB | Bitmap | None:
        factor = np.array(self._gltf.numbers(self._owner, "emissiveFactor", [0.0, 0.0, 0.0]))
        strength = self._extension("KHR_materials_emissive_strength")
        factor = factor * self._gltf.number(strength, "emissiveStrength", 1.0)
        if "KHR_materials_unlit" in self._extensions:  # all but the base colour is for those that do not know it
            return None
        if factor.min() < 0:
            raise self._gltf.error(f'material "{self._name}": emission must not be negative')
        if factor.max() == 0:
            return None
        colour = float(factor[0]), float(factor[1]), float(factor[2])
        info = self._info(self._owner, "emissiveTexture")
        if info is None:
            return colour
        bitmap = self._textures.color(info, colour, self._name)
        return bitmap if bitmap.pixels.max() > 0 else None

    def _warn_about_rest(self) -> None:
        if "occlusionTexture" in self._owner:
            self._warn("its occlusion texture is ignored: occlusion is computed")
        unknown = sorted(key for key in self._extensions if key not in MATERIAL_EXTENSIONS)
        if unknown:
            self._warn(f"{', '.join(unknown)} ignored")
        textures = {
            "KHR_materials_anisotropy": ("anisotropyTexture",),
            "KHR_materials_clearcoat": ("clearcoatNormalTexture",),
            "KHR_materials_sheen": ("sheenRoughnessTexture",),
            "KHR_materials_volume": ("thicknessTexture",),
        }
        for extension, keys in textures.items():
            for key in keys:
                if key in self._extension(extension):
                    self._warn(f"{key} is ignored")


def _clearcoat_gloss(roughness: _Numbers) -> _Numbers:
    """The gloss whose microfacets are as rough as glTF's: alpha = roughness², between 0.1 (gloss 0) and 0.001 (1)."""
    gloss = np.clip((0.1 - roughness * roughness) / (0.1 - 0.001), 0.0, 1.0)
    return float(gloss) if isinstance(roughness, float) else gloss.astype(np.float32)
