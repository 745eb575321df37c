"""Reads files of voxels: Mitsuba's .vol, and NumPy's .npy and .npz."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wdpm.scenes.volume_files.vol import Voxels, decode_vol


def read_voxels(file: Path) -> Voxels:
    """The voxels of a file.

    Raises:
        ValueError: it cannot be read; says why.
    """
    suffix = file.suffix.lower()
    if suffix in (".npy", ".npz"):
        return Voxels(_from_numpy(file))
    if suffix in (".vdb", ".nvdb"):
        raise ValueError("OpenVDB files are not read; convert it to .npy or .vol first (docs/scenes.md says how)")
    try:
        return decode_vol(file.read_bytes())
    except OSError as error:
        raise ValueError(f"it cannot be read: {error.strerror}") from error


def _from_numpy(file: Path) -> NDArray[np.float32]:
    """Shape [z, y, x, channels]."""
    arrays = _load(file)
    if len(arrays) != 1:
        raise ValueError(f"{len(arrays)} arrays ({', '.join(arrays)}); expected one")
    (array,) = arrays.values()
    if array.dtype.kind not in "fiu" or array.ndim not in (3, 4) or array.size == 0:
        raise ValueError(f"an array of {array.dtype} and shape {list(array.shape)}; expected numbers, [z, y, x]")
    array = array[..., None] if array.ndim == 3 else array
    if array.shape[3] not in (1, 3):
        raise ValueError(f"{array.shape[3]} channels; expected 1 or 3")
    with np.errstate(over="ignore"):  # what is too large for a float32 is found with what is not finite
        values: NDArray[np.float32] = array.astype(np.float32)
    return values * np.float32(1.0 / 255.0) if array.dtype == np.uint8 else values


def _load(file: Path) -> dict[str, NDArray[Any]]:
    """The arrays of a file by name; one without a name in an .npy file. Nothing is unpickled."""
    try:
        with file.open("rb") as opened:
            loaded = np.load(opened, allow_pickle=False)
            return {"": loaded} if isinstance(loaded, np.ndarray) else dict(loaded)
    except (OSError, EOFError, ValueError, zipfile.BadZipFile) as error:
        raise ValueError(f"it is no array of NumPy: {error}") from error
