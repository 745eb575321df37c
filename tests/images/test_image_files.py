"""Image files: what is written comes back, by other programs' readers too, and a broken file is one clear line."""

from __future__ import annotations

import contextlib
import io
import os
import platform
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import OpenEXR
import PIL.Image
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wdpm.images.channels import LAYER_CHANNELS, encode_srgb8
from wdpm.images.files import check_apart, check_output_path, check_place, png_bytes
from wdpm.images.image import Image, load
from wdpm.scenes.errors import ImageError, NotWrittenError
from wdpm.scenes.images.hdr import decode_hdr, encode_hdr, float_to_rgbe, rgbe_to_float

HEIGHT, WIDTH = 23, 37
LOSSLESS = [".exr", ".pfm", ".npy"]
EVERY_FORMAT = [*LOSSLESS, ".png", ".hdr"]


@pytest.fixture
def image() -> Image:
    """All layers, with values that a careless format loses."""
    rng = np.random.default_rng(1)
    layers = {}
    for name, channels in LAYER_CHANNELS.items():
        shape = (HEIGHT, WIDTH, 3) if len(channels) == 3 else (HEIGHT, WIDTH)
        layers[name] = rng.uniform(0, 2, shape).astype(np.float32)
    layers["depth"][0, :3] = [np.inf, -0.0, 1e-45]
    return Image(layers, {"settings": {"spp": 16, "name": "Höhle \n"}, "report": {"phases": {"render": 1.25}}})


def same_bits(a: np.ndarray, b: np.ndarray) -> bool:
    return a.shape == b.shape and a.dtype == b.dtype and a.tobytes() == b.tobytes()


def test_exr_keeps_every_bit_of_every_layer_and_the_metadata(image: Image, tmp_path: Path) -> None:
    image.save(tmp_path / "a.exr")
    back = load(tmp_path / "a.exr")
    assert list(back.layers) == list(image.layers)
    assert all(same_bits(back.layers[name], image.layers[name]) for name in image.layers)
    assert back.metadata == image.metadata
    assert back.digest() == image.digest()


@pytest.mark.parametrize("extension", LOSSLESS)
def test_float_formats_keep_every_bit_of_beauty(extension: str, tmp_path: Path) -> None:
    pixels: np.ndarray = np.array([[[0, -0.0, 1e-45], [np.inf, -np.inf, np.nan], [3e38, -1, 1 / 3]]], dtype=np.float32)
    path = tmp_path / f"a{extension}"
    Image({"beauty": pixels}).save(path)
    assert same_bits(load(path).pixels, pixels)


def test_exr_channels_have_the_names_that_others_expect(image: Image, tmp_path: Path) -> None:
    image.save(tmp_path / "a.exr")
    with OpenEXR.File(str(tmp_path / "a.exr"), separate_channels=True) as file:
        channels = {name: channel.pixels for name, channel in file.channels().items()}
        assert file.header()["compression"] == OpenEXR.ZIP_COMPRESSION
    assert {"R", "G", "B", "direct.R", "depth.Z", "normal.X", "albedo.B", "cell.Y"} <= set(channels)
    assert same_bits(channels["G"], np.ascontiguousarray(image.pixels[..., 1]))
    assert same_bits(channels["normal.Z"], np.ascontiguousarray(image.layers["normal"][..., 2]))


@pytest.mark.parametrize("channel", ["RGB", "RGBA"])
@pytest.mark.parametrize("dtype", [np.float16, np.float32])
def test_exr_of_other_renderers(channel: str, dtype: type, tmp_path: Path) -> None:
    pixels = np.random.default_rng(2).uniform(0, 4, (HEIGHT, WIDTH, len(channel))).astype(dtype)
    header = {"compression": OpenEXR.PIZ_COMPRESSION, "type": OpenEXR.scanlineimage, "wdpm": "not ours"}
    with OpenEXR.File(header, {channel: pixels, "N": pixels[..., 0].copy()}) as file:
        file.write(str(tmp_path / "a.exr"))
    back = load(tmp_path / "a.exr")
    assert same_bits(back.pixels, pixels[..., :3].astype(np.float32))
    assert list(back.layers) == ["beauty"]
    assert back.metadata == {}


