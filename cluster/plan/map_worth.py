"""What a photon map is worth: the light that it would show, against all light where that falls.

Photons of a map are asked for by number, and where hardly a path stores one, ten times as many paths would be shot.
That pays where the map's light is seen. A caustic that is a hundredth of the light about it may be blurred and may be
noisy, and nobody will know; one that no path of the pilot has found is not there.

Nor is a map worth being finer than the image is exact. What its gathers get wrong besides is noise, which is that of k
photons however many there are, but for pixels so large that their samples ask different ones; and blur, which is that
of the radius in which these k lie. Both are told by the pilot's photons, at places that the camera sees (MapError).
What all pixels have in common of a map's errors is told apart (trial.mean_error).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from wdpm.cluster.batch import Arrays, take
from wdpm.cluster.plan.photon_pilot import PhotonPilot, direct_photons
from wdpm.cluster.plan.pilot_gathers import AmongPhotons
from wdpm.kernels.photons.deposits import CAUSTIC_MAP, GLOBAL_MAP, VOLUME_MAP
from wdpm.kernels.photons.flight import BOUNCE_BITS

PATHS_A_PHOTON = 10
"""Most paths for each photon that is asked for: where hardly any path stores one, as under the open sky or far from
the only mirror, indirect light is faint, and fewer photons tell it. The report says how many were stored."""

LEAST_PATHS = 1 << 15
"""Paths that cost next to nothing: fewer are not worth thinking about."""

SEEN_SHARE = 0.2
"""Share of the light about it from which on a map's light is worth a path for each camera sample. A path takes a tenth
of what a sample does; and what few photons tell of a tenth of the light are patches. In a room lit by the sun through
blinds, 182 photons that chrome legs of chairs had thrown on a floor made parts of it 7 to 14 % too bright."""

PLAIN_SHARE = 0.25
"""Share of the light about it from which on a map's light is worth all these paths. The noise of an image that comes of
n photons is as the square of their light's share, over n: for fainter light as many fewer paths give it the same noise.
One for each photon that is asked for costs little, and is always shot."""

PLACES = 1024
"""Caustic photons of the pilot at which caustic light is held against all light."""

PHOTONS_A_GATHER = 16
"""A gather averages over no more than this part of a map's photons: a few photons tell where light is by small k, and
with large k not at all."""

LEAST_K = 8
"""Photons that such a gather looks for, at least."""

UNSEEN = 3.0
"""What happens to so many of N on average is seen in N with a probability of 95 % (the rule of three)."""


@dataclass(frozen=True)
class MapWorth:
    """What the pilot tells of one map.

    Attributes:
        stored: photons that the pilot stored in it.
        share: of its light in all light where it falls, by flux: 0 to 1.
    """

    stored: int
    share: float

    @property
    def paths_a_photon(self) -> float:
        """Most paths that are worth shooting for each photon that is asked for; none for a map that stays empty."""
        if not self.stored:
            return 0.0
        return max(1.0, PATHS_A_PHOTON * min(1.0, self.share / PLAIN_SHARE) ** 2)

    def paths(self, asked: int, pilot_paths: int, samples: int = 0) -> int:
        """Paths for so many photons, or as many as are worth it.

        Args:
            samples: of the camera, in a pass.
        """
        if not self.stored:
            return 0
        cheap = max(LEAST_PATHS, int(samples * min(1.0, self.share / SEEN_SHARE)))
        worth = max(self.paths_a_photon * asked, min(PATHS_A_PHOTON * asked, cheap))
        return min(math.ceil(asked * pilot_paths / self.stored), math.ceil(worth))


def worth_of_caustics(pilot: PhotonPilot) -> MapWorth:
    """What the caustic map is worth: caustic light against all light, where caustic photons of the pilot fell."""
    own = pilot.photons[CAUSTIC_MAP]
    if not len(own["id"]):
        return MapWorth(0, 0.0)
    direct, of_direct = direct_photons(pilot)
    places = take(own, _by_flux(own))
    position, normal = places["position"], places["normal"]
    caustic = irradiance_by(pilot, CAUSTIC_MAP, position, normal)
    others = irradiance_by(pilot, GLOBAL_MAP, position, normal)
    if len(direct["id"]):
        found, _ = AmongPhotons(pilot.cell, direct).gather(position, normal, pilot.world.extent)
        others += found.astype(np.float64) / of_direct
    whole = caustic + others
    share = np.divide(caustic, whole, out=np.zeros_like(whole), where=whole > 0)
    return MapWorth(len(own["id"]), float(share.mean()))


def worth_of_volume(pilot: PhotonPilot) -> MapWorth:
    """What a volume map is worth: the flux that media scatter, against all that the pilot's photons brought."""
    volume = _flux(pilot.photons[VOLUME_MAP])
    whole = volume + _flux(pilot.photons[GLOBAL_MAP])
    return MapWorth(len(pilot.photons[VOLUME_MAP]["id"]), volume / whole if whole > 0 else 0.0)


