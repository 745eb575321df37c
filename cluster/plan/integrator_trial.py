"""Which integrator suits a scene: a trial of a few thousand samples by each, and what their errors cost.

A trial counts, it looks at no clock: rays, vertices and gathers, at fixed prices. So the same scene and settings choose
alike on every machine and cluster, as the bits of the image depend on it (docs/exactness.md).

What samples leave of noise is measured, by the integrators that are compared: each renders the same few pixels twice,
with other samples, and half the squared difference is the variance. What photons leave besides, whatever the samples,
is a share of the square of indirect light. Paths may miss what hardly any of them meets, and a trial of few samples
does not know what it has missed: the noise of caustics that smooth surfaces make is told by photons (path_caustics).
How many photons there are is weighed in the same way (map_worth): beside few samples fewer serve. What they get wrong
everywhere at once is weighed by itself (trial.mean_error).
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from wdpm.cluster.integrators.indirect_choice import EVEN_SHARE
from wdpm.cluster.plan.cache_worth import sites_about, unread_at
from wdpm.cluster.plan.caustics.guide import CausticsLearnt, learn_caustics
from wdpm.cluster.plan.effects import features_of, has_caustics
from wdpm.cluster.plan.light_guide import Learnt, learn_guide
from wdpm.cluster.plan.map_plans import NO_MAPS, MapPlans, map_plans, with_fewer_paths
from wdpm.cluster.plan.map_worth import GATHERED_BLUR, MapError, best_shares, fewer_shares, irradiance_by, map_error
from wdpm.cluster.plan.path_caustics import caustics_by_paths, has_rough_metals, may_have_caustics
from wdpm.cluster.plan.photon_pilot import LEAST_PATHS, PhotonPilot, fly_pilot, worker_without_photons
from wdpm.cluster.plan.small_view import SeenPlaces, Values, without_photons
from wdpm.cluster.plan.steering.pilot import steered_pilot
from wdpm.cluster.plan.trial.bias import MapQueries, map_bias
from wdpm.cluster.plan.trial.caustic_share import caustic_grain, caustic_share
from wdpm.cluster.plan.trial.figures import Trial
from wdpm.cluster.plan.trial.looks import Looks, look, look_by_guided_paths
from wdpm.cluster.plan.trial.mean_error import mean_error
from wdpm.cluster.plan.trial.prices import FINDING_OUT, LOOK_BY_GUIDE, LOOK_MOST, Prices
from wdpm.cluster.plan.trial.shadow_rays import shadow_rays
from wdpm.cluster.plan.trial.unfound import is_dark, with_unfound
from wdpm.cluster.plan.trial.ways import PATCHES, Way, words_for
from wdpm.cluster.plan.view import view_of
from wdpm.cluster.render_settings import Indirect, Integrator, RenderSettings
from wdpm.kernels.camera.camera import tangent
from wdpm.kernels.constants import INV_PI
from wdpm.kernels.features import Features
from wdpm.kernels.launch import Launcher
from wdpm.kernels.photons.deposits import CAUSTIC_MAP, GLOBAL_MAP
from wdpm.scenes.flat.flatten import FlatScene
from wdpm.scenes.flat.used_media import calls_for_media
from wdpm.scenes.model.scene import Camera

GATHERED_PLACES, LEAST_GATHERED = 1024, 512
"""Places of a trial at which the pilot's photons are gathered, to tell what the global map gets wrong: at most, and of
the shortest pilot. Each takes some ten gathers."""

LEAST_COSINE = 0.05
"""At which a pixel is thought to see a surface."""

LEFT_BY_MAP = 0.02
LEFT_BY_CACHE = 0.003
"""Error that samples do not lessen, as a share of the square of indirect light: noise and blur of gathers of 50
photons, and of irradiance records of 16 samples a pixel. On cbox and sibenik 0.013 to 0.022, and 0.001 to 0.004."""

OVER_WIDE = 0.1
"""Blur, as a share of the square of indirect light, from which on a map's gathers are wider than what they are to show:
in ordinary rooms it is a fiftieth of that (LEFT_BY_MAP). In a car under the open sky it was 0.8, and regions of the
image were off by 14 % (root mean square); by the irradiance cache, in the same time, by 4 %, most of it their
reference's."""

