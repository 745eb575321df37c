"""What files of others say beside the format: traces of simulations, pointers of Git LFS, names of forks."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mitsuba_xml import read_body as read

from wdpm.scenes import SceneError, load
from wdpm.scenes.model.bsdfs import Bsdf, Conductor, Diffuse, Principled
from wdpm.scenes.model.scene import Scene

POINTER = "version https://git-lfs.github.com/spec/v1\noid sha256:0f\nsize 123\n"
SMOKE = (
    '<medium type="{kind}" id="smoke">\n'
    '<volume name="{name}" type="gridvolume"><string name="filename" value="a.npy"/></volume></medium>'
    '<shape type="cube"><bsdf type="null"/><ref name="interior" id="smoke"/></shape>'
)


def smoke(folder: Path, values: list[float], *, lenient: bool = False, **how: str) -> Scene:
    channels = 3 if len(values) % 3 == 0 else 1
    np.save(folder / "a.npy", np.array(values, np.float32).reshape(1, 1, -1, channels))
    return read(folder, SMOKE.format(**{"kind": "heterogeneous", "name": "sigma_t", **how}), lenient=lenient)


def test_traces_below_zero_in_a_grid_are_zero_with_a_warning(tmp_path: Path) -> None:
    scene = smoke(tmp_path, [2.0, -1e-45, -1e-6, 0.0])
    grid = scene.media[0].density
    assert grid is not None
    assert grid.values.min() == 0.0
    assert grid.values.max() == 2.0
    assert sum("2 negative voxels, all but 0" in warning for warning in scene.warnings) == 1


def test_what_is_truly_negative_in_a_grid_is_an_error_unless_lenient(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=r"voxel x=1 y=0 z=0 is -0\.5"):
        smoke(tmp_path, [2.0, -0.5])
    scene = smoke(tmp_path, [2.0, -0.5], lenient=True)
    assert any("1 negative voxels, down to -0.5: they are taken as 0" in warning for warning in scene.warnings)


def test_a_lenient_reader_takes_the_mean_of_hues(tmp_path: Path) -> None:
    colours = [1.0, 0.5, 0.0, 0.0, 0.6, 3.0]
    with pytest.raises(SceneError, match="hue differs"):
        smoke(tmp_path, colours)
    medium = smoke(tmp_path, colours, lenient=True).media[0]
    assert medium.density is not None
    assert medium.density.values.reshape(-1) * medium.sigma_t[0] == pytest.approx([0.5, 1.2])
    assert medium.sigma_t == pytest.approx((1.2, 1.2, 1.2))


def test_a_homogeneous_medium_may_have_an_albedo_in_a_grid(tmp_path: Path) -> None:
    medium = smoke(tmp_path, [0.2, 0.4, 0.6], kind="homogeneous", name="albedo").media[0]
    assert medium.density is None
    assert medium.albedo_volume is not None
    assert medium.albedo_volume.values.reshape(-1) == pytest.approx([0.2, 0.4, 0.6])


def test_a_pointer_of_git_lfs_is_said_to_be_one(tmp_path: Path) -> None:
    (tmp_path / "m.obj").write_text(POINTER)
    with pytest.raises(SceneError) as caught:
        read(tmp_path, '<shape type="obj"><string name="filename" value="m.obj"/></shape>')
    assert str(caught.value) == (
        f'{tmp_path / "scene.xml"}:2: "m.obj" is a pointer of Git LFS, not the file itself; '
        "fetch it where it comes from: git lfs pull"
    )
    with pytest.raises(SceneError, match="pointer of Git LFS"):
        load(tmp_path / "m.obj")
    (tmp_path / "a.gltf").write_text(POINTER)
    with pytest.raises(SceneError, match="pointer of Git LFS"):
        load(tmp_path / "a.gltf")


def test_parts_stand_in_the_scene_to_be_referred_to(tmp_path: Path) -> None:
    body = (
        '<sampler type="independent" id="s"><integer name="sample_count" value="9"/></sampler>'
        '<emitter type="area" id="lamp"><rgb name="radiance" value="3"/></emitter>'
        '<shape type="cube"><ref id="lamp"/></shape><sensor type="perspective"><ref id="s"/></sensor>'
    )
    scene = read(tmp_path, body)
    assert scene.samples == 9
    assert scene.meshes[0].emission == (3.0, 3.0, 3.0)


def test_a_size_of_blocks_is_a_warning_and_other_parameters_of_the_scene_are_errors(tmp_path: Path) -> None:
    scene = read(tmp_path, '<shape type="cube"/><integer name="blockSize" value="32"/>')
    assert "line 2: <integer>: the size of blocks is ignored" in scene.warnings
    other = '<shape type="cube"/><integer name="maxDepth" value="32"/>'
    with pytest.raises(SceneError, match="does not belong directly"):
        read(tmp_path, other)
    assert len(read(tmp_path, other, lenient=True).meshes) == 1


def test_a_folder_is_found_from_an_included_file_as_its_files_are(tmp_path: Path) -> None:
    for folder in ("parts", "meshes"):
        (tmp_path / folder).mkdir()
    (tmp_path / "meshes" / "m.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    part = (
        '<scene version="3.0.0"><path value="meshes"/><shape type="obj"><string name="filename" value="m.obj"/></shape>'
    )
    (tmp_path / "parts" / "p.xml").write_text(part + "</scene>")
    assert len(read(tmp_path, '<include filename="parts/p.xml"/>').meshes) == 1
    with pytest.raises(SceneError, match=r'<path>: folder ".*none" not found'):
        read(tmp_path, '<path value="none"/>')


def stand_in(folder: Path, kind: str, inside: str = "") -> Bsdf:
    body = f'<shape type="cube"><bsdf type="{kind}">{inside}</bsdf></shape>'
    with pytest.raises(SceneError, match=r"unknown bsdf plugin|is not supported yet"):
        read(folder, body)
    return read(folder, body, lenient=True).materials[0].bsdf


def test_lenient_readers_know_the_disney_plugins_by_what_they_mean(tmp_path: Path) -> None:
    inside = "".join(
        f'<float name="{name}" value="{value}"/>'
        for name, value in {"specularTransmission": 0.25, "subsurface": 0.5, "specular": 0.3, "eta": 1.4}.items()
    )
    whole = stand_in(tmp_path, "disneybsdf", inside)
    assert isinstance(whole, Principled)
    assert (whole.spec_trans, whole.flatness, whole.eta) == (0.25, 0.5, 1.4)
    parts = {kind: stand_in(tmp_path, f"disney{kind}") for kind in ("metal", "glass", "clearcoat", "sheen", "diffuse")}
    assert all(isinstance(part, Principled) for part in parts.values())
    assert parts["metal"].metallic == parts["glass"].spec_trans == 1.0  # type: ignore[union-attr]
    assert parts["clearcoat"].clearcoat == parts["sheen"].sheen == 1.0  # type: ignore[union-attr]
    assert parts["diffuse"].eta == 1.0  # type: ignore[union-attr]


def test_lenient_readers_take_the_nearest_plugin_by_a_word_in_its_name(tmp_path: Path) -> None:
    assert isinstance(stand_in(tmp_path, "hardMetal"), Conductor)
    assert isinstance(stand_in(tmp_path, "lambertian"), Diffuse)
    cube = read(tmp_path, '<shape type="Cube"/>', lenient=True)
    assert len(cube.meshes) == 1


def test_a_lenient_reader_takes_the_first_of_two(tmp_path: Path) -> None:
    two = '<shape type="cube"><bsdf type="conductor"/><bsdf type="diffuse"/></shape>'
    with pytest.raises(SceneError, match=r"takes one bsdf, got 2"):
        read(tmp_path, two)
    assert isinstance(read(tmp_path, two, lenient=True).materials[0].bsdf, Conductor)
