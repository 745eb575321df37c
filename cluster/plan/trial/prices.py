"""What renders are expected to cost, by the figures of a trial."""

from __future__ import annotations

import math

from wdpm.cluster.plan.map_plans import MapPlans, irradiance_share
from wdpm.cluster.plan.small_view import Figures
from wdpm.cluster.plan.trial.figures import Trial
from wdpm.cluster.plan.view import CACHE_PLAN, SAMPLES_OF_PLAN, share_of_rays
from wdpm.cluster.records import LEAST_RAYS
from wdpm.cluster.render_settings import RenderSettings
from wdpm.kernels.photons.deposits import CAUSTIC_MAP, GLOBAL_MAP
from wdpm.scenes.flat.flatten import FlatScene

# Prices, about half a nanosecond of one core each. Only their ratios matter. Fitted to the CPU seconds of whole
# renders of cbox, sibenik, sponza, bunny, envmap and materials (256 x 256, 1, 2 and 4 samples), and by paths of these,
# veach-mis and uplight-room (128 x 128, 16 samples), within a factor of 1.5; those of photon paths to 16 scenes.
CAMERA_RAY = 900.0
SHADOW_RAY = 400.0
RAY_TO_LAMP = 450.0
RAY_TO_SKY = 1150.0
"""One shadow ray more where there are some already, whatever the triangles: to the sky it is picked from two ways.
Fitted to cbox, sibenik, sponza and bunny, and to envmap and materials, with four and eight of 16 samples."""
VERTEX = 1200.0
"""A ray that goes on and what it meets, but for its shadow ray."""
WHOLE_PATHS = 0.7
"""Of the prices of camera rays and vertices of path tracing: one launch follows each sample."""
PRICED_TRIANGLES = 36
"""Of the scene in which rays have these prices: half of them is the way down the tree, which is as deep as the
logarithm of all triangles."""
PLANNED_TRIANGLE = 2500.0
"""To be put into trees: by photons and paths alike."""
FINDING_OUT = 4e8
"""To fly a pilot and to ask its photons: once that is done it is no reason for either way any more."""
LOOK_BY_GUIDE = 2e8
LOOK_MOST = 0.5
"""To learn where paths are to be guided, and to see what they find then: a tenth of a second. It counts no more than
this share of the image does: thumbnails, which take less than a look, are to be rendered as larger images are."""
GATHER = 70.0
"""Of each photon that a gather looks for."""
PHOTON_PATH = 1300.0
"""As a ray, with its prices."""
STORED_PHOTON = 3000.0
"""To be put into a map."""
RECORDS = 3200
"""Of an image that is Lambertian everywhere, whatever its size: reach is a share of the image. On eight scenes 1,000 to
5,500."""
RECORD_PIXELS = 6
"""Pixels a record, at least."""
RECORD_RAY = 1700.0
"""Beside what it meets: to be stratified, stored and added."""
RECORDS_READ = 2000.0
"""To be interpolated between, where a camera path asks for them."""
COAT_SHARE = 0.25
"""Of the photons of a gather, those that gather rays look for where they arrive at coats."""

LEFT_BY_RECORDS = 0.1
"""Squared error that records may leave, as a share of what samples leave: a blotch is seen where grain of the same
error is not, and ten times less of it is not either."""

LEFT_BY_RAYS = 0.0015
"""Error that records leave, as a share of the square of indirect light, if they have the rays of SAMPLES_OF_PLAN; as
many times more as they have fewer. With 16 samples 0.001 to 0.004 on cbox and sibenik, half of it noise of rays."""

FEWEST_RAYS = 0.0625
"""Share of those rays from which on gradients would be noise, beside whatever samples."""

MOST_TOLERANCE = 1.0
"""Beyond that records get no more gather rays than one a stratum, whatever the noise."""