LEFT_BY_GUIDE = 0.25
"""Of the noise of indirect light that a trial sees, what guiding paths to caustics of rough metals leaves at least. Of
smooth ones trials see next to nothing. In two scenes 0.4, in others nearly all."""

HIDDEN_MOST = 1e-3
"""Of all light of an image, what path tracing may leave out: less than photons are off by."""


@dataclass(frozen=True)
class IntegratorChoice:
    """What was chosen, and why.

    Attributes:
        settings: with the integrator, and where its indirect light comes from.
        words: for people.
        pilot: that was flown for photons.
        learnt: how shadow rays choose among lights, in the trial as in the render.
        caustics: where paths go on to find caustics, if that was asked: then it is so in a render by paths.
        noise: squared error of a sample of each pixel of the trial, with what was chosen, shape [height, width].
        indirect: where indirect light comes from by photons, in words.
        caustic_share: 1 of so many samples of a pixel asks the caustic map.
        shadow_rays: how many of a camera sample are worth it, if nobody said; 0 by path tracing: as ever.
        square_of_indirect: mean square of indirect light, as `noise` is weighted; None by path tracing.
    """

    settings: RenderSettings
    words: str
    pilot: PhotonPilot
    learnt: Learnt
    noise: Values
    indirect: tuple[str, ...] = ()
    caustic_share: int = 1
    shadow_rays: int = 0
    caustics: CausticsLearnt | None = None
    square_of_indirect: float | None = None


def trial_features(flat: FlatScene, settings: RenderSettings) -> Features:
    """What kernels have to be compiled for before a trial."""
    return features_of(flat, replace(settings, integrator=Integrator.PATH, without=()))


def reason_for_photons(flat: FlatScene, settings: RenderSettings) -> str | None:
    """Why it is photons whatever a trial would find; None if a trial is to decide."""
    if asked := _asked_of_photons(settings):
        return f"photons, since they were asked for: {', '.join(asked)}"
    if calls_for_media(flat):
        return "photons, since the scene has media"
    if not flat.lights.power.sum() > 0:
        return "photons, since nothing shines"
    return None


def choose_integrator(
    flat: FlatScene, settings: RenderSettings, photons: RenderSettings, launcher: Launcher
) -> IntegratorChoice:
    """Choose between photon mapping and path tracing. Kernels for `trial_features` are to be compiled before.

    Photons are flown only where they may pay, or where light may be that no path finds.

    Args:
        settings: with an integrator that stands for several, and indirect light from anywhere.
        photons: the same with photon mapping, by the map.
    """
    features, view = trial_features(flat, settings), view_of(flat, photons, 1)
    worker = worker_without_photons(flat, features, settings, launcher)
    worker.set_view(view)
    learnt = learn_guide(flat, worker.cells[0], view, photons.samples_of_pass)
    paths = replace(settings, integrator=Integrator.PATH, indirect=Indirect.MAP)
    looks = look(flat, worker, photons, paths, learnt)
    if not may_have_caustics(flat, features, photons) and not is_dark(looks):
        choice = _surely_by_paths(flat, looks, photons)
        if choice is not None:
            by_path, words = choice
            pilot = fly_pilot(flat, features, by_path, launcher, worker)
            return IntegratorChoice(by_path, words, pilot, learnt, looks.trial().noises_by(by_path))
    is_faint = looks.indirect_is_faint(photons.samples_of_pass)
    pilot = fly_pilot(flat, features, photons, launcher, worker, is_faint=is_faint)
    pilot = steered_pilot(flat, pilot, view, is_faint=is_faint)
    asked = _ask_photons(flat, pilot, photons, looks)
    return _by_trial(flat, pilot, learnt, asked, photons, lambda: _guided(flat, pilot, paths, looks, asked, learnt))


