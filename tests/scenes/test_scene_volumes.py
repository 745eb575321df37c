"""Heterogeneous media of scene files: grids of voxels, where they lie, and what is wrong with them."""

from __future__ import annotations

import re
import struct
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from mitsuba_xml import read_body
from numpy.typing import ArrayLike, NDArray

from wdpm.scenes.builtin.cornell_box import cornell_box
from wdpm.scenes.errors import SceneError
from wdpm.scenes.flat.flatten import flatten
from wdpm.scenes.model.checks import check_scene
from wdpm.scenes.model.scene import Medium
from wdpm.scenes.model.textures import Wrap
from wdpm.scenes.model.volumes import Volume

LIGHT_AND_CAMERA = '<emitter type="constant"/><sensor type="perspective"/>'
RAMP = np.arange(24, dtype=np.float32).reshape(2, 3, 4)  # z, y, x

read = partial(read_body, after=LIGHT_AND_CAMERA)


def vol(
    values: ArrayLike,
    encoding: int = 1,
    box: tuple[float, ...] = (0, 0, 0, 1, 1, 1),
    head: bytes = b"VOL\x03",
    cut: int = 0,
) -> bytes:
    array = np.asarray(values)
    array = array[..., None] if array.ndim == 3 else array
    z, y, x, channels = array.shape
    dtype = {1: "<f4", 2: "<f2", 3: "|u1"}.get(encoding, "<f4")
    data = head + struct.pack("<5i6f", encoding, x, y, z, channels, *box) + array.astype(dtype).tobytes()
    return data[: len(data) - cut]


def grid(name: str, file: str = "smoke.vol", inside: str = "") -> str:
    return f'<volume type="gridvolume" name="{name}"><string name="filename" value="{file}"/>{inside}</volume>'


def smoke(inside: str) -> str:
    return f'<shape type="cube"><medium type="heterogeneous" name="interior">{inside}</medium></shape>'


def medium_of(folder: Path, inside: str, version: str = "3.0.0") -> Medium:
    (medium,) = read(folder, smoke(inside), version).media
    return medium


def density_of(folder: Path, inside: str, version: str = "3.0.0") -> NDArray[np.float32]:
    density = medium_of(folder, inside, version).density
    assert density is not None
    return density.values[..., 0]


def test_a_grid_of_densities(tmp_path: Path) -> None:
    (tmp_path / "smoke.vol").write_bytes(vol(RAMP))
    placed = '<transform name="to_world"><scale value="2"/><translate x="5"/></transform>'
    more = '<string name="filter_type" value="nearest"/><string name="wrap_mode" value="mirror"/>'
    inside = grid("sigma_t", inside=placed + more) + '<float name="scale" value="3"/>'
    medium = medium_of(tmp_path, inside + '<rgb name="albedo" value="0.1 0.2 0.3"/><phase type="hg"/>')
    assert (medium.sigma_t, medium.albedo, medium.g) == ((3.0, 3.0, 3.0), (0.1, 0.2, 0.3), 0.8)
    assert medium.density is not None
    assert (medium.density.nearest, medium.density.wrap, medium.density.at_corners) == (True, Wrap.MIRROR, False)
    np.testing.assert_array_equal(medium.density.values[..., 0], RAMP)
    np.testing.assert_array_equal(medium.density.to_world @ (1, 1, 1, 1), (7, 2, 2, 1))


def test_encodings(tmp_path: Path) -> None:
    for encoding, expected in ((1, RAMP), (2, RAMP), (3, RAMP * np.float32(1 / 255))):
        (tmp_path / f"{encoding}.vol").write_bytes(vol(RAMP, encoding))
        np.testing.assert_allclose(density_of(tmp_path, grid("sigma_t", f"{encoding}.vol")), expected, rtol=1e-6)


