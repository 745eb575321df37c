"""What kernels take of a GPU, as NVIDIA's assembler says: registers, spilled registers, local memory.

Warp's wheel compiles to PTX; the assembler `ptxas` comes with `pip install 'wdpm[cuda]'` or with a CUDA toolkit.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import tempfile
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

from wdpm.bench.gpu.names import plain_name
from wdpm.scenes.errors import WdpmError

_KERNEL = re.compile(
    r"Function properties for (\w+?)(?:_[0-9a-f]{6,})?_cuda_kernel_forward\s+"
    r"(\d+) bytes stack frame, (\d+) bytes spill stores, (\d+) bytes spill loads\s+"
    r"(?:ptxas info\s*: )?Used (\d+) registers"
)


@dataclass(frozen=True)
class Resources:
    """What a thread of one kernel takes.

    Attributes:
        local_bytes: local memory: arrays of the kernel, and spilled registers.
        spill_bytes: registers written to local memory, and read back.
    """

    kernel: str
    registers: int
    local_bytes: int
    spill_bytes: int


def find_ptxas() -> Path:
    """NVIDIA's assembler: that of the wheel nvidia-cuda-nvcc, or else of the PATH. Raises WdpmError without one."""
    try:
        files = metadata.files("nvidia-cuda-nvcc") or []
    except metadata.PackageNotFoundError:
        files = []
    for file in files:
        if file.name == "ptxas":
            return Path(str(file.locate()))
    found = shutil.which("ptxas")
    if found is None:
        raise WdpmError("ptxas, NVIDIA's assembler, is not on this machine: pip install 'wdpm[cuda]'")
    return Path(found)


def resources_of(ptx: str, architecture: int, ptxas: Path) -> list[Resources]:
    """What each kernel of a module takes.

    Raises:
        WdpmError: the assembler refused; an older one than the compiler's does not know its PTX.
    """
    with tempfile.TemporaryDirectory(prefix="wdpm-ptx-") as folder:
        source = Path(folder) / "module.ptx"
        source.write_text(ptx)
        command = [str(ptxas), "-v", f"-arch=sm_{architecture}", str(source), "-o", str(Path(folder) / "module.cubin")]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    said = done.stderr + done.stdout
    if done.returncode:
        raise WdpmError(f"{ptxas} failed: {said.strip().splitlines()[0] if said.strip() else done.returncode}")
    return read_resources(said)


def read_resources(said: str) -> list[Resources]:
    """What `ptxas -v` prints, kernel by kernel."""
    return [
        Resources(plain_name(name), int(registers), int(stack), int(stores) + int(loads))
        for name, stack, stores, loads, registers in _KERNEL.findall(said)
    ]