def fewer_neighbours(k: int, expected: float) -> int:
    """Photons that a gather looks for in a map of so many."""
    return min(k, max(LEAST_K, int(expected / PHOTONS_A_GATHER)))


def caustics_in_words(worth: MapWorth, pilot: PhotonPilot, asked: int, paths: int) -> str | None:
    """What was decided of the caustic map, and why; None where as many photons are shot for as were asked for."""
    if not pilot.world.caustic_map.paths:
        return None
    if not worth.stored:
        most = UNSEEN / pilot.paths
        return (
            f"caustics: no map, since none of {pilot.paths:,} paths aimed at glossy surfaces stored a photon "
            f"(less than {most:.2%} of them do)"
        )
    if paths < min(math.ceil(asked * pilot.paths / worth.stored), PATHS_A_PHOTON * asked):
        expected = worth.stored * paths / pilot.paths
        return (
            f"caustics: {paths:,} paths for some {expected:,.0f} photons, since {worth.stored:,} of {pilot.paths:,} "
            f"store one, and they bring {worth.share:.1%} of the light where they fall"
        )
    return None


def _by_flux(photons: Arrays) -> NDArray[np.intp]:
    """Up to PLACES photons, spaced evenly by flux."""
    summed = np.cumsum(photons["flux"].mean(axis=1, dtype=np.float64))
    count = min(PLACES, len(summed))
    steps = (np.arange(count) + 0.5) / count * summed[-1]
    return np.minimum(np.searchsorted(summed, steps), len(summed) - 1)


def _flux(photons: Arrays) -> float:
    return float(photons["flux"].mean(axis=1, dtype=np.float64).sum())


FEWEST = 4
"""A map whose errors are seen has at least this part of the photons that are asked for by default: the fewer there are,
the wider are the patches in which noise is alike, and the more of it is seen."""

FAINT = 0.1
"""Error of a map, as a share of what samples leave, that is not seen beside it, however wide its patches are."""

FAINTEST = 64
"""A map of such faint light has at least this part of the photons asked for, and those of LEAST_DISCS gathers."""

LEAST_DISCS = 4

ALIKE = 1.05
"""Error times price, of the least, up to which more photons are taken: figures are no more exact than that."""

LEAST_GAIN = 0.7
"""What error times price must fall to for it: patches of noise that are wider are seen more easily, and by other seeds
blur is told to be half as much again. Where a quarter of the photons was no gain (sponza with 4 samples: squared error
1.75 times as large) it is told to be 0.75 to 0.84, where it was one (the Cornell box with 2) 0.5."""

LEAST_GAIN_UNSEEN = 0.9
"""The same where nobody sees a map's patches: gather rays read it, or it is FAINT beside samples. With 2 samples
(256x256, one seed) a quarter of the photons that gather rays read changed relMSE by 0 to 3 % in the Cornell box,
sibenik, sponza and among bunnies, and blotches by no more than 0.1 % of the light. With 16 among spheres under the open
sky, a quarter of both maps' photons changed it by 0.5 %, for 0.69 of the CPU time."""

ORDINARY_BLUR = 8.0
"""What blur is, as a share of squared light, times the gathers that all photons of a map would do for. Measured 3.8 in
the Cornell box, 7 among bunnies, 14 in sponza, 54 in sibenik."""

GATHERED_BLUR = 0.1
"""Of a map's blur, what is left where gather rays read it. Of what 62,500 and 15,000 photons get wrong besides what
250,000 do, 0.25 and 0.12 in uplight-room, and 0.01 in sibenik, by 16 samples and the irradiance cache."""

