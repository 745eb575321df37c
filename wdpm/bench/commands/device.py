"""`wdpm bench device`: its options, and what it does with them."""

from __future__ import annotations

import argparse

from wdpm import values
from wdpm.bench.commands.arguments import add_counts, add_threads, find_all
from wdpm.bench.commands.benchmark import Benchmark, Measured
from wdpm.cluster.render_settings import Integrator, RenderSettings
from wdpm.progress import Progress
from wdpm.rendering.backend import Backends

_DESCRIPTION = """\
Compare a device's bits with the CPU's: each launch of small renders repeated on
the device with the same input, then images, then images of a cluster with one
slave on either, with times. Some ten minutes. Exit code 1 where a bit differs."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add its options."""
    parser.add_argument(
        "scenes",
        nargs="*",
        metavar="SCENE",
        help="scenes to render (default: built-in ones, and SCENE/scene.xml in the folder that WDPM_SCENES names)",
    )
    parser.add_argument(
        "--device", default="cuda:0", metavar="NAME", help="cuda:N; or cpu, to try the comparison (default: cuda:0)"
    )
    parser.add_argument(
        "--size", type=values.size, default=(256, 192), metavar="WxH", help="size of the images (default: 256x192)"
    )
    add_counts(
        parser,
        ("--spp", 4, "samples a pixel"),
        ("--photons", 100_000, "photons to be stored in each map"),
        ("--budget", 540, "seconds after which nothing more is begun"),
    )
    add_threads(parser, "threads of the CPU")


def run(args: argparse.Namespace, backends: Backends, progress: Progress) -> Measured:  # noqa: ARG001
    """Both tables; the exit code says whether all bits are equal."""
    from wdpm.bench.gpu.device_check import measure
    from wdpm.devices import check_device

    check_device(args.device)
    find_all(args.scenes)
    photons = dict.fromkeys(("photons", "caustic_photons", "volume_photons"), args.photons)
    figures = measure(
        args.device,
        progress,
        RenderSettings(integrator=Integrator.PHOTONS, spp=args.spp, **photons),
        scenes=args.scenes,
        size=args.size,
        threads=args.threads,
        budget=args.budget,
    )
    return Measured(figures.grids(), {"device": figures.to_dict()}, code=int(not figures.equal))


BENCHMARK = Benchmark("device", "whether a GPU gives the CPU's bits, and how fast", _DESCRIPTION, add_arguments, run)
