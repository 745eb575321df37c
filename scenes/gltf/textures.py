"""Textures of glTF 2.0 as bitmaps: samplers, channels, KHR_texture_transform."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.errors import SceneError
from wdpm.scenes.gltf.container import GltfFile
from wdpm.scenes.images.ahead import Ahead
from wdpm.scenes.images.read import alpha_of, linear_pixels, unpacked
from wdpm.scenes.model.textures import RGB, Bitmap, Interpolation, Wrap

_WRAPS = {33071: Wrap.CLAMP, 33648: Wrap.MIRROR, 10497: Wrap.REPEAT}
WEBP: Final = "EXT_texture_webp"
_NEAREST = 9728
_UPWARDS = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 1.0], [0.0, 0.0, 1.0]])  # glTF's v = 0 is the top of the image

RED: Final = 0
GREEN: Final = 1
BLUE: Final = 2


Images = Ahead[int, NDArray[Any]]
"""Unpacked images by their numbers in the file."""


def each(bitmap: Bitmap, change: Callable[[NDArray[np.float32]], NDArray[np.float32]]) -> Bitmap:
    """A texture whose texels, shape [height, width, 3], are changed."""
    return replace(bitmap, pixels=change(bitmap.pixels))


def read_image(gltf: GltfFile, number: int) -> NDArray[Any]:
    """An image of the file, unpacked."""
    image = gltf.item("images", number)
    data = (
        gltf.uri_bytes(gltf.get(image, "uri", str, ""))
        if "uri" in image
        else bytes(gltf.view_bytes(image.get("bufferView")))
    )
    return unpacked(data, image_name(gltf, number))


def image_name(gltf: GltfFile, number: int) -> str:
    """What to call an image in messages."""
    return f"{gltf.file} (image {number})"


def images_of(gltf: GltfFile) -> Iterator[int]:
    """Images of the textures that materials of meshes name. What is wrong with one is told when it is read."""
    used: list[Any] = []
    for number in range(gltf.count("meshes")):
        with suppress(SceneError):
            primitives = gltf.get(gltf.item("meshes", number), "primitives", list, [])
            used += [each.get("material") for each in primitives if isinstance(each, dict)]
    waiting: list[Any] = []
    for number in dict.fromkeys(each for each in used if isinstance(each, int)):
        with suppress(SceneError):
            waiting.append(gltf.item("materials", number))
    while waiting:
        for key, value in waiting.pop(0).items():
            if not isinstance(value, dict):
                continue
            waiting.append(value)
            if key.endswith("Texture") and "index" in value:
                with suppress(SceneError):
                    yield _source_of(gltf, gltf.item("textures", value["index"]))


def _source_of(gltf: GltfFile, texture: dict[str, Any]) -> int:
    extensions = gltf.get(texture, "extensions", dict, {})
    fallback: int = gltf.get(texture, "source", int, -1)
    source: int = gltf.get(gltf.get(extensions, WEBP, dict, {}), "source", int, fallback)
    if source < 0:
        other = f" (it is in {', '.join(sorted(extensions))})" if extensions else ""
        raise gltf.error(f"a texture has no PNG, JPEG or WebP source{other}; no other format is read")
    return source


class GltfTextures:
    """Reads the textures of one file; every image is decoded once.

    Args:
        images: reads them.
    """

    def __init__(self, gltf: GltfFile, warnings: list[str], images: Images) -> None:
        self._gltf = gltf
        self._ahead = images
        self._numbers: dict[int, NDArray[Any]] = {}
        self._warnings = warnings
        self._images: dict[tuple[int, bool], NDArray[np.float32]] = {}

    def color(self, info: dict[str, Any], factor: RGB, name: str) -> Bitmap:
        """A texture of colours times a factor.

        Args:
            info: the JSON object that names the texture.
            name: of the material, for messages.
        """
        pixels = self._pixels(info, raw=False)
        tinted = pixels if factor == (1.0, 1.0, 1.0) else pixels * np.array(factor, dtype=np.float32)
        return self._bitmap(info, tinted, name)

    def channel(self, info: dict[str, Any], channel: int, factor: float, name: str) -> Bitmap:
        """One channel of a texture of numbers, times a factor."""
        values = self._pixels(info, raw=True)[:, :, channel : channel + 1] * np.float32(factor)
        return self._bitmap(info, np.repeat(values, 3, axis=2), name)

    def alpha(self, info: dict[str, Any], name: str) -> Bitmap | None:
        """The alpha channel of a texture, if it has one."""
        source = self._source(info)
        pixels = alpha_of(self._unpacked(source), image_name(self._gltf, source))
        return None if pixels is None else self._bitmap(info, pixels, name)

    def normals(self, info: dict[str, Any], name: str) -> Bitmap:
        """A normal map; its "scale" steepens the slopes."""
        pixels = self._pixels(info, raw=True)
        scale = self._gltf.number(info, "scale", 1.0)
        if scale != 1.0:
            vectors = (pixels * 2.0 - 1.0) * np.array([scale, scale, 1.0], dtype=np.float32)
            lengths = np.linalg.norm(vectors, axis=2, keepdims=True)
            pixels = (vectors / np.maximum(lengths, np.float32(1e-20)) * 0.5 + 0.5).astype(np.float32)
        return self._bitmap(info, pixels, name)

    def uv_set(self, info: dict[str, Any]) -> int:
        """Which TEXCOORD_n a texture uses."""
        given: int = self._gltf.get(info, "texCoord", int, 0)
        moved: int = self._gltf.get(self._transform(info), "texCoord", int, given)
        return moved

    def _texture(self, info: dict[str, Any]) -> dict[str, Any]:
        return self._gltf.item("textures", info.get("index"))

    def _source(self, info: dict[str, Any]) -> int:
        return _source_of(self._gltf, self._texture(info))

    def _pixels(self, info: dict[str, Any], *, raw: bool) -> NDArray[np.float32]:
        key = self._source(info), raw
        if key not in self._images:
            source, _ = key
            self._images[key] = linear_pixels(self._unpacked(source), image_name(self._gltf, source), raw=raw)
        return self._images[key]

    def _unpacked(self, source: int) -> NDArray[Any]:
        if source not in self._numbers:
            self._numbers[source] = self._ahead.get(source)
        return self._numbers[source]

    def _bitmap(self, info: dict[str, Any], pixels: NDArray[np.float32], name: str) -> Bitmap:
        texture = self._texture(info)
        sampler = self._gltf.item("samplers", texture["sampler"]) if "sampler" in texture else {}
        wrap, wrap_t = (self._wrap(sampler, key) for key in ("wrapS", "wrapT"))
        if wrap != wrap_t:
            self._warnings.append(f'material "{name}": wrapT is ignored, wrapS is used for both directions')
        nearest = sampler.get("magFilter") == _NEAREST
        return Bitmap(
            self._gltf.get(texture, "name", str, name),
            pixels,
            wrap,
            Interpolation.NEAREST if nearest else Interpolation.BILINEAR,
            _UPWARDS @ self._to_uv(self._transform(info)),
        )

    def _wrap(self, sampler: dict[str, Any], key: str) -> Wrap:
        code = self._gltf.get(sampler, key, int, 10497)
        if code not in _WRAPS:
            raise self._gltf.error(f"broken glTF: {key} {code}")
        return _WRAPS[code]

    def _transform(self, info: dict[str, Any]) -> dict[str, Any]:
        extensions = self._gltf.get(info, "extensions", dict, {})
        transform: dict[str, Any] = self._gltf.get(extensions, "KHR_texture_transform", dict, {})
        return transform

    def _to_uv(self, owner: dict[str, Any]) -> NDArray[np.float64]:
        """KHR_texture_transform: offset * rotation * scale, as in the extension's text."""
        dx, dy = self._gltf.numbers(owner, "offset", [0.0, 0.0])
        sx, sy = self._gltf.numbers(owner, "scale", [1.0, 1.0])
        angle = self._gltf.number(owner, "rotation", 0.0)
        c, s = np.cos(angle), np.sin(angle)
        move = np.array([[1.0, 0.0, dx], [0.0, 1.0, dy], [0.0, 0.0, 1.0]])
        turn = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        return move @ turn @ np.diag([sx, sy, 1.0])
