"""A rendered image: its layers, and what was known when it was made."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from numbers import Integral
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from wdpm.images import files
from wdpm.images.channels import LAYER_CHANNELS, PARTITION_LAYER, Layers
from wdpm.images.view_transform import LOOK, Look, ViewTransform, look_in, look_of, shown_pixels
from wdpm.scenes.errors import ImageError

if TYPE_CHECKING:
    from wdpm.report.notebook import NotebookReport


@dataclass(frozen=True, eq=False, repr=False)
class Image:
    """An image with its layers. Row 0 is the top.

    Attributes:
        layers: float32 arrays of one size, by name: shape [height, width, 3], or [height, width] for `depth` and
            `cell`. `beauty`, linear RGB radiance [W/(m² sr)], is always there.
        metadata: what goes into the header of an EXR file, such as `settings` and `report`, as JSON has it.

    Raises:
        ImageError: a layer is missing, unknown, or of the wrong type or shape.
    """

    layers: Layers
    metadata: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for what, given in (("layers", self.layers), ("metadata", self.metadata)):
            if not isinstance(given, Mapping):
                raise ImageError(f"an image's {what} are {given!r:.80}; expected a dictionary, by name")
        if "beauty" not in self.layers:
            raise ImageError(f"an image needs a layer 'beauty' (got {', '.join(map(str, self.layers)) or 'no layer'})")
        for name, layer in self.layers.items():
            if not isinstance(layer, np.ndarray) or layer.ndim < 2:
                raise ImageError(f"layer '{name}' must be a float32 array of shape (height, width, ...)")
        height, width = self.layers["beauty"].shape[:2]
        for name, layer in self.layers.items():
            if name not in LAYER_CHANNELS:
                raise ImageError(f"unknown layer '{name}': must be one of {', '.join(LAYER_CHANNELS)}")
            expected = (height, width, 3) if len(LAYER_CHANNELS[name]) == 3 else (height, width)
            if layer.shape != expected or layer.dtype != np.float32:
                raise ImageError(
                    f"layer '{name}' must be float32 of shape {expected} (got {layer.dtype} of shape {layer.shape})"
                )
        if height == 0 or width == 0:
            raise ImageError(f"an image needs at least one pixel (got {width}x{height})")

    def __repr__(self) -> str:
        """One line, not all pixels and the report, which a prompt would print and a notebook keep."""
        height, width = self.shape
        return f"<Image {width}x{height}: {', '.join(self.layers)}>"

    @property
    def pixels(self) -> NDArray[np.float32]:
        """The beauty layer: linear RGB, shape [height, width, 3]."""
        return self.layers["beauty"]

    @property
    def shape(self) -> tuple[int, int]:
        """(height, width)."""
        height, width = self.pixels.shape[:2]
        return height, width

    @property
    def report(self) -> NotebookReport:
        """What the render told of itself, which a notebook shows as tables.

        Raises:
            ImageError: the image has no report, as other programs' have not, or one of another version.
        """
        from wdpm.report.notebook import notebook_report  # only for those who look

        if "report" not in self.metadata:
            raise ImageError("the image has no report: it is not wdpm's, or was saved in a format that keeps none")
        return notebook_report(self.metadata["report"])

    @property
    def look(self) -> Look:
        """How a screen is to show it: what its metadata says, or else as it is."""
        return look_in(self.metadata)

    def looking(self, exposure: float | str | None = None, view_transform: ViewTransform | str | None = None) -> Image:
        """The same image with another look in its metadata; no pixel changes.

        Args:
            exposure: stops, or "auto", which is worked out now; None for what it has.
            view_transform: standard, filmic, agx or neutral; None for what it has.

        Raises:
            ImageError: there is no such exposure or transform.
        """
        look = look_of(exposure, view_transform, self.look).resolved(self.pixels)
        return replace(self, metadata={**self.metadata, LOOK: look.to_dict()})

    def to_srgb8(
        self, exposure: float | str | None = None, view_transform: ViewTransform | str | None = None
    ) -> NDArray[np.uint8]:
        """The beauty layer as a screen shows it: sRGB, 8 bits, shape [height, width, 3].

        Args:
            exposure, view_transform: see `looking`.

        Raises:
            ImageError: a pixel is NaN, or there is no such exposure or transform.
        """
        return shown_pixels(self.pixels, look_of(exposure, view_transform, self.look))

    def digest(self) -> str:
        """SHA-256 of names, shapes and bytes of all layers but `cell`, in hexadecimal: equal iff every bit of them is.

        `cell` shows which part of a cluster shaded a pixel: it is the one layer that depends on who computed the image.
        """
        sha = hashlib.sha256()
        for name in sorted(self.layers.keys() - {PARTITION_LAYER}):
            layer = np.ascontiguousarray(self.layers[name], dtype="<f4")
            sha.update(f"{name} {layer.shape}\n".encode())
            sha.update(layer.data)
        return sha.hexdigest()

    def save(
        self,
        path: str | PathLike[str],
        *,
        exposure: float | str | None = None,
        view_transform: ViewTransform | str | None = None,
        threads: int = 1,
    ) -> None:
        """Write a file of the format that the extension names: .exr (all layers), or .png, .hdr, .pfm, .npy (beauty).

        The file appears whole or not at all. All but PNG hold radiance, whatever the exposure; EXR names it in its
        header.

        Args:
            exposure, view_transform: how a PNG is to look, see `looking`; None for what the image says.
            threads: that compress an EXR file, which has the same bytes with any number.

        Raises:
            ImageError: unknown extension, a folder that cannot be written, pixels that the format cannot hold, or no
                such exposure or transform.
        """
        given = exposure is not None or view_transform is not None
        metadata: Mapping[str, Any] = self.looking(exposure, view_transform).metadata if given else self.metadata
        if not isinstance(threads, Integral) or threads < 1:
            raise ImageError(f"threads is {threads!r}; expected a whole number of at least 1")
        files.write(self.layers, metadata, files.path_of(path), int(threads))

    def _repr_png_(self) -> bytes:
        """What a notebook shows."""
        return files.png_bytes(self.to_srgb8())


def load(path: str | PathLike[str]) -> Image:
    """Read an image file: .exr, .png, .hdr, .pfm or .npy, by this or another program.

    Raises:
        ImageError: unknown extension, missing or broken file.
    """
    layers, metadata = files.read(files.path_of(path))
    return Image(layers, metadata)