LEAST_HELD = 1e-4
"""Share of the k photons of a gather from which on fewer make no difference: so few are noise already."""

TELL_BLUR = 1 << 14
"""Photons of a pilot that tell blur: of 7,371 it was told to be 1.2 in a chapel where 29,266 told 41."""

BLUR_K = 4
"""Blur is what k photons tell otherwise than this part of them, the nearest."""


@dataclass(frozen=True)
class MapError:
    """What gathers of a map of surfaces get wrong, as relMSE, whatever the samples.

    Attributes:
        k: photons that a gather looks for.
        squares: gathered light at places that the camera sees, squared and weighted as relMSE is, shape [P].
        noise: variance of a gather of k photons there, weighted likewise: 1 / k of the square if all are alike, and
            more where few of them bring most of the light, shape [P].
        discs: of each place, how many gathers of k photons lie beside each other in its pixel, in a map of one photon,
            shape [P].
        blur: in a map of one photon.
        held: photons that the widest gather finds there, however many the map has, since its radius goes by their
            density where most of them lie, shape [P].
    """

    k: int
    squares: NDArray[np.float64]
    noise: NDArray[np.float64]
    discs: NDArray[np.float64]
    blur: float
    held: NDArray[np.float64]

    def of(self, photons: float, spp: int, *, gathered: bool = False) -> float:
        """In a map of so many photons, of a pixel of so many samples.

        Blur falls at least as its radius' square does: a border of light is wrong as far as gathers reach over it.
        Where the widest gather holds fewer than k photons there is less of it, and the more noise. Of photons that
        hardly ever come hardly any gather has one, which then counts for all of them.

        Args:
            gathered: the map is read by many gather rays, which average out noise, but for that of all its photons,
                and most of the blur.
        """
        full, blur = np.clip(self.held / self.k, LEAST_HELD, 1.0), self.of_blur(photons)
        if gathered:
            return GATHERED_BLUR * blur + float((self.noise / full).mean()) * self.k / photons
        differ = np.minimum(1.0 + self.discs * photons, spp)
        return float((self.noise / (differ * full)).mean()) + blur

    def is_faint(self, photons: float, spp: int, of_samples: float, *, gathered: bool = False) -> bool:
        """Whether a map of so many photons is not seen beside what samples leave, as relMSE."""
        return self.of(photons, spp, gathered=gathered) <= FAINT * of_samples

    def of_blur(self, photons: float) -> float:
        """The part of it that is blur, in a map of so many photons."""
        full = np.clip(self.held / self.k, LEAST_HELD, 1.0)
        return min(self.blur * float(full.mean()) / photons, float(self.squares.mean()))  # at worst, all is elsewhere

    def of_light(self, square: float) -> MapError:
        """The same where light is known to be as much by other means: the pilot's wide gathers reach past surfaces.

        Args:
            square: mean square of what the map shows, as relMSE is weighted.
        """
        told = float(self.squares.mean())
        more = max(square / told, 1.0) if told > 0.0 else 1.0
        return replace(self, squares=self.squares * more, noise=self.noise * more, blur=self.blur * more)


def fewer_shares(error: MapError, expected: float, spp: int, of_samples: float, *, gathered: bool) -> tuple[int, ...]:
    """Parts of a map's photons that may be enough, as 1 of so many.

    Args:
        expected: photons of the whole map.
        of_samples: error that samples leave, as relMSE.
        gathered: whether gather rays read the map.
    """
    halves = [1 << half for half in range(FAINTEST.bit_length())]

    def serves(share: int) -> bool:
        photons = expected / share
        faint = error.is_faint(photons, spp, of_samples, gathered=gathered)
        return share <= FEWEST or (faint and photons >= LEAST_DISCS * error.k)

    return tuple(share for share in halves if serves(share))