def test_grey_exr_is_repeated_and_one_without_colour_names_its_channels(tmp_path: Path) -> None:
    plane = np.random.default_rng(3).uniform(0, 4, (HEIGHT, WIDTH)).astype(np.float32)
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    for name in ("Y", "depth.Z"):
        with OpenEXR.File(header, {name: plane.copy()}) as file:
            file.write(str(tmp_path / f"{name}.exr"))
    assert same_bits(load(tmp_path / "Y.exr").pixels, np.stack([plane] * 3, axis=-1))
    with pytest.raises(ImageError, match=r"no channels R, G, B \(it has depth\.Z\)"):
        load(tmp_path / "depth.Z.exr")


def test_metadata_that_json_cannot_hold_is_refused(image: Image, tmp_path: Path) -> None:
    with pytest.raises(ImageError, match="metadata cannot be written as JSON"):
        Image(image.layers, {"report": object()}).save(tmp_path / "a.exr")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.shared
def test_reference_of_another_renderer(scenes_dir: Path) -> None:
    reference = load(scenes_dir / "cbox" / "reference.exr")
    assert reference.shape == (256, 256)
    assert reference.pixels.max() > 1


def test_png_is_srgb(tmp_path: Path) -> None:
    pixels = np.array([[[0, 0.5, 1], [0.0031308, 0.2158605, 7], [-1, np.inf, 0.001]]], dtype=np.float32)
    Image({"beauty": pixels}).save(tmp_path / "a.png")
    with PIL.Image.open(tmp_path / "a.png") as file:
        written = np.asarray(file)
    # IEC 61966-2-1: the linear part ends at 0.0031308 (10.3 of 255); 0.2158605 is 128/255 encoded.
    assert written.tolist() == [[[0, 188, 255], [10, 128, 255], [0, 255, 3]]]


def test_every_8_bit_colour_survives_png_and_linear_light(tmp_path: Path) -> None:
    levels = np.arange(256, dtype=np.uint8).reshape(16, 16)
    (tmp_path / "a.png").write_bytes(png_bytes(np.stack([levels, levels.T, 255 - levels], axis=-1)))
    back = load(tmp_path / "a.png")
    assert np.array_equal(encode_srgb8(back.pixels)[..., 0], levels)
    assert np.array_equal(back.to_srgb8()[..., 2], 255 - levels)


@pytest.mark.parametrize("mode", ["L", "LA", "RGB", "RGBA"])
def test_kinds_of_png(mode: str, tmp_path: Path) -> None:
    PIL.Image.new(mode, (5, 4), 255 if mode == "L" else (255,) * len(mode)).save(tmp_path / "a.png")
    assert np.array_equal(load(tmp_path / "a.png").pixels, np.ones((4, 5, 3), dtype=np.float32))


def test_transparent_png_is_refused(tmp_path: Path) -> None:
    PIL.Image.new("RGBA", (5, 4), (255, 255, 255, 254)).save(tmp_path / "a.png")
    with pytest.raises(ImageError, match="partly transparent"):
        load(tmp_path / "a.png")


def test_a_notebook_gets_a_png(image: Image) -> None:
    with PIL.Image.open(io.BytesIO(image._repr_png_())) as file:
        assert np.array_equal(np.asarray(file), image.to_srgb8())


def test_pfm_is_written_from_the_bottom_in_little_endian(tmp_path: Path) -> None:
    pixels = np.array([[[1, 2, 3]], [[4, 5, 6]]], dtype=np.float32)
    Image({"beauty": pixels}).save(tmp_path / "a.pfm")
    assert (tmp_path / "a.pfm").read_bytes() == b"PF\n1 2\n-1.0\n" + np.array([4, 5, 6, 1, 2, 3], "<f4").tobytes()


