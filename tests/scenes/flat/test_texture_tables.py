"""Whole numbers of pictures are looked up: what is found is what the formula gives."""

from __future__ import annotations

import numpy as np
import pytest

from wdpm.scenes.images.read import linear_pixels, srgb_to_linear


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.uint32])
@pytest.mark.parametrize("channels", [1, 3, 4])
def test_the_table_holds_what_the_formula_gives(dtype: type[np.unsignedinteger], channels: int) -> None:
    most = np.iinfo(dtype).max
    levels = np.linspace(0, most, min(most, 65535) + 1).astype(dtype)
    pixels = np.repeat(levels, channels).reshape(-1, 16, channels)
    shares = pixels.astype(np.float32) / np.float32(most)
    expected = srgb_to_linear(shares[:, :, :3] if channels > 1 else np.repeat(shares, 3, axis=2))
    found = linear_pixels(pixels, "picture")
    assert found.dtype == np.float32
    np.testing.assert_array_equal(found.view(np.uint32), expected.view(np.uint32))
