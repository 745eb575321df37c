"""Image textures over the wire: a fourth of the bytes where values are of 8 bits, and the same bits."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from wdpm.cluster.messages.packing import decode, encode
from wdpm.cluster.messages.short_bitmaps import MOST_COLOURS, SOME, ShortBitmap, lengthen, shorten
from wdpm.scenes.errors import ProtocolError
from wdpm.scenes.images.read import srgb_to_linear
from wdpm.scenes.model.textures import Bitmap, Interpolation, Wrap

NUMBERS = np.random.default_rng(8).integers(0, 256, (60, 70, 3))
SHARES = np.arange(256, dtype=np.float32) / np.float32(255)
FLOATS = np.random.default_rng(9).normal(size=(60, 70, 3)).astype(np.float32)


@dataclass(frozen=True, eq=False)
class Told:
    """A message of a texture alone."""

    texture: Bitmap


def size(frames: list[Any]) -> int:
    return sum(memoryview(frame).nbytes for frame in frames)


def rare(value: float) -> NDArray[np.float32]:
    """A value that the first look passes by."""
    pixels = np.zeros((60, 70, 3), np.float32)
    pixels.reshape(-1)[SOME + 1] = value
    return pixels


ALIKE = rare(float(np.nextafter(np.float32(1.0), np.float32(2.0))))
ALIKE[0, 0] = 1.0


@pytest.mark.parametrize(
    ("pixels", "shorter"),
    [
        (srgb_to_linear(SHARES)[NUMBERS], True),
        (SHARES[NUMBERS], True),
        (rare(0.7), True),
        (rare(-0.0), True),
        (ALIKE, False),
        (FLOATS, False),
        (FLOATS[:2], False),
        (SHARES[NUMBERS[:2, :5]], False),
    ],
)
def test_textures_come_with_the_same_bits(pixels: NDArray[np.float32], shorter: bool) -> None:
    texture = Bitmap("wall", pixels, Wrap.MIRROR, Interpolation.NEAREST, np.diag([2.0, 3.0, 1.0]))
    frames = encode(Told(texture))
    came = decode([bytes(frame) for frame in frames], {"Told": Told}).texture
    assert came.pixels.tobytes() == texture.pixels.tobytes()
    assert (came.pixels.shape, came.pixels.dtype) == (pixels.shape, np.float32)
    assert (came.name, came.wrap, came.interpolation) == ("wall", Wrap.MIRROR, Interpolation.NEAREST)
    np.testing.assert_array_equal(came.to_uv, texture.to_uv)
    assert size(frames) < (pixels.nbytes / 4 + 4 * MOST_COLOURS if shorter else pixels.nbytes) + 400
    assert len(shorten(texture).palette) > 0 if shorter else shorten(texture).pixels is texture.pixels


def test_a_texture_is_shortened_once_for_all_receivers() -> None:
    texture = Bitmap("wall", SHARES[NUMBERS])
    assert shorten(texture).pixels is shorten(texture).pixels


@pytest.mark.parametrize(
    ("palette", "pixels", "error"),
    [
        (SHARES[:255], NUMBERS.astype(np.uint8), "pixels that its palette of 255 does not"),
        (np.linspace(0, 1, 257, dtype=np.float32), NUMBERS.astype(np.uint8), "its palette of 257"),
        (SHARES[:0], NUMBERS.astype(np.uint8), "pixels of uint8 and a palette of 0"),
        (SHARES, FLOATS, "pixels of float32 and a palette of 256"),
        (SHARES[:0], FLOATS.astype(np.float64), "pixels of float64"),
    ],
)
def test_what_is_no_texture_is_refused(palette: NDArray[np.float32], pixels: NDArray[Any], error: str) -> None:
    short = ShortBitmap("wall", palette, pixels, Wrap.REPEAT, Interpolation.BILINEAR, np.eye(3), tinted=False)
    with pytest.raises(ProtocolError, match=error):
        lengthen(short, "there")