def test_big_endian_and_grey_pfm(tmp_path: Path) -> None:
    (tmp_path / "a.pfm").write_bytes(b"Pf\n2 1\n1.0\n" + np.array([0.25, 8], ">f4").tobytes())
    assert load(tmp_path / "a.pfm").pixels.tolist() == [[[0.25] * 3, [8.0] * 3]]


def test_hdr_bytes_of_known_colours() -> None:
    # 1 = 128/256 * 2^1, so its exponent byte is 128 + 1; width 2 is too narrow for run lengths.
    pixels = np.array([[[1, 0.5, 0.25], [0, 0, 0]]], dtype=np.float32)
    expected = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 2\n" + bytes([128, 64, 32, 129, 0, 0, 0, 0])
    assert encode_hdr(pixels) == expected
    assert np.array_equal(decode_hdr(expected, "a.hdr"), pixels)


def test_hdr_of_another_program_with_runs_and_exposure() -> None:
    row = b"\x02\x02\x00\x09" + b"".join(bytes([130, v, 7, *[v] * 7]) for v in (128, 64, 32)) + bytes([137, 129])
    data = b"#?RADIANCE\n# made by hand\nEXPOSURE=2.0\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 9\n" + row
    assert decode_hdr(data, "a.hdr").tolist() == [[[0.5, 0.25, 0.125]] * 9]


positive = st.floats(min_value=0, max_value=float(np.float32(1.6e38)), width=32)


@given(st.lists(st.tuples(positive, positive, positive), min_size=1, max_size=8))
def test_rgbe_is_within_half_a_step(colours: list[tuple[float, float, float]]) -> None:
    pixels = np.array(colours, dtype=np.float32)
    back = rgbe_to_float(float_to_rgbe(pixels)).astype(np.float64)
    # One step is 1/256 of the power of two above the largest channel, at most 1/128 of it; below 2^-128 all is black.
    assert (np.abs(back - pixels) <= pixels.max(axis=1, keepdims=True) / 256 + 2.0**-128).all()


def test_rgbe_rounds_up_into_the_next_exponent() -> None:
    just_below_one = np.nextafter(np.float32(1), np.float32(0))
    assert float_to_rgbe(np.array([just_below_one, 0, 0], dtype=np.float32)).tolist() == [128, 0, 0, 129]
    assert rgbe_to_float(float_to_rgbe(np.array([3.4e38, 0, 0], dtype=np.float32)))[0] > 1.6e38


@given(st.lists(st.tuples(st.integers(1, 200), st.sampled_from([0.0, 0.5, 1.0])), min_size=1, max_size=12))
def test_run_lengths_of_any_shape(runs: list[tuple[int, float]]) -> None:
    row = np.concatenate([np.full(length, value, dtype=np.float32) for length, value in runs])
    pixels = np.stack([row, np.ones_like(row), row[::-1]], axis=-1)[None]
    assert np.array_equal(decode_hdr(encode_hdr(pixels), "a.hdr"), pixels)


def test_hdr_of_noise(image: Image, tmp_path: Path) -> None:
    image.save(tmp_path / "a.hdr")
    back = load(tmp_path / "a.hdr").pixels
    assert (np.abs(back - image.pixels) <= image.pixels.max(axis=2, keepdims=True) / 256).all()
    assert abs(float(back.mean()) / float(image.pixels.mean()) - 1) < 1e-4  # rounded, not cut off


@pytest.mark.parametrize("value", [np.nan, np.inf, -1.0])
def test_hdr_refuses_what_it_cannot_hold(value: float, tmp_path: Path) -> None:
    pixels = np.ones((2, 9, 3), dtype=np.float32)
    pixels[1, 2, 0] = value
    with pytest.raises(ImageError, match=r"a\.hdr: 1 pixels are negative or not finite.*\.exr"):
        Image({"beauty": pixels}).save(tmp_path / "a.hdr")


def test_png_refuses_nan(tmp_path: Path) -> None:
    with pytest.raises(ImageError, match=r"a\.png: 1 pixels are NaN.*\.exr"):
        Image({"beauty": np.full((1, 1, 3), np.nan, dtype=np.float32)}).save(tmp_path / "a.png")


