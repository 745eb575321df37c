"""Renders one after another with one cluster: memory of the master and its slaves must be flat after the third.

Scenes, sizes of images, passes and ways of light change from render to render, and come again. `make soak` runs it; a
page goes to out/soak.

    python tests/chaos/soak.py --renders 30 -o out/soak
"""

from __future__ import annotations

import argparse
import gc
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median

import wdpm
from wdpm.cluster.render_settings import Indirect

SLAVES = 3
SETTLED = 3
"""Renders after which memory has to be flat: by then each kind has been there once."""

GROWTH_BYTES = 16 << 20
"""Between the median of the first settled renders and that of the last: what an allocator keeps at will."""

KINDS = (
    {"spp": 4, "indirect": Indirect.CACHE, "passes": 1},
    {"spp": 4, "indirect": Indirect.MAP, "passes": 2},
    {"spp": 2, "indirect": Indirect.GATHER, "passes": 1},
)


@dataclass(frozen=True)
class Sample:
    """Memory after a render [bytes]: of the master's process, and of each slave's."""

    master: int
    slaves: tuple[int, ...]


def resident(process: int | str) -> int:
    """Anonymous memory of a process, which no file backs [bytes]."""
    for line in Path(f"/proc/{process}/status").read_text().splitlines():
        if line.startswith("RssAnon:"):
            return int(line.split()[1]) << 10
    raise RuntimeError(f"process {process} has no RssAnon")


def run(renders: int) -> Iterator[Sample]:
    """Render again and again."""
    scenes = [wdpm.load("cornell-box", size=(96, 96)), wdpm.load("atrium:20k", size=(96, 64))]
    with wdpm.Cluster.local(SLAVES) as cluster:
        for number in range(renders):
            chosen = KINDS[number % len(KINDS)]
            cluster.render(scenes[number % len(scenes)], photons=20_000, seed=number, **chosen)
            gc.collect()
            yield Sample(resident("self"), tuple(map(resident, cluster.processes)))


def growth(series: Sequence[int]) -> int:
    """From the first settled renders to the last ones [bytes]: medians of as many renders as there are kinds."""
    settled = series[SETTLED:]
    few = min(2 * len(KINDS), len(settled) // 2)
    return int(median(settled[-few:]) - median(settled[:few])) if few else 0


def page(samples: Sequence[Sample]) -> str:
    """A table, as Markdown."""
    series = [[sample.master for sample in samples], *zip(*(sample.slaves for sample in samples), strict=True)]
    grown = ", ".join(f"{growth(each) / 2**20:+.1f}" for each in series)
    head = " | ".join(["render", "master", *(f"slave {number}" for number in range(SLAVES))])
    lines = [f"# Memory over {len(samples)} renders", "", f"Growth after render {SETTLED}: {grown} MiB.", ""]
    lines += [f"| {head} |", "| ---: " * (SLAVES + 2) + "|"]
    for number, row in enumerate(zip(*series, strict=True), 1):
        lines.append("| " + " | ".join([str(number), *(f"{value / 2**20:.1f}" for value in row)]) + " |")
    return "\n".join(lines) + "\n"


def main() -> int:
    """Run, print and write; 1 if memory grew."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--renders", type=int, default=30)
    parser.add_argument("-o", "--output", type=Path, default=Path("out/soak"))
    args = parser.parse_args()
    args.output.mkdir(parents=True, exist_ok=True)
    samples: list[Sample] = []
    for sample in run(args.renders):
        samples.append(sample)
        print(
            f"{len(samples)}: {[round(value / 2**20, 1) for value in (sample.master, *sample.slaves)]} MiB", flush=True
        )
        (args.output / "index.md").write_text(page(samples))  # as it goes: what was found is kept
    series = [[sample.master for sample in samples], *zip(*(sample.slaves for sample in samples), strict=True)]
    return int(any(growth(each) > GROWTH_BYTES for each in series))


if __name__ == "__main__":
    raise SystemExit(main())
