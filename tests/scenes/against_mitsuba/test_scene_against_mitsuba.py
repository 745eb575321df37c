"""The reader against Mitsuba 3 itself: where rays hit, which way surfaces face, texture coordinates, cameras, textures.

Mitsuba runs in a process of its own, since its variants are global and it prints warnings of its own.
"""

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
from pathlib import Path

import imageio.v3 as imageio
import numpy as np
import pytest
from numpy.typing import NDArray

from wdpm.scenes import Bitmap, Diffuse, load

pytestmark = pytest.mark.skipif(importlib.util.find_spec("mitsuba") is None, reason="mitsuba is not installed")

MITSUBA = """
import json, sys
import mitsuba as mi
mi.set_variant("scalar_rgb")
request = json.load(open(sys.argv[1]))
answer = {"hits": {}, "cameras": {}, "texels": {}}
for name, file in request["shapes"].items():
    scene = mi.load_file(file)
    hits = []
    for origin, direction in request["rays"]:
        si = scene.ray_intersect(mi.Ray3f(origin, direction))
        hits.append([si.t, *si.sh_frame.n, *si.uv] if si.is_valid() else None)
    answer["hits"][name] = hits
for name, file in request["cameras"].items():
    sensor = mi.load_file(file).sensors()[0]
    rays = [sensor.sample_ray(0, 0, p, [0, 0])[0] for p in request["film"]]
    answer["cameras"][name] = [[*ray.d] for ray in rays]
for name, file in request["textures"].items():
    shape = next(s for s in mi.load_file(file).shapes() if not s.is_emitter())
    si = mi.SurfaceInteraction3f()
    values = []
    for uv in request["uvs"]:
        si.uv = uv
        si.wi = [0, 0, 1]
        values.append([*shape.bsdf().eval_diffuse_reflectance(si)])
    answer["texels"][name] = values
json.dump(answer, sys.stdout)
"""

LAMP = (
    '<shape type="rectangle"><transform name="to_world"><translate z="900"/></transform>'
    '<emitter type="area"><rgb name="radiance" value="1"/></emitter></shape>'
)
# the axes have unit length: Mitsuba 3 does not normalize them, as 0.6 and this reader do
TURNED = '<transform name="to_world"><scale x="1.5" y="0.7" z="1.2"/><rotate x="0.6" y="0.8" angle="40"/></transform>'
RIGID = '<transform name="to_world"><rotate x="0.6" y="0.8" angle="40"/><translate x="0.2"/></transform>'
MIRRORED = '<transform name="to_world"><scale x="-1"/><rotate x="0.6" y="0.8" angle="40"/></transform>'
FLIPPED = '<boolean name="flip_normals" value="true"/>'
CENTRE = '<point name="center" x="0.1" y="0" z="0"/>'
POINTS = '<point name="p0" x="-0.5" y="0.1" z="-0.4"/><point name="p1" x="0.6" y="0.3" z="0.5"/>'
OBJ_FILE = '<string name="filename" value="m.obj"/>'
SHAPES = {
    "rectangle": f'<shape type="rectangle">{TURNED}</shape>',
    "rectangle flipped": f'<shape type="rectangle">{RIGID}{FLIPPED}</shape>',
    "rectangle mirrored": f'<shape type="rectangle">{MIRRORED}</shape>',
    "cube": f'<shape type="cube">{TURNED}</shape>',
    "cube mirrored": f'<shape type="cube">{MIRRORED}</shape>',
    "sphere": f'<shape type="sphere">{CENTRE}<float name="radius" value="0.8"/>{RIGID}</shape>',
    "sphere flipped": f'<shape type="sphere">{FLIPPED}</shape>',
    "sphere mirrored": f'<shape type="sphere">{MIRRORED}</shape>',
    "disk": f'<shape type="disk">{RIGID}</shape>',
    "cylinder": f'<shape type="cylinder">{POINTS}<float name="radius" value="0.4"/></shape>',
    "cylinder flipped": f'<shape type="cylinder">{RIGID}{FLIPPED}</shape>',
    "obj": f'<shape type="obj"><string name="filename" value="m.obj"/>{TURNED}</shape>',
    "obj mirrored": f'<shape type="obj">{OBJ_FILE}<boolean name="face_normals" value="true"/>{MIRRORED}</shape>',
    "obj flat": f'<shape type="obj">{OBJ_FILE}<boolean name="face_normals" value="true"/></shape>',
    "obj unflipped": f'<shape type="obj">{OBJ_FILE}<boolean name="flip_tex_coords" value="false"/></shape>',
    "ply": f'<shape type="ply"><string name="filename" value="m.ply"/>{RIGID}</shape>',
}
OBJ = (
    "v -1 -1 0\nv 1 -1 0.2\nv 1 1 0\nv -1 1 0.5\nv 0 0 1\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nvt 0.5 0.5\n"
    "f 1/1 2/2 5/5\nf 2/2 3/3 5/5\nf 3/3 4/4 5/5\nf 4/4 1/1 5/5\n"
)
PLY = (
    "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\nproperty float s\n"
    "property float t\nelement face 2\nproperty list uchar int vertex_indices\nend_header\n"
    "-1 -1 0 0 0\n1 -1 0 1 0\n1 1 1 1 1\n-1 1 0 0 1\n3 0 1 2\n3 0 2 3\n"
)
FILM = '<film type="hdrfilm"><integer name="width" value="30"/><integer name="height" value="20"/></film>'
LOOK = '<transform name="to_world"><lookat origin="1 2 3" target="0 0 0.5" up="0 1 0"/></transform>'
CAMERAS = {
    "plain": f'<sensor type="perspective">{LOOK}<float name="fov" value="50"/>{FILM}</sensor>',
    "diagonal": f'<sensor type="perspective">{LOOK}<string name="focal_length" value="35mm"/>{FILM}</sensor>',
    "shifted": '<sensor type="perspective"><float name="principal_point_offset_x" value="0.1"/>'
    f'<float name="principal_point_offset_y" value="-0.2"/><float name="fov" value="50"/>{FILM}</sensor>',
}
TO_UV = '<transform name="to_uv"><scale x="2" y="0.5"/><rotate z="1" angle="30"/><translate x="0.3"/></transform>'
TEXTURES = {
    "plain": "",
    "raw": '<boolean name="raw" value="true"/>',
    "mirrored": f'<string name="wrap_mode" value="mirror"/>{TO_UV}',
    "clamped": f'<string name="wrap_mode" value="clamp"/>{TO_UV}',
    "repeated": TO_UV,
}