@pytest.mark.parametrize("extension", EVERY_FORMAT)
@pytest.mark.parametrize("share", [0.0, 0.01, 0.3, 0.9])
def test_a_truncated_file_is_one_line(
    extension: str, share: float, image: Image, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / f"a{extension}"
    image.save(path)
    data = path.read_bytes()
    path.write_bytes(data[: int(len(data) * share)])
    with pytest.raises(ImageError) as caught:
        load(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)
    assert capfd.readouterr() == ("", "")  # the libraries' own words are in the message, if anywhere


@pytest.mark.parametrize("extension", EVERY_FORMAT)
def test_a_file_of_something_else_is_one_line(extension: str, tmp_path: Path) -> None:
    path = tmp_path / f"a{extension}"
    path.write_bytes(b"<html>404 not found</html>" * 9)
    with pytest.raises(ImageError, match=r"^[^\n]*$"):
        load(path)


@pytest.mark.parametrize(
    ("name", "data", "message"),
    [
        ("a.exr", b"", "is empty"),
        ("a.npy", b"", "is empty"),
        ("a.exr", b"some text", "not an OpenEXR file"),
        ("a.npy", b"some text", "not an NPY file"),
        ("a.npy", b"PK\x03\x04", "not an NPY file"),
    ],
)
def test_what_a_file_is_not(name: str, data: bytes, message: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_bytes(data)
    with pytest.raises(ImageError) as caught:
        load(path)
    assert str(caught.value) == f"{path}: {message}"


@pytest.mark.parametrize("at", range(6, 128))
def test_a_changed_header_of_an_npy_is_an_image_error(at: int, image: Image, tmp_path: Path) -> None:
    path = tmp_path / "a.npy"
    image.save(path)
    data = bytearray(path.read_bytes())
    for value in b"('\n9\xff":
        data[at] = value
        path.write_bytes(data)
        with contextlib.suppress(ImageError):  # the only error; some changes are of no consequence
            load(path)


def test_corrupt_pixels_of_an_exr(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "a.exr"
    Image({"beauty": np.ones((HEIGHT, WIDTH, 3), dtype=np.float32)}).save(path)  # compresses, unlike noise
    data = bytearray(path.read_bytes())
    data[-30:-10] = b"\x55" * 20
    path.write_bytes(data)
    with pytest.raises(ImageError, match="not a whole OpenEXR file: "):
        load(path)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("array", "found"),
    [
        (np.zeros((4, 4)), "float64 of shape"),
        (np.zeros((4, 4, 3), dtype=np.uint8), "uint8"),
        (np.array([object()]), "object of shape"),
        (np.array([[[object()] * 3]]), "object of shape"),
    ],
)
def test_npy_of_another_kind(array: np.ndarray, found: str, tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", array, allow_pickle=True)
    with pytest.raises(ImageError, match=found):
        load(tmp_path / "a.npy")


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"#?RADIANCE\nFORMAT=32-bit_rle_xyze\n\n-Y 1 +X 1\n\x80\x80\x80\x81", "XYZ"),
        (b"#?RADIANCE\n\n+Y 1 +X 1\n\x80\x80\x80\x81", "top to bottom"),
        (b"#?RADIANCE\n\n-Y 1 +X 2\n\x80\x80\x80\x81\x01\x01\x01\x01", "before 1991"),
        (b"#?RADIANCE\n\n-Y 1 +X 8\n\x02\x02\x00\x08\xff\x00", "does not fit"),
        (b"#?RADIANCE\n\n-Y 1 +X 8\n\x02\x02\x00\x08\x00\x00", "does not fit"),
    ],
)
def test_hdr_that_is_not_read(data: bytes, message: str) -> None:
    with pytest.raises(ImageError, match=message):
        decode_hdr(data, "a.hdr")


