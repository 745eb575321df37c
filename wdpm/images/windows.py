"""Which pixels of a whole image an image has, and what keeps two from being held against each other."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from wdpm.images.image import Image

SCREEN = ".png"
"""What files that hold pictures for screens end with; all others hold radiance."""


@dataclass(frozen=True)
class Window:
    """Pixels left <= x < right, top <= y < bottom of a whole image of width x height."""

    left: int
    top: int
    right: int
    bottom: int
    width: int
    height: int

    def __str__(self) -> str:
        return f"{self.left},{self.top},{self.right},{self.bottom} of {self.width}x{self.height}"


def window_of(image: Image) -> Window | None:
    """Which pixels of the whole a crop has; None for a whole image, and for one that does not say."""
    crop, whole = _integers(image, "crop", 4), _integers(image, "full_size", 2)
    if crop is None or whole is None or whole == crop[2:]:
        return None
    left, top, width, height = crop
    if (height, width) != image.shape:
        return None
    return Window(left, top, left + width, top + height, *whole)


def same_part(a: Image, b: Image) -> tuple[Image, Image, str | None]:
    """Both images, and if one is a crop of as large an image as the other, of the other the same part.

    Returns:
        The images, and what was cut in a line; None for nothing.
    """
    for first, second, cut, other in ((a, b, "B", "A"), (b, a, "A", "B")):
        window = window_of(first)
        if window is None or second.shape != (window.height, window.width) or window_of(second) is not None:
            continue
        part = _part(second, window)
        line = f"{other} is the part {window}, and is compared with that part of {cut}"
        return (a, part, line) if second is b else (part, b, line)
    return a, b, None


def doubts(a: Image, b: Image, path_a: Path, path_b: Path) -> list[str]:
    """Why figures of two images may not be what a person takes them for, in lines."""
    found = []
    screens = [path.suffix.lower() == SCREEN for path in (path_a, path_b)]
    if screens[0] != screens[1]:
        screen, light = ("A", "B") if screens[0] else ("B", "A")
        found.append(
            f"{screen} is a PNG, which has what a screen shows (8 bits, none above white, after exposure and view "
            f"transform), and {light} has radiance: figures of light tell little of the two"
        )
    windows = window_of(a), window_of(b)
    if windows[0] != windows[1]:
        words = ["a whole image" if window is None else f"the part {window}" for window in windows]
        if all("camera" in image.metadata for image in (a, b)):
            found.append(f"A is {words[0]}, B is {words[1]}: these are not the same pixels")
    elif _view(a) is not None and _view(b) is not None and _view(a) != _view(b):
        found.append("A and B were seen from elsewhere: their files name different cameras")
    return found


def _part(image: Image, window: Window) -> Image:
    rows, columns = slice(window.top, window.bottom), slice(window.left, window.right)
    layers = {name: layer[rows, columns].copy() for name, layer in image.layers.items()}
    metadata = dict(image.metadata)
    if isinstance(camera := metadata.get("camera"), dict):
        crop = [window.left, window.top, window.right - window.left, window.bottom - window.top]
        metadata["camera"] = {**camera, "crop": crop, "full_size": [window.width, window.height]}
    return replace(image, layers=layers, metadata=metadata)


def _view(image: Image) -> Any:
    """Where the camera stands, and how wide it sees; None where the file does not say."""
    camera = image.metadata.get("camera")
    return [camera.get(name) for name in ("to_world", "fov")] if isinstance(camera, dict) else None


def _integers(image: Image, name: str, count: int) -> list[int] | None:
    """Of the camera in an image's header, `count` whole numbers; None where there is nothing of the kind."""
    camera = image.metadata.get("camera")
    found = camera.get(name) if isinstance(camera, dict) else None
    whole = isinstance(found, list) and len(found) == count and all(isinstance(number, int) for number in found)
    return list(found) if whole and found is not None else None
