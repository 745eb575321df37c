"""A picture with its scale in a strip below: a bar of its colours, and what their ends mean."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from PIL import Image as PillowImage
from PIL import ImageDraw, ImageFont

_HEIGHT = 34
_WIDTH = 256  # narrower pictures are put on a strip of this width
_MARGIN = 6
_BAR_HEIGHT = 8


def with_legend(
    picture: NDArray[np.uint8], colours: NDArray[np.uint8], low: str, middle: str, high: str
) -> NDArray[np.uint8]:
    """The picture above a strip with a bar.

    Args:
        picture: 8-bit sRGB, shape [height, width, 3].
        colours: of the bar from left to right, shape [n, 3].
        low, middle, high: words below the bar: left, in the middle, right.

    Returns:
        8-bit sRGB, shape [height + 34, max(width, 256), 3].
    """
    height, width = picture.shape[:2]
    canvas = PillowImage.new("RGB", (max(width, _WIDTH), height + _HEIGHT), (24, 24, 24))
    canvas.paste(PillowImage.fromarray(picture), ((canvas.width - width) // 2, 0))
    draw, font = ImageDraw.Draw(canvas), ImageFont.load_default(size=11)
    bar_width = canvas.width - 2 * _MARGIN
    bar = colours[np.linspace(0, len(colours) - 1, bar_width).round().astype(int)]
    canvas.paste(PillowImage.fromarray(bar[None].repeat(_BAR_HEIGHT, axis=0)), (_MARGIN, height + _MARGIN))
    text_y = height + _MARGIN + _BAR_HEIGHT + 1
    for text, x, anchor in (
        (low, _MARGIN, "la"),
        (middle, canvas.width // 2, "ma"),
        (high, canvas.width - _MARGIN, "ra"),
    ):
        draw.text((x, text_y), text, fill=(230, 230, 230), font=font, anchor=anchor)
    return np.asarray(canvas)