def rays() -> list[tuple[list[float], list[float]]]:
    """Rays from around the shapes towards them."""
    random = np.random.default_rng(3)
    origins = random.normal(size=(60, 3))
    origins *= 4.0 / np.linalg.norm(origins, axis=1, keepdims=True)
    directions = random.uniform(-0.5, 0.5, size=(60, 3)) - origins
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return [(o.tolist(), d.tolist()) for o, d in zip(origins, directions, strict=True)]


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("mitsuba")
    (folder / "m.obj").write_text(OBJ)
    (folder / "m.ply").write_text(PLY)
    pixels = np.random.default_rng(1).integers(0, 256, (5, 7, 3), dtype=np.uint8)
    imageio.imwrite(folder / "t.png", pixels)
    bodies = {f"shape {name}": body + LAMP for name, body in SHAPES.items()}
    bodies |= {f"camera {name}": body + LAMP for name, body in CAMERAS.items()}
    for name, options in TEXTURES.items():
        nearest = '<string name="filter_type" value="nearest"/>'
        texture = f'<texture type="bitmap" name="reflectance"><string name="filename" value="t.png"/>{nearest}{options}'
        bodies[f"texture {name}"] = (
            f'<shape type="rectangle"><bsdf type="diffuse">{texture}</texture></bsdf></shape>{LAMP}'
        )
    for name, body in bodies.items():
        (folder / f"{name}.xml").write_text(f'<scene version="3.0.0">{body}</scene>')
    return folder


UVS = np.random.default_rng(2).uniform(-1.5, 2.5, (50, 2)).tolist()
FILM_POSITIONS = [[0.5, 0.5], [0.0, 0.0], [1.0, 0.0], [0.3, 0.9]]


@pytest.fixture(scope="module")
def answers(files: Path) -> dict[str, dict[str, list[list[float] | None]]]:
    request = {
        "shapes": {name: str(files / f"shape {name}.xml") for name in SHAPES},
        "cameras": {name: str(files / f"camera {name}.xml") for name in CAMERAS},
        "textures": {name: str(files / f"texture {name}.xml") for name in TEXTURES},
        "rays": rays(),
        "film": FILM_POSITIONS,
        "uvs": UVS,
    }
    (files / "request.json").write_text(json.dumps(request))
    command = [sys.executable, "-c", MITSUBA, str(files / "request.json")]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)
    assert done.returncode == 0, done.stderr
    return dict(json.loads(done.stdout[done.stdout.index('{"hits"') :]))


