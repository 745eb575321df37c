"""EXR files of other programs, and broken ones: whatever their headers hold, they are read or refused in a line."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import OpenEXR
import pytest

pytestmark = pytest.mark.processes

ODD = {
    "value": (b"MXller", b"M\xfcller", True),
    "name of an attribute": (b"owner\0string", b"\xfcwner\0string", True),
    "type of an attribute": (b"owner\0string", b"owner\0\xfctring", True),
    "name of a channel": (b"depth.Z\0", b"depth.\xfc\0", True),
    "size of a value": (b"dataWindow\0box2i\0\x10", b"dataWindow\0box2i\0\x0f", False),
    "no size": (b"dataWindow\0box2i", b"dataWindoz\0box2i", False),
    "longer than the file": (b"owner\0string\0\x06\0\0\0", b"owner\0string\0\x06\0\0\x7f", False),
    "a name without end": (b"owner\0", b"owner" + bytes([65]) * 300, False),
}


@pytest.mark.parametrize(("before", "after", "fine"), ODD.values(), ids=list(ODD))
def test_an_exr_whose_header_is_odd_does_not_end_the_process(
    before: bytes, after: bytes, fine: bool, tmp_path: Path
) -> None:
    """OpenEXR's reader of headers for Python dies of names in Latin-1; of values of another size it may."""
    plain, odd = tmp_path / "plain.exr", tmp_path / "odd.exr"
    channels = {name: np.full((2, 3), 0.5, np.float32) for name in ("R", "G", "B", "depth.Z")}
    OpenEXR.File({"compression": OpenEXR.ZIP_COMPRESSION, "owner": "MXller"}, channels).write(str(plain))
    data = plain.read_bytes()
    assert data.count(before) == 1
    odd.write_bytes(data.replace(before, after))
    program = f"""
from wdpm.images.image import load
from wdpm.scenes.errors import ImageError
try:
    print(load({str(odd)!r}).pixels.shape)
except ImageError as error:
    print(error)
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == "(2, 3, 3)\n" if fine else f"{odd}: not a whole OpenEXR file: " in done.stdout