def test_arrays_of_numpy(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", RAMP.astype(np.float64))
    np.savez_compressed(tmp_path / "b.npz", density=RAMP[..., None])
    np.save(tmp_path / "c.npy", RAMP.astype(np.uint8))
    for name, expected in (("a.npy", RAMP), ("b.npz", RAMP), ("c.npy", RAMP / 255)):
        np.testing.assert_allclose(density_of(tmp_path, grid("density", name)), expected, rtol=1e-6)


def test_boxes_of_files(tmp_path: Path) -> None:
    """Mitsuba 3 takes the file's only where asked to; 0.6 does always, and has values at the corners."""
    (tmp_path / "smoke.vol").write_bytes(vol(RAMP, box=(-1, -2, -3, 3, 2, 1)))
    asked = '<boolean name="use_grid_bbox" value="true"/>'
    given = '<point name="min" value="0 0 0"/><point name="max" value="4 4 4"/>'
    for version, inside, corner, at_corners in (
        ("3.0.0", "", (1, 1, 1), False),
        ("3.0.0", asked, (3, 2, 1), False),
        ("0.6.0", "", (3, 2, 1), True),
        ("0.6.0", given, (4, 4, 4), True),
    ):
        density = medium_of(tmp_path, grid("density", inside=inside), version).density
        assert density is not None
        np.testing.assert_allclose(density.to_world @ (1, 1, 1, 1), (*corner, 1))
        assert density.at_corners is at_corners


def test_a_grid_of_albedos(tmp_path: Path) -> None:
    (tmp_path / "smoke.vol").write_bytes(vol(RAMP))
    colors = np.random.default_rng(0).random((2, 2, 2, 3)).astype(np.float32)
    np.save(tmp_path / "tint.npy", colors)
    medium = medium_of(tmp_path, grid("sigma_t") + grid("albedo", "tint.npy"))
    assert medium.albedo_volume is not None
    np.testing.assert_array_equal(medium.albedo_volume.values, colors)
    np.testing.assert_allclose(medium.albedo, colors.max(axis=(0, 1, 2)))


def test_extinction_of_one_hue_is_a_density_times_a_colour(tmp_path: Path) -> None:
    np.save(tmp_path / "hue.npy", RAMP[..., None] * np.float32((0.5, 2.0, 1.0)))
    medium = medium_of(tmp_path, grid("sigma_t", "hue.npy") + '<float name="scale" value="2"/>')
    assert medium.sigma_t == (23.0, 92.0, 46.0)
    assert medium.density is not None
    np.testing.assert_allclose(medium.density.values[..., 0], RAMP / 23.0)


def test_without_a_grid_it_is_homogeneous(tmp_path: Path) -> None:
    constant = '<volume type="constvolume" name="density"><rgb name="value" value="2 2 4"/></volume>'
    medium = medium_of(tmp_path, constant + '<float name="scale" value="10"/>')
    assert (medium.sigma_t, medium.density) == ((20.0, 20.0, 40.0), None)


def test_the_lattice_in_the_renderers_space(tmp_path: Path) -> None:
    """The cube of half length 1 about the origin is the unit of length: 4 voxels along x, and one around them."""
    (tmp_path / "smoke.vol").write_bytes(vol(RAMP))
    media = flatten(read(tmp_path, smoke(grid("sigma_t")))).media
    assert media.density_grid.tolist() == [0]
    assert media.albedo_grid.tolist() == [-1]
    assert media.grids.size.tolist() == [[6, 5, 4]]
    place = media.grids.to_lattice[0] @ (1.0, 1.0, 1.0, 1.0)
    np.testing.assert_allclose(place, (4.5, 3.5, 2.5))
    np.testing.assert_allclose(media.grids.high[0], place)
    np.testing.assert_array_equal(media.grids.lattice(0)[1:-1, 1:-1, 1:-1, 0], RAMP)


FILES = (
    (vol(RAMP, cut=1), "95 bytes of voxels; 4 x 3 x 2 of 1 channels are 96"),
    (vol(RAMP) + b"x", "97 bytes of voxels"),
    (vol(RAMP, cut=100), "44 bytes; a grid volume has a header of 48"),
    (vol(RAMP, head=b"VOL\x02"), 'it does not begin with "VOL" and version 3'),
    (vol(RAMP, encoding=4), "encoding 4; expected 1 (float32), 2 (float16) or 3 (uint8)"),
    (vol(np.zeros((2, 2, 2, 2))), "2 x 2 x 2 voxels of 2 channels"),
    (vol(np.zeros((0, 2, 2))), "2 x 2 x 0 voxels"),
    (vol(RAMP, box=(0, 0, 0, np.nan, 1, 1)), "its bounding box is not finite"),
    (
        vol(np.where(RAMP == 17, -1.0, RAMP)),
        "voxel x=1 y=1 z=1 is -1; expected finite, and not negative (1 such voxels)",
    ),
    (vol(np.where(RAMP > 20, np.nan, RAMP)), "voxel x=1 y=2 z=1 is nan; expected finite"),
    (vol(np.where(RAMP == 0, np.inf, RAMP)), "voxel x=0 y=0 z=0 is inf"),
)


@pytest.mark.parametrize(("data", "message"), FILES, ids=[message[:20] for _, message in FILES])
def test_broken_files_are_named_with_the_line_of_the_scene(tmp_path: Path, data: bytes, message: str) -> None:
    (tmp_path / "smoke.vol").write_bytes(data)
    with pytest.raises(SceneError, match=re.escape(f'volume "gridvolume": smoke.vol: {message}')) as caught:
        read(tmp_path, smoke("\n" + grid("sigma_t")))
    assert (caught.value.line, caught.value.file) == (3, tmp_path / "scene.xml")


ARRAYS = (
    ("a.npy", np.zeros((2, 2)), "an array of float64 and shape [2, 2]; expected numbers, [z, y, x]"),
    ("a.npy", np.zeros((2, 2, 2, 4)), "4 channels; expected 1 or 3"),
    ("a.npy", np.full((2, 2, 2), "x"), "expected numbers"),
    ("a.npy", np.full((2, 2, 2), 1e300), "voxel x=0 y=0 z=0 is inf"),
    ("a.npz", None, "2 arrays (a, b); expected one"),
    ("a.vdb", None, "OpenVDB files are not read; convert it"),
    ("bad.npy", None, "it is no array of NumPy"),
    ("bad.npz", None, "it is no array of NumPy"),
)


@pytest.mark.parametrize(("name", "array", "message"), ARRAYS)
def test_arrays_that_are_no_grids(tmp_path: Path, name: str, array: NDArray[np.float64] | None, message: str) -> None:
    if array is not None:
        np.save(tmp_path / name, array)
    elif name == "a.npz":
        np.savez(tmp_path / name, a=RAMP, b=RAMP)
    else:
        (tmp_path / name).write_bytes(b"\x93NUMPY\x01" if name.endswith("npy") else b"PK\x03\x04 broken")
    with pytest.raises(SceneError, match=re.escape(message)) as caught:
        read(tmp_path, smoke("\n" + grid("sigma_t", name)))
    assert caught.value.line == 3


FLAT = '<transform name="to_world"><scale x="0"/></transform>'
ERRORS = (
    (grid("sigma_t", "none.vol"), 'file "none.vol" not found'),
    (grid("sigma_t", inside='<string name="filter_type" value="cubic"/>'), '"filter_type" must be one of'),
    (grid("sigma_t", inside='<string name="colour" value="red"/>'), 'unknown parameter "colour"'),
    (grid("sigma_t", inside=FLAT), "its box has no volume"),
    (grid("albedo"), "voxel x=2 y=0 z=0 is 2; expected from 0 to 1"),
    (grid("sigma_t", "hues.npy"), 'a "sigma_t" whose hue differs from voxel to voxel is not supported'),
    (grid("sigma_t") + "\n" + '<float name="sigma_t" value="1"/>', 'unknown parameter "sigma_t"'),
    (grid("sigma_t") + grid("sigma_t"), "takes one volume, got 2"),
    ('<float name="scale" value="-1"/>', '"scale" must not be negative'),
)


@pytest.mark.parametrize(("inside", "message"), ERRORS)
def test_errors_name_file_and_line(tmp_path: Path, inside: str, message: str) -> None:
    (tmp_path / "smoke.vol").write_bytes(vol(RAMP))
    np.save(tmp_path / "hues.npy", np.random.default_rng(0).random((2, 2, 2, 3)))
    with pytest.raises(SceneError, match=re.escape(message)) as caught:
        read(tmp_path, smoke("\n" + inside))
    assert caught.value.line in (3, 4)
    assert caught.value.file == tmp_path / "scene.xml"


@pytest.mark.parametrize(
    ("name", "values", "message"),
    [
        ("density", np.zeros((2, 2, 2, 3)), "its density has the shape [2, 2, 2, 3]; expected [z, y, x, 1]"),
        ("density", np.zeros((2, 2, 2)), "its density has the shape [2, 2, 2]"),
        ("density", np.full((2, 2, 2, 1), -1.0), "its density is -1 to -1; expected finite, and not negative"),
        ("density", np.full((2, 2, 2, 1), np.nan), "its density is nan to nan"),
        ("albedo_volume", np.full((2, 2, 2, 3), 1.5), "its albedo is 1.5 to 1.5; expected from 0 to 1"),
    ],
)
def test_scenes_of_ones_own_are_checked(name: str, values: NDArray[np.float64], message: str) -> None:
    volume = Volume("mine", values, np.eye(4))
    medium = Medium("smoke", (1.0,) * 3, **{name: volume})  # type: ignore[arg-type]
    with pytest.raises(SceneError, match=re.escape(f'medium "smoke": {message}')):
        check_scene(replace(cornell_box((4, 4)), media=(medium,)))


def test_a_volume_without_space_is_told() -> None:
    flat = Volume("flat", np.ones((2, 2, 2, 1)), np.diag([1.0, 0.0, 1.0, 1.0]))
    with pytest.raises(SceneError, match='volume "flat": its to_world transform leaves it no space'):
        flatten(replace(cornell_box((4, 4)), media=(Medium("smoke", (1.0,) * 3, density=flat),)))
