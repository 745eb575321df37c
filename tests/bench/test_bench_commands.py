"""The benchmarks that `wdpm bench` offers: each is a file of its own, and has help."""

from __future__ import annotations

import pkgutil

import pytest

from wdpm.bench import commands
from wdpm.cli import bench, main

SHARED = {"arguments", "benchmark"}


def test_every_benchmark_is_offered() -> None:
    files = {module.name for module in pkgutil.iter_modules(commands.__path__)} - SHARED
    names = [benchmark.name for benchmark in bench.BENCHMARKS]
    assert {name.replace("-", "_") for name in names} == files
    assert len(names) == len(files)


@pytest.mark.parametrize("benchmark", bench.BENCHMARKS, ids=lambda benchmark: benchmark.name)
def test_each_has_help(benchmark: bench.Benchmark, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main.main(["bench", benchmark.name, "--help"])
    text = capsys.readouterr().out
    assert benchmark.description in text
    assert "--json FILE.json" in text
    assert "--markdown FILE.md" in text