def best_shares(
    worths: Mapping[tuple[int, ...], float],
    is_seen: Callable[[tuple[int, ...]], bool],
    of_mean: Callable[[tuple[int, ...]], float] = lambda _: 0.0,
) -> tuple[int, ...]:
    """The parts of each map's photons, as 1 of so many, to be taken.

    Args:
        worths: error times price by such parts, those of all photons among them.
        is_seen: whether patches of maps of such parts, fewer than all photons, are seen beside the samples.
        of_mean: error times price of the image's mean, which fewer photons are not to raise.
    """
    all_of_them = tuple(1 for _ in next(iter(worths)))

    def gains(shares: tuple[int, ...]) -> bool:
        if shares == all_of_them:
            return True
        least = LEAST_GAIN if is_seen(shares) else LEAST_GAIN_UNSEEN
        return worths[shares] <= least * worths[all_of_them] and of_mean(shares) <= of_mean(all_of_them)

    worth = {shares: worths[shares] for shares in worths if gains(shares)}
    return min(shares for shares in worth if worth[shares] <= ALIKE * min(worth.values()))


def irradiance_by(
    pilot: PhotonPilot, number: int, position: NDArray[np.float32], normal: NDArray[np.float32]
) -> NDArray[np.float64]:
    """What the pilot's photons of a map bring to some places [W / m²], mean of RGB, shape [P].

    Args:
        number: of the map.
        position, normal: of the places, shape [P, 3].
    """
    paths = pilot.world.maps[number].paths
    if not paths or not len(pilot.photons[number]["id"]):
        return np.zeros(len(position))
    found, _ = pilot.among(number).gather(position, normal, pilot.world.extent)
    return found.astype(np.float64) / paths


def map_error(
    pilot: PhotonPilot,
    number: int,
    k: int,
    position: NDArray[np.float32],
    normal: NDArray[np.float32],
    factor: NDArray[np.float64],
    area: NDArray[np.float64],
    reach: float,
) -> MapError | None:
    """What gathers of a map get wrong at some places; None where the pilot has none of its photons.

    Two halves of the pilot's photons are gathered from by k and by fewer: the product of the differences is the square
    of what both miss, without the noise of either. Where the pilot has few, it is told by a smaller k, whose radius is
    as much smaller. That, or what a short pilot tells, is hardly more than a guess, so blur is then taken to be no less
    than in an ordinary room.

    Args:
        number: of the map.
        position, normal: of the places, shape [P, 3].
        factor: by which irradiance at a place is an error of its pixel, as the root of relMSE has it, shape [P].
        area: of the surface that a pixel sees there, shape [P].
        reach: of the widest gather, in a map of as many photons as the pilot has.
    """
    photons, paths = pilot.photons[number], pilot.world.maps[number].paths
    stored = len(photons["id"])
    if not paths or stored < 2 * BLUR_K or not len(position):
        return None
    told = min(k, max(stored // (2 * BLUR_K), min(LEAST_K, stored // 4)))
    few = max(told // BLUR_K, 1)
    path = photons["id"] >> BOUNCE_BITS
    differences, (whole, noise, radius2) = [], np.zeros((3, len(position)))
    flux = photons["flux"].mean(axis=1)
    strongest = max(float(flux.max()), float(np.finfo(np.float32).tiny))
    # Gathered by one and the same search: shares of the strongest photon's flux, and their squares.
    shares = np.zeros((stored, 3), np.float32)
    shares[:, 0] = flux / strongest
    shares[:, 1] = shares[:, 0] ** 2
    for odd in (0, 1):
        half = take({**photons, "flux": shares}, np.flatnonzero(path % 2 == odd))
        among = AmongPhotons(pilot.cell, half)
        wide, narrow = (
            among.gather_each(position, normal, pilot.world.extent, neighbours) for neighbours in (told, few)
        )
        of_share = factor * (strongest * 2.0 / paths)
        brought = wide[0][:, 0].astype(np.float64)
        differences.append((brought - narrow[0][:, 0]) * of_share)
        whole += brought * of_share / 2.0
        squared_radius = np.maximum(wide[1].astype(np.float64) ** 2, np.finfo(np.float32).tiny)
        radius2 += squared_radius / 2.0
        noise += wide[0][:, 1] * of_share**2 / (math.pi * squared_radius) / 2.0
    wider = stored / 2.0 * k / told
    of_one = radius2 * math.pi * wider
    blur = max(float((differences[0] * differences[1]).mean()), 0.0) * wider
    if told < k or stored < TELL_BLUR:
        blur = max(blur, ORDINARY_BLUR * k * float((whole**2).mean()))
    held = 2.0 * told * reach**2 / radius2  # all photons are two halves
    return MapError(k, whole**2, noise * (told / k), area / of_one, blur, held)
