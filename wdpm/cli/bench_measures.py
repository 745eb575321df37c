"""What the benchmarks of `wdpm bench` do with their arguments: measure, and return tables and figures for JSON.

Imports stand within: the command line starts without any of them.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from pathlib import Path
from typing import Any

Measured = tuple[list[Any], dict[str, Any]]
"""Tables to print, and figures by name."""


def kernels(args: argparse.Namespace, progress: Any) -> Measured:
    """Rays, photon gathers and photon tracing on one core."""
    from wdpm.bench import kernels as bench_kernels

    figures = bench_kernels.measure(progress, bench_kernels.Load(models=tuple(args.scenes)))
    return [figures.grid()], {"kernels": figures.to_dict()}


def paper(args: argparse.Namespace, progress: Any) -> Measured:
    """What clusters hold, send and cost."""
    from wdpm.bench import paper as bench_paper
    from wdpm.cluster.settings import Indirect, RenderSettings, Routing

    _find_all(args.scenes)
    given = {name: getattr(args, name) for name in ("spp", "photons") if getattr(args, name) is not None}
    chosen: dict[str, Any] = {"indirect": Indirect(args.indirect), **given}
    RenderSettings(**chosen)  # a value out of range is an error before the first scene is rendered
    routings = tuple(Routing) if args.routing == "both" else (Routing(args.routing),)
    slaves = bench_paper.DEFAULT_SLAVES if args.slaves is None else args.slaves
    scenes = [
        bench_paper.measure(scene, slaves, routings, progress, size=args.size, threads=args.threads, **chosen)
        for scene in args.scenes or bench_paper.DEFAULT_SCENES
    ]
    return [figures.grid() for figures in scenes], {"paper": [figures.to_dict() for figures in scenes]}


def effects(args: argparse.Namespace, progress: Any) -> Measured:
    """What each effect costs."""
    from wdpm.bench import effects as bench_effects
    from wdpm.bench import effects_scenes
    from wdpm.bench.effects_plot import plot
    from wdpm.cluster.settings import RenderSettings
    from wdpm.images.files import write_bytes

    photons = dict.fromkeys(("photons", "caustic_photons", "volume_photons"), args.photons)
    effects = effects_scenes.EFFECTS
    figures = bench_effects.measure(
        progress,
        RenderSettings(spp=args.spp, **photons),
        names=[f"+ {name}" if name in effects else name for name in args.scenes],
        size=args.size,
        rounds=args.rounds,
        threads=args.threads,
        compiler=None if args.no_compile else bench_effects.compile_from_scratch,
    )
    if args.plot is not None:
        write_bytes(plot(figures).encode(), args.plot)
    return [figures.grid()], {"effects": figures.to_dict()}


def mitsuba(args: argparse.Namespace, progress: Any) -> Measured:
    """Time and error next to Mitsuba's."""
    from wdpm.bench import mitsuba as bench_mitsuba
    from wdpm.cluster.settings import RenderSettings

    width, height = args.size
    settings = RenderSettings(spp=args.spp, photons=args.photons, k=args.k)
    setup = bench_mitsuba.Setup(args.scene, width, height, settings, args.mitsuba_spp, args.rounds, args.threads)
    figures = bench_mitsuba.measure(setup, args.reference, progress)
    return [figures.grid()], {"mitsuba": figures.to_dict()}


def caustic(args: argparse.Namespace, progress: Any) -> Measured:
    """Time to an error in a region, next to Mitsuba's."""
    from wdpm.bench import caustic as bench_caustic
    from wdpm.cluster.settings import RenderSettings

    names = ("spp", "photons", "caustic_photons", "caustic_k")
    settings = RenderSettings(**{name: getattr(args, name) for name in names})
    bound = bench_caustic.Bound(args.reference, args.region, args.error)
    figures = bench_caustic.measure(
        args.scene, bound, settings, args.mitsuba_spp, progress, rounds=args.rounds, threads=args.threads
    )
    return [figures.grid()], {"caustic": figures.to_dict()}


def peers(args: argparse.Namespace, progress: Any) -> Measured:
    """Time to errors of the whole image, next to Mitsuba's."""
    from wdpm.bench import peers as bench_peers
    from wdpm.bench.peers_figures import Bounds
    from wdpm.scenes.errors import SettingsError

    if args.reference is not None and len(args.scenes) > 1:
        raise SettingsError(
            f"--reference is of one scene, and there are {len(args.scenes)}: put a reference.exr beside each"
        )
    bounds = Bounds(args.errors, args.region, args.rounds, args.limit)
    pairs = [(scene, args.reference or bench_peers.default_reference(scene)) for scene in args.scenes]
    for scene, reference in pairs:
        bench_peers.check(scene, reference, bounds)
    figures = [
        bench_peers.measure(scene, reference, bounds, progress, threads=args.threads) for scene, reference in pairs
    ]
    return [each.grid() for each in figures], {"peers": [each.to_dict() for each in figures]}


def indirect(args: argparse.Namespace, progress: Any) -> Measured:
    """Photon map, final gathering and irradiance cache side by side."""
    from wdpm.bench import indirect as bench_indirect
    from wdpm.bench.indirect_plot import plot
    from wdpm.images.files import write_bytes
    from wdpm.scenes.errors import SettingsError

    if args.reference is not None and len(args.scenes) > 1:
        raise SettingsError(
            f"--reference is of one scene, and there are {len(args.scenes)}: put a reference.exr beside each"
        )
    _find_all(args.scenes)
    sweep = bench_indirect.Sweep(args.spp, args.photons, args.rounds, args.region, args.reference_spp)
    pairs = [(scene, args.reference or bench_indirect.reference_beside(scene)) for scene in args.scenes]
    for scene, reference in pairs:
        if reference is not None and args.size is not None:
            raise SettingsError(f"{scene}: images have the size of {reference}; leave --size out")
    figures = [
        bench_indirect.measure(scene, reference, sweep, progress, size=args.size, threads=args.threads)
        for scene, reference in pairs
    ]
    if args.plot is not None:
        write_bytes(plot(figures).encode(), args.plot)
    grids = [grid for each in figures for grid in each.grids()]
    return grids, {"indirect": [each.to_dict() for each in figures]}


def hard_cases(args: argparse.Namespace, progress: Any) -> Measured:  # noqa: ARG001
    """The suite of hard cases; its verdict becomes the exit code."""
    from wdpm.bench import hard_cases as bench_hard_cases

    figures = bench_hard_cases.measure(args.output, args.only, small=args.small)
    args.code = int(figures.failed > 0)
    return [figures.grid()], {"hard_cases": figures.to_dict()}


def predict(args: argparse.Namespace, progress: Any) -> Measured:
    """What --until-error predicts and estimates, against the truth."""
    from wdpm.bench import predict as bench_predict

    _find_all(args.scenes)
    figures = bench_predict.measure(
        args.scenes, progress, targets=args.errors, seeds=args.seeds, clock=args.clock, threads=args.threads
    )
    return [figures.grid()], {"predict": figures.to_dict()}


def _find_all(scenes: Iterable[str | Path]) -> None:
    """Raise SceneError for a scene that is not there: the last one must not cost what was measured of the others."""
    from wdpm.scenes.load import find

    for scene in scenes:
        find(scene)
