"""The table of `wdpm bench cuda`: what each kernel costs the compiler, and a thread of it a GPU."""

from __future__ import annotations

import tempfile
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from wdpm.bench.gpu.assembler import Resources, resources_of
from wdpm.bench.gpu.compilation import (
    Compiled,
    common_modules,
    compile_module,
    features_of_effects,
    inexact_instructions,
    modules_of,
)
from wdpm.progress import Progress
from wdpm.report.grid import Grid


@dataclass(frozen=True)
class Module:
    """One module for one architecture.

    Attributes:
        kernels: what each takes; empty where no assembler is.
        inexact: instructions that the contract of exactness does not allow, by name.
    """

    name: str
    names: tuple[str, ...]
    architecture: int
    seconds: float
    kernels: tuple[Resources, ...]
    inexact: dict[str, int]


@dataclass(frozen=True)
class CudaFigures:
    """All modules for all architectures."""

    architectures: tuple[int, ...]
    modules: tuple[Module, ...]

    @property
    def inexact(self) -> Counter[str]:
        """Instructions that the contract does not allow, of all modules."""
        return sum((Counter(module.inexact) for module in self.modules), Counter())

    def to_dict(self) -> dict[str, Any]:
        """As JSON has it."""
        return asdict(self)

    def grid(self) -> Grid:
        """A row a kernel; of its variants, the largest figure."""
        heads = ("seconds", "registers", "local bytes", "spilled bytes")
        columns = ["kernel", "variants"]
        for architecture in self.architectures:
            columns += [f"sm_{architecture} {head}" for head in heads]
        names = sorted({name for module in self.modules for name in module.names})
        rows = tuple((name, *self._cells(name)) for name in names)
        said = ", ".join(f"{count} x {name}" for name, count in self.inexact.items()) or "none"
        notes = (
            "Of a kernel's variants, the largest figure. seconds: of one core, to compile the module that the kernel "
            "is in, from CUDA C++ to PTX. local bytes: local memory of a thread, spilled registers included.",
            f"Instructions that may have other bits than the CPU's: {said}.",
        )
        return Grid("Kernels for CUDA", tuple(columns), rows, notes)

    def _cells(self, name: str) -> list[str]:
        cells: list[str] = []
        for architecture in self.architectures:
            modules = [m for m in self.modules if m.architecture == architecture and name in m.names]
            takes = [kernel for module in modules for kernel in module.kernels if kernel.kernel == name]
            cells = cells or [str(len(modules))]
            cells.append(f"{max(module.seconds for module in modules):.1f}" if modules else "-")
            for figure in ("registers", "local_bytes", "spill_bytes"):
                cells.append(f"{max(getattr(each, figure) for each in takes):,}" if takes else "-")
        return cells


def measure(
    architectures: Sequence[int], ptxas: Path | None, progress: Progress, *, only: str = "", variants: bool = True
) -> CudaFigures:
    """Compile every module for every architecture.

    Args:
        ptxas: NVIDIA's assembler; None leaves out what kernels take.
        only: part of the names of the modules that are wanted.
        variants: also those that depend on effects, for every scene of `wdpm bench effects`.

    Raises:
        WdpmError: one does not compile.
    """
    modules = common_modules() + (modules_of(features_of_effects().values()) if variants else [])
    wanted = [module for module in modules if only in module.name]
    progress.start("compile", len(wanted) * len(architectures))
    done = []
    with tempfile.TemporaryDirectory(prefix="wdpm-cuda-") as folder:
        for architecture in architectures:
            # The first module of a process also pays for the headers that all share; which is no module's own time.
            compile_module(_smallest(modules), architecture, Path(folder) / "headers")
            for module in wanted:
                compiled = compile_module(module, architecture, Path(folder))
                done.append(_figures(compiled, ptxas))
                progress.advance()
    return CudaFigures(tuple(architectures), tuple(done))


def _smallest(modules: Sequence[Any]) -> Any:
    return next(module for module in modules if module.name.endswith("emit_photons"))


def _figures(compiled: Compiled, ptxas: Path | None) -> Module:
    takes = () if ptxas is None else tuple(resources_of(compiled.ptx, compiled.architecture, ptxas))
    return Module(
        compiled.name,
        compiled.kernels,
        compiled.architecture,
        compiled.seconds,
        takes,
        dict(inexact_instructions(compiled.ptx)),
    )
