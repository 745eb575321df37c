"""The benchmarks that `wdpm bench` offers: each is a file of its own, and asking for help computes nothing."""

from __future__ import annotations

import pkgutil
import subprocess
import sys

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


def test_help_needs_nothing_that_computes() -> None:
    code = (
        "import sys\n"
        "from wdpm.cli.main import main\n"
        "try: main(['bench', '--help'])\n"
        "except SystemExit: pass\n"
        "print(sorted({'warp', 'zmq', 'rich'} & set(sys.modules)), file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stderr == "[]\n"
