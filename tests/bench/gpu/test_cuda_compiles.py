"""Kernels compile for GPUs without one, to no more than can be compiled in seconds, and round as the CPU's do."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import warp as wp

from wdpm.bench.gpu import assembler
from wdpm.bench.gpu.compilation import (
    ARCHITECTURES,
    Compiled,
    all_kernels,
    common_modules,
    compile_module,
    features_of_effects,
    inexact_instructions,
    modules_of,
)
from wdpm.cli import main
from wdpm.kernels.compile import MODULES
from wdpm.scenes.errors import WdpmError

MOST_LINES = 50_000
"""Of a module's PTX, some 3,000 of which NVIDIA's compiler makes in a second of one core: what unrolls too far takes it
minutes. The longest, guide_pilot, has 38,500."""

FEW = ("emit_photons", "gather", "cache", "rays")
"""Modules whose kernels are compiled in `make test`."""


def check(compiled: Compiled) -> None:
    assert compiled.kernels, compiled.name
    assert inexact_instructions(compiled.ptx) == {}, compiled.name
    assert compiled.ptx.count("\n") < MOST_LINES, compiled.name


@pytest.mark.parametrize("name", FEW)
def test_some_modules_compile(name: str, tmp_path: Path) -> None:
    module = next(wp.get_module(each.__name__) for each in MODULES if each.__name__.endswith(f".{name}"))
    compiled = compile_module(module, 90, tmp_path)
    check(compiled)
    assert set(compiled.kernels) == set(module.kernels)


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("architecture", ARCHITECTURES)
def test_all_modules_and_variants_compile(architecture: int, tmp_path: Path) -> None:
    compile_module(wp.get_module(MODULES[-1].__name__), architecture, tmp_path / "headers")
    names: set[str] = set()
    for module in common_modules() + modules_of(features_of_effects().values()):
        compiled = compile_module(module, architecture, tmp_path)
        check(compiled)
        names.update(compiled.kernels)
    assert names == set(all_kernels())


def test_what_does_not_compile_is_said_in_one_line(tmp_path: Path) -> None:
    @wp.kernel(module="unique")
    def adds_apples_and_pears(out: wp.array[wp.float32]) -> None:
        out[wp.tid()] = wp.float32(1.0) + wp.int32(1)

    with pytest.raises(WdpmError, match=r"does not compile for sm_90: .*add") as told:
        compile_module(adds_apples_and_pears.module, 90, tmp_path)
    assert "\n" not in str(told.value)


def test_contraction_is_found(tmp_path: Path) -> None:
    """The same kernel with and without the option that the contract asks for."""

    def kernel(fuse: bool) -> wp.Kernel:
        @wp.kernel(module="unique", enable_backward=False, module_options={"fuse_fp": fuse})
        def product_and_sum(x: wp.array[wp.float32], out: wp.array[wp.float32]) -> None:
            i = wp.tid()
            out[i] = x[i] * x[i] + x[i + 1] / x[i]

        return product_and_sum

    found = [inexact_instructions(compile_module(kernel(fuse).module, 90, tmp_path).ptx) for fuse in (False, True)]
    assert found[0] == {}
    assert "fma.rn.f32" in found[1]


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("add.rn.f32 %f1, %f2, %f3;", {}),
        ("add.f32 %f1, %f2, %f3;", {"add.f32": 1}),
        ("mul.ftz.f32 %f1, %f2, %f3;", {"mul.ftz.f32": 1, "mul.ftz": 1}),
        ("div.approx.f32 %f1, %f2, %f3;", {"div.approx.f32": 1, "div.approx": 1}),
        ("div.full.f32 %f1, %f2, %f3;", {"div.full.f32": 1}),
        ("sqrt.rn.f64 %d1, %d2;", {}),
        ("rsqrt.approx.f32 %f1, %f2;", {"rsqrt.approx.f32": 1}),
        ("mad.lo.s32 %r1, %r2, %r3, %r4;", {}),
        ("min.f32 %f1, %f2, %f3;", {}),
    ],
)
def test_instructions(line: str, expected: dict[str, int]) -> None:
    assert inexact_instructions(line) == expected


def test_what_the_assembler_says_is_read() -> None:
    said = """\
ptxas info    : 154 bytes gmem
ptxas info    : Compiling entry function 'add_beams_21465753_cuda_kernel_forward' for 'sm_90'
ptxas info    : Function properties for add_beams_21465753_cuda_kernel_forward
    1232 bytes stack frame, 8 bytes spill stores, 12 bytes spill loads
ptxas info    : Used 80 registers, used 0 barriers, 1232 bytes cumulative stack size, 1024 bytes smem
ptxas info    : Compile time = 150.678 ms
ptxas info    : Function properties for _fit_boxes_81774c9e_cuda_kernel_forward
    0 bytes stack frame, 0 bytes spill stores, 0 bytes spill loads
ptxas info    : Used 32 registers, used 0 barriers
"""
    assert assembler.read_resources(said) == [
        assembler.Resources("add_beams", 80, 1232, 20),
        assembler.Resources("_fit_boxes", 32, 0, 0),
    ]


def test_the_assembler_s_refusal_is_told(tmp_path: Path) -> None:
    refuses = tmp_path / "ptxas"
    refuses.write_text("#!/bin/sh\necho 'ptxas fatal   : Unsupported .version 9.4' >&2\nexit 1\n")
    refuses.chmod(0o755)
    with pytest.raises(WdpmError, match=r"Unsupported \.version"):
        assembler.resources_of("", 90, refuses)


def test_the_command_prints_a_table_and_writes_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    options = ["--no-variants", "--no-ptxas", "--only", "emit_photons", "--arch", "80"]
    assert main.main(["bench", "cuda", *options, "--json", str(tmp_path / "cuda.json")]) == 0
    assert "first_cells" in capsys.readouterr().out
    (module,) = json.loads((tmp_path / "cuda.json").read_text())["cuda"]["modules"]
    names = sorted(module["names"])  # in an order that hashes decide
    assert (module["architecture"], names, module["inexact"]) == (80, ["first_cells", "numbers_of_paths"], {})
