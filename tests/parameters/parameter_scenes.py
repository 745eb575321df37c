"""Scenes in which one plugin of Mitsuba's has one parameter set; what the reader makes of it."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from enum import Enum
from pathlib import Path

import imageio.v3 as imageio
import numpy as np
import pytest

from wdpm.images.image import Image
from wdpm.scenes import SceneError
from wdpm.scenes.mitsuba.plugin import Plugin
from wdpm.scenes.mitsuba.read import read_mitsuba


class Fate(Enum):
    """What becomes of a parameter."""

    READ = "read"
    MEANS_NOTHING = "means nothing here"
    WARNED = "warning"
    REFUSED = "error"


# Values where that of the type would not do.
_FITTING = {
    "distribution": "ggx",
    "material": "Au",
    "focal_length": "35mm",
    "fov_axis": "y",
    "filter_type": "nearest",
    "wrap_mode": "clamp",
    "format": "rgb",
    "file_format": "openexr",
    "pixel_format": "rgb",
    "component_format": "float16",
    "aovs": "d:depth",
    "name": "vertex_color",
    "far_clip": "100",
    "fov": "40",
    "lobes": "3",
    "turbidity": "3",
    "cutoff_angle": "30",
    "stddev": "0.7",
    "month": "7",
    "day": "15",
    "year": "2020",
    "crop_width": "8",
    "crop_height": "8",
    "crop_offset_x": "1",
    "crop_offset_y": "1",
    "shape_index": "0",
}
_FILES = {
    "obj": "a.obj",
    "ply": "a.ply",
    "serialized": "a.serialized",
    "bitmap": "a.png",
    "envmap": "sky.exr",
}
_VALUES = {
    "float": "0.5",
    "int": "1",
    "bool": "true",
    "string": "x",
    "spectrum": "0.5",
    "point": "1,2,3",
    "vector": "0,0.6,0.8",
}
_TAGS = {"float": "float", "int": "integer", "bool": "boolean", "string": "string", "spectrum": "rgb"}


def write_files(folder: Path) -> None:
    """Meshes and pictures that plugins can name."""
    corners = ["0 0 0", "1 0 0", "0 1 0"]
    (folder / "a.obj").write_text("".join(f"v {c}\nvt 0 0\n" for c in corners) + "f 1/1 2/2 3/3\n")
    head = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    head += "property float r\nproperty float g\nproperty float b\nelement face 1\n"
    head += "property list uchar int vertex_indices\nend_header\n"
    (folder / "a.ply").write_text(head + "".join(f"{c} 1 0.5 0.25\n" for c in corners) + "3 0 1 2\n")
    body = struct.pack("<I", 0x1000) + b"mesh\0" + struct.pack("<QQ", 3, 1)
    body += np.array([c.split() for c in corners], "<f4").tobytes() + np.array([0, 1, 2], "<u4").tobytes()
    mesh = struct.pack("<HH", 0x041C, 4) + zlib.compress(body)
    (folder / "a.serialized").write_bytes(mesh + struct.pack("<QI", 0, 1))
    imageio.imwrite(folder / "a.png", np.full((4, 4, 3), 128, np.uint8))
    Image({"beauty": np.ones((4, 8, 3), np.float32)}).save(folder / "sky.exr")


def parameter_xml(name: str, kind: str, value: str | None = None, plugin: str = "") -> str:
    """One parameter, of a fitting value unless one is given."""
    if kind == "texture" and plugin in ("spot", "projector"):
        return f'<texture type="bitmap" name="{name}"><string name="filename" value="a.png"/></texture>'
    if kind == "texture":
        return f'<texture type="checkerboard" name="{name}"/>'
    if kind == "volume":
        return f'<volume type="constvolume" name="{name}"/>'
    if kind == "transform":
        return f'<transform name="{name}"><rotate y="1" angle="{value or 10}"/></transform>'
    if name in ("int_ior", "ext_ior") and value is None:
        value = "water" if kind == "string" else "1.4"
    if value is None:
        value = _FILES[plugin] if name == "filename" else _FITTING.get(name, _VALUES[kind])
    if kind in ("point", "vector"):
        x, _, rest = value.partition(",")
        y, _, z = rest.partition(",")
        return f'<{kind} name="{name}" x="{x}" y="{y}" z="{z}"/>'
    return f'<{_TAGS[kind]} name="{name}" value="{value}"/>'


def _needed(category: str, plugin: str, given: str) -> str:
    """What a plugin cannot do without, but for a parameter that is given."""
    parts = {}
    if plugin in _FILES:
        parts["filename"] = parameter_xml("filename", "string", plugin=plugin)
    if plugin == "thinlens":
        parts["aperture_radius"] = parameter_xml("aperture_radius", "float")
    if plugin == "mesh_attribute":
        parts["name"] = parameter_xml("name", "string")
    if plugin == "blendbsdf":
        parts["weight"] = parameter_xml("weight", "float")
    if plugin == "normalmap":
        map_ = '<texture type="bitmap" name="normalmap"><string name="filename" value="a.png"/><boolean name="raw" '
        parts["normalmap"] = map_ + 'value="true"/></texture>'
    if plugin == "bumpmap":
        parts["texture"] = '<texture type="bitmap" name="b"><string name="filename" value="a.png"/></texture>'
    nested = {"blendbsdf": 2, "mask": 1, "twosided": 1, "bumpmap": 1, "normalmap": 1}.get(plugin, 0)
    if category == "integrator" and plugin in ("aov", "moment"):
        parts["integrator"] = '<integrator type="path"/>'
    if plugin == "cylinder" and given in ("p0", "p1"):
        parts["other"] = parameter_xml("p1" if given == "p0" else "p0", "point", "0,0,9")
    if given in ("alpha_u", "alpha_v"):
        parts["other"] = parameter_xml("alpha_v" if given == "alpha_u" else "alpha_u", "float")
    if given.startswith("crop_offset"):
        parts |= {name: parameter_xml(name, "int") for name in ("crop_width", "crop_height")}
    return "".join(xml for name, xml in parts.items() if name != given) + nested * '<bsdf type="diffuse"/>'


def scene_xml(category: str, plugin: str, parameters: str, given: str = "") -> str:
    """A scene with the plugin in it, in the third line its parameters."""
    inside = _needed(category, plugin, given)
    mesh = '<shape type="ply"><string name="filename" value="a.ply"/>'
    places = {
        "bsdf": (mesh, "</shape>"),
        "texture": (f'{mesh}<bsdf type="diffuse">', "</bsdf></shape>"),
        "medium": ('<shape type="cube">', "</shape>"),
        "phase": ('<shape type="cube"><medium type="homogeneous" name="interior">', "</medium></shape>"),
        "volume": ('<shape type="cube"><medium type="homogeneous" name="interior">', "</medium></shape>"),
        "film": ('<sensor type="perspective">', "</sensor>"),
        "sampler": ('<sensor type="perspective">', "</sensor>"),
        "rfilter": ('<sensor type="perspective"><film type="hdrfilm">', "</film></sensor>"),
    }
    before, after = places.get(category, ("", ""))
    if plugin == "area":
        before, after = mesh, "</shape>"
    name = {"texture": ' name="reflectance"', "medium": ' name="interior"', "volume": ' name="albedo"'}.get(
        category, ""
    )
    light = "" if plugin in ("constant", "envmap", "sunsky") else '<emitter type="constant"/>'
    lines = [
        '<scene version="3.0.0">' + light + ("" if category == "shape" else '<shape type="rectangle"/>'),
        f'{before}<{category} type="{plugin}"{name}>{inside}',
        parameters,
        f"</{category}>{after}</scene>",
    ]
    return "\n".join(lines)


@contextmanager
def _noting(monkeypatch: pytest.MonkeyPatch) -> Iterator[set[str]]:
    """The names of parameters that a reader takes since they mean nothing here."""
    taken: set[str] = set()
    original = Plugin.ignore

    def ignore(self: Plugin, *names: str) -> list[str]:
        found = original(self, *names)
        taken.update(found)
        return found

    with monkeypatch.context() as patch:
        patch.setattr(Plugin, "ignore", ignore)
        yield taken


def read(folder: Path, category: str, plugin: str, parameters: str, given: str = "") -> tuple[str, ...]:
    """Read such a scene; its warnings. Raises SceneError."""
    file = folder / "scene.xml"
    file.write_text(scene_xml(category, plugin, parameters, given))
    return read_mitsuba(file, {}).warnings


def fate(folder: Path, monkeypatch: pytest.MonkeyPatch, category: str, plugin: str, name: str, kind: str) -> Fate:
    """What becomes of a parameter that has a fitting value."""
    without = set() if name == "filename" else set(read(folder, category, plugin, "", ""))
    with _noting(monkeypatch) as ignored:
        try:
            warnings = set(read(folder, category, plugin, parameter_xml(name, kind, plugin=plugin), name))
        except SceneError:
            return Fate.REFUSED
    if any(name in warning for warning in warnings - without):
        return Fate.WARNED
    return Fate.MEANS_NOTHING if name in ignored else Fate.READ
