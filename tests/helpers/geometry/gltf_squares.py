"""glTF files of a square that one light shines on, and what is seen of it.

A light of one direction, parallel rays and paths of two edges leave no noise, but where which of several materials a
path meets is chosen at random.
"""

from __future__ import annotations

import base64
import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import PIL.Image
from numpy.typing import NDArray

from wdpm.cluster.render_settings import Integrator, RenderSettings
from wdpm.rendering.in_process import render_in_process
from wdpm.scenes import load

Wide = NDArray[np.float64]
PUNCTUAL = "KHR_lights_punctual"
CORNERS = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], "<f4")
UVS = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], "<f4")
"""The image upright: glTF's v grows downwards."""
FACES = np.array([[0, 1, 2], [0, 2, 3]], "<u4")
_KINDS = {"<f4": 5126, "<u4": 5125, "<u2": 5123, "|u1": 5121}
_WIDTHS = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}


def upwards(theta: float, phi: float = 0.0) -> Wide:
    """A unit direction at an angle from z [degrees], turned by phi."""
    t, p = np.radians([theta, phi])
    return np.array([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)])


def look_from(place: Wide) -> Wide:
    """Axes and origin of what looks along its -z from a place to the origin, shape [4, 4]."""
    back = place / np.linalg.norm(place)
    right = np.cross([0.0, 1.0, 0.0], back)
    right /= np.linalg.norm(right)
    matrix = np.eye(4)
    matrix[:3, 0], matrix[:3, 1], matrix[:3, 2], matrix[:3, 3] = right, np.cross(back, right), back, place
    return matrix


def node_matrix(matrix: Wide) -> list[float]:
    return matrix.T.reshape(-1).tolist()


def data_uri(data: bytes) -> str:
    return "data:;base64," + base64.b64encode(data).decode()


def picture(texels: Any) -> dict[str, Any]:
    """An image of the file, of bytes."""
    buffer = io.BytesIO()
    PIL.Image.fromarray(np.asarray(texels, np.uint8)).save(buffer, "PNG")
    return {"uri": data_uri(buffer.getvalue())}


class Square:
    """A glTF file in the making.

    Attributes:
        document: its JSON; nodes[0] has the square, from -1 to 1 at z = 0 with its front towards +z.
    """

    def __init__(self, material: dict[str, Any] | None = None, *images: Any) -> None:
        self._blob = b""
        self.document: dict[str, Any] = {
            "asset": {"version": "2.0"},
            "extensionsUsed": [PUNCTUAL],
            "nodes": [{"mesh": 0}],
            "meshes": [{"primitives": [{"attributes": {}, "material": 0}]}],
            "materials": [{} if material is None else material],
            "accessors": [],
            "bufferViews": [],
        }
        if images:
            self.document["images"] = [picture(each) for each in images]
            self.document["samplers"] = [{"magFilter": 9728}]
            self.document["textures"] = [{"source": number, "sampler": 0} for number in range(len(images))]
        self.primitive["indices"] = self.add(FACES.reshape(-1))
        self.attribute("POSITION", CORNERS)
        self.attribute("TEXCOORD_0", UVS)

    @property
    def primitive(self) -> dict[str, Any]:
        primitive: dict[str, Any] = self.document["meshes"][0]["primitives"][0]
        return primitive

    def add(self, values: NDArray[Any], **more: Any) -> int:
        """Number of an accessor of values, [count] or [count, width]."""
        data = np.ascontiguousarray(values)
        width = 1 if data.ndim == 1 else data.shape[1]
        self.document["bufferViews"].append({"buffer": 0, "byteOffset": len(self._blob), "byteLength": data.nbytes})
        self._blob += data.tobytes() + bytes(-data.nbytes % 4)
        accessor = {
            "bufferView": len(self.document["bufferViews"]) - 1,
            "componentType": _KINDS[data.dtype.str],
            "count": len(data),
            "type": _WIDTHS[width],
        }
        self.document["accessors"].append(accessor | more)
        return len(self.document["accessors"]) - 1

    def attribute(self, name: str, values: NDArray[Any]) -> None:
        self.primitive["attributes"][name] = self.add(values)

    def lit(self, lamp: Wide, **light: Any) -> Square:
        """With a light at a place that shines at the origin; one of one direction unless said."""
        lights = self.document.setdefault("extensions", {PUNCTUAL: {"lights": []}})[PUNCTUAL]["lights"]
        lights.append({"type": "directional", "intensity": 1.0, **light})
        extension = {PUNCTUAL: {"light": len(lights) - 1}}
        self.document["nodes"].append({"matrix": node_matrix(look_from(lamp)), "extensions": extension})
        return self

    def written(self, folder: Path) -> Path:
        self.document["buffers"] = [{"byteLength": len(self._blob), "uri": data_uri(self._blob)}]
        file = folder / "square.gltf"
        file.write_text(json.dumps(self.document))
        return file

    def seen(
        self, folder: Path, eye: Wide, half: float = 0.2, side: int = 4, spp: int = 4, **settings: Any
    ) -> NDArray[np.float64]:
        """Radiance of pixels of a view from a place to the origin, by parallel rays, shape [side, side, 3].

        Args:
            half: half the width of what is seen.
        """
        view = {"xmag": half, "ymag": half, "znear": 1e-3, "zfar": 100.0}
        self.document["cameras"] = [{"type": "orthographic", "orthographic": view}]
        nodes = [*self.document["nodes"], {"matrix": node_matrix(look_from(eye)), "camera": 0}]
        whole, self.document["nodes"] = self.document["nodes"], nodes
        scene = load(self.written(folder), size=(side, side))
        self.document["nodes"] = whole
        chosen = {"integrator": Integrator.PATH, "spp": spp, "max_depth": 2, "all_effects": True} | settings
        return render_in_process(scene, RenderSettings(**chosen), workers=1).pixels.astype(np.float64)

    def scattered(self, folder: Path, eye: Wide, lamp: Wide, spp: int = 4) -> Wide:
        """The scattering function from a direction into another, times the cosine of the light, shape [3]."""
        if not self.document.get("extensions"):
            self.lit(lamp)
        matrix = node_matrix(look_from(5.0 * lamp))
        for node in self.document["nodes"]:
            if PUNCTUAL in node.get("extensions", {}):
                node["matrix"] = matrix
        return self.seen(folder, 5.0 * eye, spp=spp).mean(axis=(0, 1))