def first_hit(file: Path, origin: NDArray[np.float64], direction: NDArray[np.float64]) -> list[float] | None:
    """Distance, shading normal and uv of the nearest hit, by trying all triangles (Möller & Trumbore 1997)."""
    mesh = load(file).meshes[0]
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    p = np.cross(direction, c - a)
    determinant = np.sum(p * (b - a), axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        u = np.sum((origin - a) * p, axis=1) / determinant
        q = np.cross(origin - a, b - a)
        v, t = q @ direction / determinant, np.sum(q * (c - a), axis=1) / determinant
        t = np.where((u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0), t, np.inf)
    k = int(np.argmin(t))
    if not np.isfinite(t[k]):
        return None
    weights = np.array([1 - u[k] - v[k], u[k], v[k]])
    face = mesh.faces[k]
    normal = np.cross(b - a, c - a)[k] if mesh.normals is None else weights @ mesh.normals[face]
    assert mesh.uvs is not None
    return [float(t[k]), *(normal / np.linalg.norm(normal)), *(weights @ mesh.uvs[face])]


@pytest.mark.parametrize("name", SHAPES)
def test_shapes(files: Path, answers: dict[str, dict[str, list[list[float] | None]]], name: str) -> None:
    curved = name.split()[0] in ("sphere", "disk", "cylinder")
    compared = 0
    for (origin, direction), theirs in zip(rays(), answers["hits"][name], strict=True):
        ours = first_hit(files / f"shape {name}.xml", np.array(origin), np.array(direction))
        if theirs is None or ours is None:
            assert curved or ours == theirs  # a facet is a little inside the surface: a ray may pass it by
            continue
        compared += 1
        tolerance = 4e-3 if curved else 2e-5
        grazing = abs(np.dot(direction, theirs[1:4])) < 0.3
        if curved and grazing:  # the distance to facets is then off by more than their depth
            continue
        np.testing.assert_allclose(ours[:4], theirs[:4], atol=tolerance)
        difference = np.abs(np.subtract(ours[4:], theirs[4:]))
        assert np.minimum(difference, 1.0 - difference).max() < tolerance if curved else difference.max() < tolerance
    assert compared > 10


@pytest.mark.parametrize("name", CAMERAS)
def test_cameras(files: Path, answers: dict[str, dict[str, list[list[float]]]], name: str) -> None:
    camera = load(files / f"camera {name}.xml").camera
    half = np.tan(np.radians(camera.fov_x) / 2.0)
    for (x, y), theirs in zip(FILM_POSITIONS, answers["cameras"][name], strict=True):
        offset_x, offset_y = x - 0.5 - camera.principal_point[0], y - 0.5 - camera.principal_point[1]
        local = np.array([-2 * half * offset_x, -2 * half * offset_y * camera.height / camera.width, 1.0])
        direction = camera.to_world[:3, :3] @ local
        np.testing.assert_allclose(direction / np.linalg.norm(direction), theirs, atol=1e-5)


@pytest.mark.parametrize("name", TEXTURES)
def test_textures(files: Path, answers: dict[str, dict[str, list[list[float]]]], name: str) -> None:
    bsdf = load(files / f"texture {name}.xml").materials[0].bsdf
    assert isinstance(bsdf, Diffuse)
    bitmap = bsdf.reflectance
    assert isinstance(bitmap, Bitmap)
    height, width, _ = bitmap.pixels.shape
    for uv, theirs in zip(UVS, answers["texels"][name], strict=True):
        u, v, _one = bitmap.to_uv @ [*uv, 1.0]
        texel = (
            _wrapped(int(np.floor(u * width)), width, bitmap),
            _wrapped(int(np.floor((1.0 - v) * height)), height, bitmap),
        )
        np.testing.assert_allclose(bitmap.pixels[texel[1], texel[0]], theirs, atol=1e-5)


def _wrapped(index: int, size: int, bitmap: Bitmap) -> int:
    match bitmap.wrap.value:
        case "repeat":
            return index % size
        case "clamp":
            return min(max(index, 0), size - 1)
    index %= 2 * size
    return index if index < size else 2 * size - 1 - index
