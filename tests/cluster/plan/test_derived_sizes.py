"""What is derived where nobody says: sides of buckets, shadow rays, gather rays of records."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from wdpm.cluster.plan.light_samples import light_samples_of
from wdpm.cluster.plan.view import CACHE_PLAN, view_of
from wdpm.cluster.render_settings import MOST_SHADOW_RAYS, Integrator, RenderSettings
from wdpm.rendering.pass_plan import share_of_rays, worth
from wdpm.scenes import cornell_box
from wdpm.scenes.flat.flatten import flatten
from wdpm.scenes.model.lights import PointLight

BOX = cornell_box((512, 512))
LAMP = PointLight("lamp", (0.0, 0.5, 0.0), (1.0, 1.0, 1.0))


def dark_box() -> tuple[object, ...]:
    """The meshes of the box without its lamp's light."""
    return tuple(replace(mesh, emission=None) for mesh in BOX.meshes)


def test_lamps_with_an_extent_or_several_get_several_shadow_rays() -> None:
    flat = flatten(BOX)
    assert light_samples_of(flat, RenderSettings()) == MOST_SHADOW_RAYS
    assert light_samples_of(flat, RenderSettings(light_samples=3)) == 3
    assert light_samples_of(flat, RenderSettings(integrator=Integrator.PATH)) == 1
    one = replace(BOX, meshes=dark_box(), lights=(LAMP,))
    assert light_samples_of(flatten(one), RenderSettings()) == 1
    two = replace(one, lights=(LAMP, replace(LAMP, name="other")))
    assert light_samples_of(flatten(two), RenderSettings()) == MOST_SHADOW_RAYS


@pytest.mark.parametrize(
    ("spp", "passes", "workers", "side"),
    [(4, 1, 1, 128), (16, 1, 1, 64), (64, 1, 1, 32), (64, 16, 1, 128), (4, 1, 4, 64), (4, 1, 64, 32), (4, 1, 0, 128)],
)
def test_buckets_are_as_large_as_samples_and_slaves_allow(spp: int, passes: int, workers: int, side: int) -> None:
    settings = RenderSettings(spp=spp, passes=passes)
    assert view_of(flatten(BOX), settings, workers).bucket == side
    assert view_of(flatten(BOX), replace(settings, bucket=7), workers).bucket == 7


def test_buckets_are_larger_where_the_last_of_them_are_divided() -> None:
    flat, settings = flatten(BOX), RenderSettings(spp=4)
    assert [view_of(flat, settings, workers, alone=True).bucket for workers in (1, 4, 64)] == [128, 128, 32]


def test_records_have_rays_by_samples_and_spacing() -> None:
    """In proportion to both within bounds, and gradients always have three columns."""
    plans = [worth(CACHE_PLAN, spp) for spp in (1, 8, 32, 128, 1024)]
    rays = [math.prod(plan.strata(3)) for plan in plans]  # candidates every 4 pixels
    whole = CACHE_PLAN.rows * CACHE_PLAN.columns
    assert rays == sorted(rays)
    assert rays[2] == whole
    for spp, count in zip((1, 8, 32, 128, 1024), rays, strict=True):
        assert count == pytest.approx(share_of_rays(spp) * whole, rel=0.15)  # whole rows and columns
    clearances = [plan.clearance for plan in plans]
    assert clearances == sorted(clearances, reverse=True)
    by_round = [math.prod(CACHE_PLAN.strata(number)) for number in range(CACHE_PLAN.rounds)]
    assert by_round == sorted(by_round, reverse=True)
    assert by_round[0] == pytest.approx(4 * whole, rel=0.05)
    assert replace(CACHE_PLAN, rows=1, columns=1).strata(5) == (1, 3)


def test_few_samples_have_as_few_rays_of_records_as_the_plan_allows() -> None:
    fewer = replace(CACHE_PLAN, least_rays=CACHE_PLAN.least_rays / 2)
    for spp in (1, 2, 4, 16):
        whole, half = (math.prod(worth(plan, spp).strata(3)) for plan in (CACHE_PLAN, fewer))
        share = share_of_rays(spp, fewer.least_rays) / share_of_rays(spp)
        assert half == pytest.approx(share * whole, rel=0.15)  # whole rows and columns
        assert (half < whole) == (spp < 4)


def test_records_may_err_as_samples_do_and_reach_further_beside_few() -> None:
    """As the root of the samples down to one, where gradients ask for more rays than errors do."""
    tolerances = {spp: worth(CACHE_PLAN, spp).tolerance for spp in (1, 2, 4, 32, 128)}
    for spp, tolerance in tolerances.items():
        assert tolerance == pytest.approx(CACHE_PLAN.tolerance * math.sqrt(32 / spp))
    assert worth(CACHE_PLAN, 1024).tolerance == tolerances[128]
    plans = [worth(replace(CACHE_PLAN, least=3.0, most=4.0), spp) for spp in (1, 4, 16, 64)]
    assert [plan.least for plan in plans] == pytest.approx([6.0, 3.0 * math.sqrt(2.0), 3.0, 3.0])
    assert [plan.most for plan in plans] == pytest.approx([6.0, 3.0 * math.sqrt(2.0), 4.0, 4.0])
    assert [plan.error / CACHE_PLAN.error for plan in plans] == pytest.approx([2.0, math.sqrt(2.0), 1.0, 1.0])
    spacings = [CACHE_PLAN.spacing >> number for number in range(CACHE_PLAN.rounds)]
    assert spacings == [32, 16, 8, 4, 2, 1]
    times = [CACHE_PLAN.tolerance_in(number) / CACHE_PLAN.tolerance for number in range(CACHE_PLAN.rounds)]
    assert times == pytest.approx([1.0, 1.0, 1.0, 1.0, math.sqrt(2.0), 2.0])