def test_names_without_a_known_extension(image: Image, tmp_path: Path) -> None:
    with pytest.raises(ImageError, match=r"unknown extension '\.bmp': must be one of \.exr \.png \.hdr \.pfm \.npy"):
        image.save(tmp_path / "a.bmp")
    with pytest.raises(ImageError, match="has no extension"):
        check_output_path(tmp_path / "a")
    with pytest.raises(ImageError, match="no such file"):
        load(tmp_path / "a.exr")
    with pytest.raises(ImageError, match="unknown extension"):
        check_output_path(tmp_path / "a.exr", (".json",))


def test_capital_extensions(image: Image, tmp_path: Path) -> None:
    image.save(tmp_path / "A.EXR")
    assert load(tmp_path / "A.EXR").digest() == image.digest()


def test_output_path_is_checked_and_left_as_it_was(tmp_path: Path) -> None:
    assert check_output_path(tmp_path / "a.exr") == tmp_path / "a.exr"
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "b.exr").write_bytes(b"old")
    check_output_path(tmp_path / "b.exr")
    assert (tmp_path / "b.exr").read_bytes() == b"old"


def test_output_paths_that_cannot_be_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "folder.exr").mkdir()
    with pytest.raises(ImageError, match="is a folder"):
        check_output_path(tmp_path / "folder.exr")
    with pytest.raises(ImageError, match=r"there is no folder .*: make it first"):
        check_output_path(tmp_path / "nowhere" / "a.exr")

    def refuse(self: Path, **_: object) -> None:
        raise PermissionError(13, "Permission denied", str(self))

    monkeypatch.setattr(Path, "touch", refuse)  # the superuser, who runs many CIs, may write to any folder
    with pytest.raises(ImageError, match=r"a\.exr: cannot be written: permission denied"):
        check_output_path(tmp_path / "a.exr")


def test_a_link_that_leads_back_to_itself_is_a_name_like_any_other(tmp_path: Path) -> None:
    loop = tmp_path / "loop.exr"
    loop.symlink_to(loop)
    check_apart([("the image", loop), ("the log", tmp_path / "log")])
    with pytest.raises(ImageError, match="cannot hold both the image and the log"):
        check_apart([("the image", loop), ("the log", loop)])


def test_a_link_stays_and_what_it_leads_to_is_written(image: Image, tmp_path: Path) -> None:
    (tmp_path / "disk").mkdir()
    (tmp_path / "disk" / "old.png").write_bytes(b"old")
    for name in ("old.png", "new.png"):
        link = tmp_path / name
        link.symlink_to(Path("disk") / name)
        check_output_path(link)
        image.save(link)
        assert link.is_symlink()
        assert load(tmp_path / "disk" / name).pixels.shape == image.pixels.shape
    assert sorted(path.name for path in (tmp_path / "disk").iterdir()) == ["new.png", "old.png"]
    (tmp_path / "lost.png").symlink_to(tmp_path / "nowhere" / "a.png")
    with pytest.raises(ImageError, match=r"there is no folder .*nowhere: make it first"):
        check_output_path(tmp_path / "lost.png")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")
def test_a_pipe_is_not_replaced(tmp_path: Path) -> None:
    """Whoever reads from it would wait for ever."""
    os.mkfifo(tmp_path / "pipe.exr")
    with pytest.raises(ImageError, match=r"pipe\.exr: is no file but a device, a pipe or a socket"):
        check_output_path(tmp_path / "pipe.exr")