class Prices:
    """What renders of one pass are expected to cost: see above.

    Args:
        plans: of the maps, if it is by photons.
        spp: samples of a pixel.
    """

    def __init__(self, flat: FlatScene, plans: MapPlans, spp: int) -> None:
        self._pixels = flat.camera.width * flat.camera.height
        self._spp = spp
        self._plans = plans
        triangles = flat.triangles.total + 2
        self._ray = (1.0 + math.log(triangles) / math.log(PRICED_TRIANGLES)) / 2.0
        self._trees = flat.triangles.held * PLANNED_TRIANGLE
        self._has_sky = flat.lights.environment_pixels.size > 0

    def of_paths(self, way: Figures) -> float:
        """Of a render by path tracing."""
        return self._trees + self._pixels * self._spp * self._rays(way, WHOLE_PATHS)

    def of_photons(self, trial: Trial, settings: RenderSettings, caustic_share: int = 1) -> float:
        """Of a render by photons.

        Args:
            caustic_share: 1 of so many samples of a pixel asks the caustic map.
        """
        maps, way = self._plans.maps, trial.by_photons
        shot = sum(
            maps[number].paths * PHOTON_PATH * self._ray + self._plans.expected[number] * STORED_PHOTON
            for number in (GLOBAL_MAP, CAUSTIC_MAP)
        )
        caustic = GATHER * self._plans.caustic_k if maps[CAUSTIC_MAP].paths else 0.0
        asks = 1.0 + way.vertices
        onward = 1.0 + trial.unread * trial.by_paths.vertices  # places that a gather ray comes to
        sample, records = self._rays(way) + asks * caustic / caustic_share, 0.0
        if settings.final_gathers:  # the rays read what was gathered ahead
            shot += irradiance_share(settings) * self._plans.expected[GLOBAL_MAP] * (GATHER * settings.k + caustic)
        if settings.algorithm.has_irradiance_cache(settings):
            coats = 1.0 - trial.even
            at_coats = coats * COAT_SHARE * (GATHER * settings.k + caustic)
            ray = asks * (onward * (VERTEX + SHADOW_RAY) * self._ray + at_coats)
            sample += asks * (1.0 - coats) * RECORDS_READ + coats * ray
            records = self._record_rays(trial) * (RECORD_RAY + ray)
        elif settings.final_gathers:
            sample += asks * onward * (VERTEX + SHADOW_RAY) * self._ray
        else:
            sample += asks * GATHER * settings.k
        return self._trees + shot + records + self._pixels * self._spp * sample

    def of_more_rays(self, more: int) -> float:
        """Of so many more shadow rays of each camera sample, from the surface that it sees."""
        return self._pixels * self._spp * more * (RAY_TO_SKY if self._has_sky else RAY_TO_LAMP)

    def _rays(self, way: Figures, share: float = 1.0) -> float:
        """Of a sample, of whose camera rays and vertices such a share is taken."""
        shadow_rays = way.light_samples + way.vertices
        return (share * (CAMERA_RAY + way.vertices * VERTEX) + shadow_rays * SHADOW_RAY) * self._ray

    def _record_rays(self, trial: Trial) -> float:
        """Gather rays of all records: twice as many where these are to be as exact as they may be."""
        count = min(RECORDS, self._pixels / RECORD_PIXELS) * trial.even
        noise, indirect = trial.by_photons.noise, trial.by_paths.indirect
        share = share_of_rays(self._spp, least_rays(noise / self._spp, indirect))
        of_each = CACHE_PLAN.rows * CACHE_PLAN.columns * share
        error = tolerance_for(noise / SAMPLES_OF_PLAN, indirect)
        # What records may err falls as noise does, their strata only down to share_of_rays.
        extra = min(1.0, CACHE_PLAN.tolerance / error) * min(1.0, self._spp / SAMPLES_OF_PLAN / share)
        return count * of_each * (1.0 + extra)


def least_rays(noise: float, indirect: float) -> float:
    """The least gather rays of records, as CachePlan.least_rays: with so many they leave no more than samples do.

    With as few samples as ask for it records are most of the price, and as few rays as LEAST_RAYS most of that. Beside
    more noise than theirs, half of them do: in sibenik with one sample (256x256, two seeds) the squared error rose by
    5 % for 0.78 of the time. In uplight-room, whose samples leave next to nothing, by 9 % and blotches by a sixth.

    Args:
        noise: that samples leave, as relMSE.
        indirect: the mean square of indirect light, weighted likewise.
    """
    asked = LEFT_BY_RAYS * indirect / noise if noise > 0.0 else LEAST_RAYS
    return min(max(asked, FEWEST_RAYS), LEAST_RAYS)


def tolerance_for(noise: float, indirect: float) -> float:
    """Relative standard error that is not seen in irradiance records.

    Args:
        noise: that samples leave, as relMSE.
        indirect: the mean square of indirect light, as relMSE is weighted.
    """
    asked = math.sqrt(LEFT_BY_RECORDS * noise / indirect) if indirect else MOST_TOLERANCE
    return max(CACHE_PLAN.tolerance, min(asked, MOST_TOLERANCE))