def _by_trial(
    flat: FlatScene,
    pilot: PhotonPilot,
    learnt: Learnt,
    trial: Trial,
    photons: RenderSettings,
    guided: Callable[[], tuple[Trial, CausticsLearnt]],
) -> IntegratorChoice:
    """What a trial finds to be best.

    Args:
        trial: by paths that are not guided to caustics.
        guided: gives the same by those that are, if they may be, and where they go on.
    """
    caustics, plans = None, map_plans(pilot, photons, flat)
    best, indirect = _best_by_photons(flat, plans, trial, photons)
    spp = photons.samples_of_pass
    if trial.caustics.hidden > HIDDEN_MOST:
        words = f"photons, since no path finds {trial.caustics.hidden:.1%} of the light: caustics of lamps without size"
    else:
        prices, bound = Prices(flat, plans, spp), "at least "
        of_paths = _by_paths_at_best(trial, prices, spp, has_rough_metals(flat))
        if not has_caustics(flat, pilot.world.features) or not best.way.is_better_than(of_paths):
            bound, (trial, caustics) = "", guided()
            of_paths = _by_paths(trial, prices, spp)
        words = words_for(of_paths, best.way, bound)
        if of_paths.is_better_than(best.way):
            chosen = trial.as_rendered.settings
            noises = trial.noises_by(chosen)
            return IntegratorChoice(chosen, words, pilot, learnt, noises, (indirect,), caustics=caustics)
    return IntegratorChoice(
        best.settings,
        words + best.fewer,
        pilot,
        learnt,
        trial.noises_by(best.settings),
        (indirect,),
        best.caustic_share,
        best.shadow_rays,
        square_of_indirect=trial.by_paths.indirect,
    )


def _surely_by_paths(flat: FlatScene, looks: Looks, photons: RenderSettings) -> tuple[RenderSettings, str] | None:
    """Path tracing, and in words why, if it is better than photon mapping could be, which has yet to be looked into.

    Maps are thought to get no more wrong than every one does, and to take no time to make once a pilot was flown.
    """
    trial, spp = looks.trial(), photons.samples_of_pass
    of_paths = _by_paths(trial, Prices(flat, NO_MAPS, spp), spp)
    ways = []
    for kind in (Indirect.MAP, Indirect.CACHE):
        by_kind = replace(photons, indirect=kind)
        left = _left(by_kind) * trial.by_paths.indirect
        price = FINDING_OUT + Prices(flat, NO_MAPS, spp).of_photons(trial, by_kind)
        ways.append(Way(trial.noise_by(by_kind) / spp + left, price, of_maps=left))
    if any(not of_paths.is_better_than(way) for way in ways):
        return None
    least = min(ways, key=lambda way: way.worth)
    return trial.by_paths.settings, words_for(of_paths, least, "at most ")


@dataclass(frozen=True)
class _ByPhotons:
    """What an image by photons is expected to come to.

    Attributes:
        settings: with as many photons as are worth it.
        fewer: in words, where these are fewer than by default.
        caustic_share, shadow_rays: as in IntegratorChoice.
    """

    settings: RenderSettings
    way: Way
    fewer: str
    caustic_share: int
    shadow_rays: int


def _by_photons(flat: FlatScene, plans: MapPlans, trial: Trial, photons: RenderSettings) -> _ByPhotons:
    """With photons of worth."""
    spp = photons.samples_of_pass
    settings, fewer, words = _with_photons_of_worth(flat, plans, trial, photons)
    left, prices = _left_by_map(trial, fewer, settings, spp), Prices(flat, fewer, spp)
    share = caustic_share(prices, fewer, trial, settings)
    grain = (trial.noise_by(settings) + share * trial.caustic_grain) / spp
    way = Way(grain + left, prices.of_photons(trial, settings, share), of_maps=left)
    by_samples = trial.by_photons.noise / spp / way.error if way.error else 0.0
    rays = shadow_rays(prices, trial, settings, by_samples, way.price)
    return _ByPhotons(settings, way, words, share, rays)


def _best_by_photons(flat: FlatScene, plans: MapPlans, trial: Trial, photons: RenderSettings) -> tuple[_ByPhotons, str]:
    """With indirect light from where it comes with the least error for its price, as it is seen, and in words why."""
    over_wide = _is_over_wide(trial, plans)
    by_map = _by_photons(flat, plans, trial, photons)
    if trial.even < EVEN_SHARE and not over_wide:
        return (
            by_map,
            f"indirect light: map, since {1 - trial.even:.0%} of what is seen has bumps, sheen or Disney's base",
        )
    rays = Indirect.CACHE if trial.even >= EVEN_SHARE else Indirect.GATHER
    by_rays = _by_photons(flat, plans, trial, replace(photons, indirect=rays))
    of_map, of_rays = by_map.way.as_seen, by_rays.way.as_seen
    best, other = (by_rays, of_map) if of_rays.is_better_than(of_map) else (by_map, of_rays)
    ratio = best.way.as_seen.worth / other.worth if other.worth else 1.0
    why = "gathers of the map reach beyond what they are to show, and " if over_wide and best is by_rays else ""
    return best, (
        f"indirect light: {best.settings.indirect.value}, since {why}error times price, what is seen as patches "
        f"counted {PATCHES:g} times, is expected to be {ratio:.2g} of that of {rays.value if best is by_map else 'map'}"
    )