@pytest.mark.parametrize("extension", EVERY_FORMAT)
def test_a_failed_write_leaves_the_old_file(
    extension: str, image: Image, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / f"a{extension}"
    path.write_bytes(b"old")

    def full(_: Path, target: Path) -> None:
        raise OSError(28, "No space left on device", str(target))

    monkeypatch.setattr(Path, "replace", full)
    with pytest.raises(ImageError, match="cannot be written: no space left on device"):
        image.save(path)
    assert [p.name for p in tmp_path.iterdir()] == [path.name]
    assert path.read_bytes() == b"old"


@pytest.mark.parametrize("extension", EVERY_FORMAT)
def test_why_a_write_failed_names_no_file_that_nobody_knows(extension: str, image: Image, tmp_path: Path) -> None:
    """OpenEXR's own words have the name of the file beside the place, which is moved there when it is whole."""
    path = tmp_path / "nowhere" / f"a{extension}"
    with pytest.raises(NotWrittenError) as raised:
        image.save(path)
    assert str(raised.value) == f"{path}: cannot be written: no such file or directory"


def test_a_written_file_can_be_read_by_others(image: Image, tmp_path: Path) -> None:
    (tmp_path / "plain").touch()
    image.save(tmp_path / "a.png")
    assert (tmp_path / "a.png").stat().st_mode == (tmp_path / "plain").stat().st_mode


def test_the_digest_sees_every_bit_name_and_shape(image: Image) -> None:
    digest = image.digest()
    assert Image(dict(reversed(image.layers.items()))).digest() == digest  # neither order nor metadata
    changed = {name: layer.copy() for name, layer in image.layers.items()}
    changed["depth"][0, 1] = 0.0  # was -0
    assert Image(changed).digest() != digest
    fewer = {name: layer for name, layer in image.layers.items() if name != "depth"}
    assert Image(fewer).digest() != digest
    elsewhere = {name: layer + 1 if name == "cell" else layer for name, layer in image.layers.items()}
    assert Image(elsewhere).digest() == digest  # `cell` shows the cluster, not the scene
    wide, tall = np.zeros((1, 2, 3), np.float32), np.zeros((2, 1, 3), np.float32)
    assert Image({"beauty": wide}).digest() != Image({"beauty": tall}).digest()


@pytest.mark.parametrize(
    ("layers", "message"),
    [
        ({}, "needs a layer 'beauty'"),
        ({"beauty": np.zeros((2, 2, 3))}, "must be float32"),
        ({"beauty": np.zeros((2, 2), np.float32)}, "must be float32 of shape"),
        ({"beauty": np.zeros((0, 2, 3), np.float32)}, "at least one pixel"),
        ({"beauty": np.zeros((2, 2, 3), np.float32), "depth": np.zeros((2, 3), np.float32)}, "layer 'depth'"),
        ({"beauty": np.zeros((2, 2, 3), np.float32), "gloss": np.zeros((2, 2), np.float32)}, "unknown layer 'gloss'"),
    ],
)
def test_layers_that_are_no_image(layers: dict[str, np.ndarray], message: str) -> None:
    with pytest.raises(ImageError, match=message):
        Image(layers)


def test_what_a_killed_process_left_half_written_goes_at_the_next_run(tmp_path: Path) -> None:
    with subprocess.Popen([sys.executable, "-c", ""]) as ended:
        ended.wait()
    node = platform.node() or "unknown"
    left = tmp_path / f".a.exr.{node}.{ended.pid}.0123456789ab.part"
    stays = [
        tmp_path / f".a.exr.{node}.{os.getpid()}.0123456789ab.part",  # of a process that runs
        tmp_path / f".a.exr.another-machine.{ended.pid}.0123456789ab.part",
        tmp_path / f".b.exr.{node}.{ended.pid}.0123456789ab.part",
    ]
    for path in (left, *stays):
        path.touch()
    check_place(tmp_path / "a.exr")
    assert sorted(tmp_path.iterdir()) == sorted(stays)


def test_an_exr_file_has_the_same_bytes_however_many_threads_compress_it(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    image = Image({"beauty": rng.random((150, 40, 3), np.float32), "depth": rng.random((150, 40), np.float32)}, {})
    files = [tmp_path / f"{threads}.exr" for threads in (1, 2, 7)]
    for threads, file in zip((1, 2, 7), files, strict=True):
        image.save(file, threads=threads)
    assert len({file.read_bytes() for file in files}) == 1


def test_a_folder_for_temporary_files_that_is_gone_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    Image({"beauty": np.ones((2, 3, 3), np.float32)}).save(tmp_path / "a.exr")
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "gone"))
    with pytest.raises(ImageError, match=r"no temporary file can be written \(No such file or directory\); set TMPDIR"):
        load(tmp_path / "a.exr")