def _by_paths(trial: Trial, prices: Prices, spp: int) -> Way:
    """What an image by path tracing is expected to come to."""
    grain = trial.as_rendered.noise / spp
    of_caustics = trial.caustics.left(spp, grain)
    return Way(grain + of_caustics, prices.of_paths(trial.as_rendered), of_caustics)


def _by_paths_at_best(trial: Trial, prices: Prices, spp: int, has_rough_metals: bool) -> Way:
    """What an image by path tracing comes to at best, if it is guided to caustics, with what it takes to find out."""
    figures = trial.by_paths
    left = LEFT_BY_GUIDE if has_rough_metals else 1.0
    noise = figures.noise - (1.0 - left) * figures.of_indirect
    price = prices.of_paths(figures)
    return Way(noise / spp, price + min(LOOK_BY_GUIDE, LOOK_MOST * price))


def _is_over_wide(trial: Trial, plans: MapPlans) -> bool:
    """Whether gathers of the global map, read where the camera looks, are wider than what they are to show."""
    error = trial.map_errors[GLOBAL_MAP]
    if error is None:
        return False
    wrong = max(error.of_blur(plans.expected[GLOBAL_MAP]), trial.bias)
    return wrong > OVER_WIDE * trial.by_paths.indirect


def _with_photons_of_worth(
    flat: FlatScene, plans: MapPlans, trial: Trial, photons: RenderSettings
) -> tuple[RenderSettings, MapPlans, str]:
    """As many photons as make error times price least, of those shot by default and parts of them; and in words.

    Errors of maps count as they are seen: as patches, but for those that gather rays read, which average these out.
    """
    spp, maps = photons.samples_of_pass, (GLOBAL_MAP, CAUSTIC_MAP)
    asked = {GLOBAL_MAP: photons.photons, CAUSTIC_MAP: photons.caustic_photons}
    plain = {GLOBAL_MAP: RenderSettings.photons, CAUSTIC_MAP: RenderSettings.caustic_photons}
    known = {number: trial.map_errors[number] for number in maps if asked[number] == plain[number]}
    errors = {number: error for number, error in known.items() if error is not None and plans.maps[number].paths}
    of_samples = trial.noise_by(photons) / spp
    of_others = of_samples
    if GLOBAL_MAP not in errors or photons.final_gathers:
        of_others += _left(photons) * trial.by_paths.indirect

    def with_shares(shares: tuple[int, ...]) -> RenderSettings:
        counts = [asked[number] // share for number, share in zip(maps, shares, strict=True)]
        return replace(photons, photons=counts[0], caustic_photons=counts[1])

    @functools.cache  # each part of a map's photons is tried beside all parts of the other's
    def wrong(number: int, share: int) -> float:
        own = errors[number].of(plans.expected[number] / share, spp, gathered=gathered[number])
        return own if gathered[number] else PATCHES * own

    @functools.cache
    def price(shares: tuple[int, ...]) -> float:
        return Prices(flat, with_fewer_paths(plans, shares), spp).of_photons(trial, with_shares(shares))

    def worth(shares: tuple[int, ...]) -> float:
        return (of_others + sum(wrong(number, shares[number]) for number in errors)) * price(shares)

    def of_mean(shares: tuple[int, ...]) -> float:
        return trial.mean_error.worth(paths / shares[GLOBAL_MAP], price(shares), of_samples) if reads_photons else 0.0

    def is_seen(shares: tuple[int, ...]) -> bool:
        fewer = {n: plans.expected[n] / share for n, share in zip(maps, shares, strict=True) if share > 1}
        read = [number for number in fewer if not gathered[number]]
        return any(not errors[number].is_faint(fewer[number], spp, of_samples) for number in read)

    gathered = {GLOBAL_MAP: photons.final_gathers, CAUSTIC_MAP: False}
    reads_photons = photons.final_gathers and GLOBAL_MAP in errors
    paths = float(plans.maps[GLOBAL_MAP].paths * photons.passes)
    every = [
        fewer_shares(errors[number], plans.expected[number], spp, of_samples, gathered=gathered[number])
        if number in errors
        else (1,)
        for number in maps
    ]
    worths = {shares: worth(shares) for shares in itertools.product(*every)}
    best = best_shares(worths, is_seen, of_mean)
    fewer = [
        f"{asked[number] // share:,} {name}photons"
        for number, share, name in zip(maps, best, ("", "caustic "), strict=True)
        if share > 1
    ]
    words = f"; {' and '.join(fewer)}, as more would bring little beside the samples" if fewer else ""
    return with_shares(best), with_fewer_paths(plans, best), words


def _asked_of_photons(settings: RenderSettings) -> list[str]:
    """Settings that were chosen, and that mean something to photon maps alone."""
    plain, paths = RenderSettings(), Integrator.PATH.algorithm
    names = [name for name in paths.ignored if getattr(settings, name) != getattr(plain, name)]
    return names + [f"without {effect}" for effect in settings.without if effect in paths.cannot_leave_out]


def _left(settings: RenderSettings) -> float:
    """Of the square of indirect light, what samples do not lessen."""
    return LEFT_BY_CACHE if settings.algorithm.has_irradiance_cache(settings) else LEFT_BY_MAP


def _left_by_map(trial: Trial, plans: MapPlans, settings: RenderSettings, spp: int) -> float:
    """Error that samples do not lessen: as ever, or more where the camera sees places that hardly a photon comes to.

    What gathers bring in from behind walls is seen by the map alone: what gather rays read has none of it.
    """
    ordinary, (error, of_caustics) = _left(settings) * trial.by_paths.indirect, trial.map_errors
    gathers = plans.expected[GLOBAL_MAP]
    wrong = 0.0 if error is None else error.of(gathers, spp)
    if not settings.final_gathers:
        left = max(ordinary, wrong, trial.bias)
    else:  # what a few heavy photons get wrong is alike in many gathers, and no more averaged out than blur is
        left = max(ordinary, GATHERED_BLUR * wrong, 0.0 if error is None else error.of(gathers, spp, gathered=True))
    return left if of_caustics is None else left + of_caustics.of(plans.expected[CAUSTIC_MAP], spp)


def _guided(
    flat: FlatScene, pilot: PhotonPilot, paths: RenderSettings, looks: Looks, trial: Trial, learnt: Learnt
) -> tuple[Trial, CausticsLearnt]:
    """A trial by paths that are guided to caustics, where they would be, and where they go on.

    Args:
        trial: by those that are not.
    """
    caustics = learn_caustics(flat, paths, view_of(flat, paths, 1), pilot)
    if not len(caustics.guide):
        return trial, caustics
    with without_photons(pilot) as worker:
        guided = look_by_guided_paths(flat, worker, looks, learnt, caustics.guide)
    told = caustics_by_paths(pilot, flat, looks.places, looks.truth, looks.samples, looks.epsilon, caustics)
    return looks.guided_trial(trial, guided, told), caustics


def _ask_photons(flat: FlatScene, pilot: PhotonPilot, photons: RenderSettings, looks: Looks) -> Trial:
    """What the pilot's photons tell besides of what is seen without."""
    places, truth, epsilon = looks.places, looks.truth, looks.epsilon
    caustics = caustics_by_paths(pilot, flat, places, truth, looks.samples, epsilon)
    of_global, of_caustics = _map_errors(flat, pilot, photons, looks)
    figures = with_unfound(looks, of_global)
    if of_global is not None:
        of_global = of_global.of_light(figures.indirect)
    plans, queries = map_plans(pilot, photons, flat), _map_queries(places, looks.samples, pilot)
    cached = replace(photons, indirect=Indirect.CACHE)
    unread = unread_at(pilot, cached, plans, queries.position, queries.normal)
    bias = 0.0
    if caustics.are_found:
        wanted = [
            (path["beauty"] - photon["beauty"]).mean(axis=2)
            for path, photon in zip(looks.paths.layers, looks.photons.layers, strict=True)
        ]
        bias = map_bias(pilot, plans, photons.k, queries, wanted, 1.0 / (truth.mean(axis=2) ** 2 + epsilon))
    grain = caustic_grain(pilot, places, truth, looks.samples, epsilon)
    pilot.worker.set_view(view_of(flat, photons, 1))
    sites = sites_about(pilot, cached, plans)
    off = mean_error(flat, pilot, places.all("position"), places.all("normal"), looks.share_of_indirect, sites)
    trial = looks.trial(caustics, unread, (of_global, of_caustics), bias, grain)
    return replace(trial, by_paths=figures, mean_error=off)


def _map_errors(
    flat: FlatScene, pilot: PhotonPilot, photons: RenderSettings, looks: Looks
) -> tuple[MapError | None, MapError | None]:
    """What gathers of the global and the caustic map get wrong, at some of the places that a trial has seen.

    Paths hardly ever find what caustics there are.
    """
    places, truth, epsilon = looks.places, looks.truth, looks.epsilon
    pixel = places.all("pixel")
    if not len(pixel):
        return None, None
    some = _some(len(pixel), pilot)
    position, normal = places.all("position")[some], places.all("normal")[some]
    radiance = truth.mean(axis=2).reshape(-1)[pixel[some]]
    of_sample = len(pixel) / (looks.samples * truth.shape[0] * truth.shape[1])  # places
    weight = places.all("weight")[some].mean(axis=1).astype(np.float64)
    reflected = weight * float(INV_PI)
    of_caustics, of_global = (
        reflected * irradiance_by(pilot, number, position, normal) for number in (CAUSTIC_MAP, GLOBAL_MAP)
    )
    # Paths may not have found what photons tell: what a map shows is no more than all light.
    factor, among_caustics = (
        reflected * math.sqrt(of_sample) / np.sqrt(light**2 + epsilon)
        for light in (np.maximum(radiance, of_global), radiance + of_caustics)
    )
    area, plans = _pixel_areas(flat.camera, position, normal), map_plans(pilot, photons, flat)

    def error(number: int, k: int, each: Values) -> MapError | None:
        stored = max(len(pilot.photons[number]["id"]), 1)
        reach = plans.maps[number].radius * math.sqrt(plans.expected[number] / stored)
        return map_error(pilot, number, k, position, normal, each, area, reach)

    return error(GLOBAL_MAP, photons.k, factor), error(CAUSTIC_MAP, photons.caustic_k, among_caustics)


def _map_queries(places: SeenPlaces, samples: int, pilot: PhotonPilot) -> MapQueries:
    """Some of the places that an image of so many samples a pixel has seen."""
    pixel = places.all("pixel")
    some = _some(len(pixel), pilot)
    of_each = len(pixel) / max(len(some), 1) / samples
    share = places.all("weight")[some].mean(axis=1, dtype=np.float64) * float(INV_PI) * of_each
    return MapQueries(places.all("position")[some], places.all("normal")[some], pixel[some], share)


def _some(count: int, pilot: PhotonPilot) -> NDArray[np.intp]:
    """Up to GATHERED_PLACES of so many places, fewer of a short pilot."""
    most = min(max(GATHERED_PLACES * pilot.paths // (2 * LEAST_PATHS), LEAST_GATHERED), GATHERED_PLACES)
    return np.linspace(0, max(count - 1, 0), min(most, count)).astype(np.intp)


def _pixel_areas(camera: Camera, position: NDArray[np.float32], normal: NDArray[np.float32]) -> Values:
    """Of the surface that a pixel of a camera sees at some places, if it sees them directly, shape [P]."""
    axes, eye = np.asarray(camera.to_world, np.float64)[:3, :3], np.asarray(camera.to_world, np.float64)[:3, 3]
    whole = camera.width if camera.full_size is None else camera.full_size[0]
    scale = math.sqrt((axes[:, 0] ** 2).sum())
    way = position.astype(np.float64) - eye
    distance = np.sqrt((way**2).sum(axis=1))
    if camera.orthographic:
        side, way = np.full(len(way), 2.0 * scale / whole), np.broadcast_to(axes[:, 2], way.shape)
    else:
        side = 2.0 * tangent(camera.fov_x / 2) * distance / whole
    cosine = np.abs((way * normal).sum(axis=1)) / np.maximum(np.sqrt((way**2).sum(axis=1)), 1e-30)
    return np.asarray(side**2 / np.maximum(cosine, LEAST_COSINE))
