"""Sweeps of `wdpm accuracy`: what is typed, the points that follow from it, their commands, and the Pareto front."""

from __future__ import annotations

import shlex
from argparse import ArgumentTypeError

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wdpm.accuracy.facts import Facts
from wdpm.accuracy.knobs import KNOBS, Knob, Value, parse_sweep
from wdpm.accuracy.pareto import pareto_front
from wdpm.accuracy.plan import SPREADS, CostModel, default_points, default_sweeps, left_out_in_words, total_seconds
from wdpm.accuracy.points import Point, command_of, plan_points
from wdpm.accuracy.run import renders_in_order
from wdpm.cli.main import make_parser
from wdpm.cli.options import chosen_settings
from wdpm.cluster.render_settings import Indirect, RenderSettings
from wdpm.scenes.errors import SettingsError

CHOSEN: dict[str, Value] = {"radius": 0.25, "caustic_radius": 0.1, "volume_radius": 0.5, "light_samples": 4}


def knob(name: str) -> Knob:
    return next(each for each in KNOBS if each.name == name)


# ---- what is typed ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("k=20,50,120", (20, 50, 120)),
        ("k=120,20,50,20", (20, 50, 120)),
        ("photons=50k..800k:3", (50_000, 200_000, 800_000)),
        ("spp=1..256", (1, 4, 16, 64, 256)),
        ("caustic-photons=1k,2k", (1000, 2000)),
        ("band=0..1", (0.0, 0.25, 0.5, 0.75, 1.0)),
        ("slaves=0,2,4", (0, 2, 4)),
        ("slaves=0..4:3", (0, 2, 4)),
        ("radius=0.1,0.4", (0.1, 0.4)),
        ("indirect=map,cache", (Indirect.MAP, Indirect.CACHE)),
        ("passes=4", (4,)),
    ],
)
def test_values_of_a_sweep(text: str, values: tuple[object, ...]) -> None:
    sweep = parse_sweep(text)
    assert sweep.values == values
    assert not sweep.factors


def test_radii_may_be_factors() -> None:
    sweep = parse_sweep("radius=0.5x..2x:3")
    assert sweep.factors
    assert sweep.values == (0.5, 1.0, 2.0)
    assert parse_sweep("radius=0.5x,2x").factors


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("photons", "is not a sweep"),
        ("=5", "is not a sweep"),
        ("photons=", "is empty"),
        ("fotons=1,2", "there is no knob 'fotons'"),
        ("photons=4M..50k", "smaller end first"),
        ("photons=5k..5k", "smaller end first"),
        ("photons=1k..2k:1", "number of steps"),
        ("photons=1k..2k:x", "number of steps"),
        ("photons=many", "is not a count"),
        ("photons=1k,,2k", "is not a count"),
        ("photons=0", "at least 1"),
        ("spp=0..16", "at least 1"),
        ("k=0.5", "is not a count"),
        ("band=-1..1", "share of the gather radius"),
        ("band=nan", "share of the gather radius"),
        ("radius=0", "positive length"),
        ("radius=inf", "positive length"),
        ("radius=0.5x,2", "give all as factors"),
        ("indirect=map..cache", "have no order"),
        ("indirect=fast", "must be one of"),
    ],
)
def test_what_is_no_sweep(text: str, complaint: str) -> None:
    with pytest.raises(ArgumentTypeError, match=complaint):
        parse_sweep(text)


@given(st.integers(1, 10**7), st.integers(2, 10**7), st.integers(2, 12))
def test_a_range_keeps_its_ends_and_its_order(low: int, more: int, steps: int) -> None:
    values = parse_sweep(f"photons={low}..{low + more}:{steps}").values
    assert (values[0], values[-1]) == (low, low + more)
    assert list(values) == sorted(set(values))
    assert len(values) <= steps


# ---- points -------------------------------------------------------------------------------------------------------


def test_one_knob_is_turned_at_a_time_and_all_curves_meet_at_the_base() -> None:
    base = Point(RenderSettings(photons=1000, k=50))
    points = plan_points(base, [parse_sweep("photons=500,2k"), parse_sweep("k=20,50")], CHOSEN)
    assert points.points[0] == base
    assert [(p.settings.photons, p.settings.k) for p in points.points] == [
        (1000, 50),
        (500, 50),
        (2000, 50),
        (1000, 20),
    ]
    photons, k = points.curves
    assert photons.values == (500, 1000, 2000)
    assert photons.points == (1, 0, 2)
    assert (k.values, k.points) == ((20, 50), (3, 0))
    assert photons.base == k.base == 0


def test_factors_are_of_the_radius_that_the_base_has() -> None:
    points = plan_points(Point(RenderSettings()), [parse_sweep("radius=0.5x..2x:3")], CHOSEN)
    assert [p.settings.radius for p in points.points] == [None, 0.125, 0.5]
    assert points.curves[0].values == (0.125, 0.25, 0.5)


def test_shadow_rays_are_swept_around_what_the_renderer_chooses() -> None:
    base = Point(RenderSettings())
    points = plan_points(base, [parse_sweep("light-samples=1,4,8")], CHOSEN)
    assert [p.settings.light_samples for p in points.points] == [None, 1, 8]
    curve = points.curves[0]
    assert (curve.values, curve.points, curve.base) == ((1, 4, 8), (1, 0, 2), 0)
    given = plan_points(Point(RenderSettings(light_samples=2)), [parse_sweep("light-samples=1,4")], CHOSEN)
    assert given.curves[0].values == (1, 2, 4)


def test_a_band_needs_slaves_and_says_that_it_is_inexact() -> None:
    points = plan_points(Point(RenderSettings()), [parse_sweep("band=0,0.5"), parse_sweep("slaves=0,2")], CHOSEN)
    band, slaves = points.curves
    assert band.values == (0.0, 0.5, 1.0)
    assert [points.points[n].settings.inexact for n in band.points] == [True, True, False]
    assert all(points.points[n].slaves == 2 for n in band.points)
    assert band.base == slaves.points[-1], "the exact image is rendered once"


@pytest.mark.parametrize(
    ("sweeps", "complaint"),
    [
        (["k=1,2", "k=3"], "swept twice"),
        (["k=20,900"], "^--sweep k=20,900: k is 900; expected at most 500"),
        (["k=1..100000"], r"^--sweep k=1\.\.100000: k is 100000; expected at most 500"),
        (["passes=1,32"], "^--sweep passes=1,32: passes is 32, more than spp, which is 16"),
        (["volume-photons=5M"], "at most 4,194,304"),
        (["photons=3G"], "at most 2,147,483,647"),
    ],
)
def test_points_that_no_render_can_have(sweeps: list[str], complaint: str) -> None:
    with pytest.raises(SettingsError, match=complaint):
        plan_points(Point(RenderSettings(spp=16)), [parse_sweep(each) for each in sweeps], CHOSEN)


@pytest.mark.parametrize("slaves", [0, 3])
def test_the_command_of_a_point_gives_its_settings_back(slaves: int) -> None:
    defaults = RenderSettings(spp=64)
    settings = RenderSettings(
        spp=8, photons=1234, passes=4, indirect=Indirect.CACHE, radius=0.1, without=("bump", "lens")
    )
    words = shlex.split(command_of(Point(settings, slaves), 7, ["a scene.xml", "-D", "x=1"], defaults, 2))
    assert words[0] == "wdpm"
    args = make_parser().parse_args(words[1:])
    assert (args.scene, args.slaves, args.threads, args.definitions) == ("a scene.xml", slaves, 2, [("x", "1")])
    assert RenderSettings(**{"spp": defaults.spp, **chosen_settings(args)}) == RenderSettings(
        **{**vars(settings), "seed": 7}
    )


def test_every_render_is_made_once_and_seed_by_seed() -> None:
    points = plan_points(Point(RenderSettings()), [parse_sweep("k=1..100:7"), parse_sweep("spp=1,2,4")], CHOSEN)
    order = renders_in_order(points, (5, 6, 7))
    assert sorted(map(repr, order)) == sorted(repr((p, seed)) for p in points.points for seed in (5, 6, 7))
    assert [seed for _, seed in order] == [seed for seed in (5, 6, 7) for _ in points.points]
    assert [p for p, _ in order[: len(points.points)]] != list(points.points)


# ---- the default sweep --------------------------------------------------------------------------------------------


NO_OTHER_MAPS = {"caustic_photons": "the scene has none", "volume_photons": "the scene has none"}
BY_REQUEST = {"caustic_k", "caustic_radius", "volume_samples", "volume_radius"}


def facts_of(settings: RenderSettings) -> Facts:
    """Of a scene with one map, whose radius shrinks with more photons."""
    return Facts({}, ("global",), (250.0 / settings.photons**0.5, 1.0, 1.0), 4, NO_OTHER_MAPS)


def model(sample: float) -> CostModel:
    return CostModel(fixed=0.1, photon=1e-6, sample=sample, k=50)


@pytest.mark.parametrize("sample", [1e-4, 0.01, 0.1, 1.0])
def test_the_default_sweep_fits_into_its_time(sample: float) -> None:
    points = default_points(Point(RenderSettings()), model(sample), facts_of, 3, 225.0)
    assert total_seconds(points, model(sample), 3, ["global"]) <= 225.0
    assert {curve.knob.name for curve in points.curves} >= {
        "photons",
        "k",
        "radius",
        "spp",
        "band",
        "slaves",
        "indirect",
        "light_samples",
    }


def test_a_scene_that_is_too_slow_gets_the_cheapest_sweep() -> None:
    points = default_points(Point(RenderSettings()), model(1000.0), facts_of, 3, 225.0)
    assert points.base.settings.spp == 1
    assert points.base.settings.photons < RenderSettings().photons
    curve = points.curve_of("radius")
    assert curve is not None
    own = facts_of(points.base.settings).radii[0]
    assert curve.values[curve.points.index(0)] == own, (
        "the radius of the base that is rendered, not of the one asked for"
    )


def test_a_fast_scene_gets_wider_curves() -> None:
    fast = default_points(Point(RenderSettings()), model(1e-4), facts_of, 3, 225.0)
    slow = default_points(Point(RenderSettings()), model(0.4), facts_of, 3, 225.0)
    assert len(fast.points) > len(slow.points)


def test_knobs_that_the_render_has_a_use_for_are_swept() -> None:
    everything = {sweep.knob.name for sweep in default_sweeps(RenderSettings(), SPREADS[-1], {})}
    assert everything == {each.name for each in KNOBS} - BY_REQUEST
    some = {sweep.knob.name for sweep in default_sweeps(RenderSettings(), SPREADS[-1], NO_OTHER_MAPS)}
    assert everything - some == {"caustic_photons", "volume_photons"}
    assert "photons" not in {sweep.knob.name for sweep in default_sweeps(RenderSettings(photons=0), SPREADS[-1], {})}


@pytest.mark.parametrize("spp", [1, 2, 3, 16])
def test_passes_are_swept_unless_there_is_one_sample(spp: int) -> None:
    sweeps = default_sweeps(RenderSettings(spp=spp), SPREADS[0], {})
    passes = [sweep.values for sweep in sweeps if sweep.knob.name == "passes"]
    assert passes == {1: [], 2: [(1, 2)], 3: [(1, 3)], 16: [(1, 4, 16)]}[spp]


def test_the_plan_says_what_is_not_swept_and_why() -> None:
    base = Point(RenderSettings(spp=1))
    points = plan_points(base, default_sweeps(base.settings, SPREADS[-1], NO_OTHER_MAPS), CHOSEN)
    assert left_out_in_words(points, NO_OTHER_MAPS) == [
        "  not swept: passes (each pass needs a sample of its own, and the base has 1)",
        "  not swept: caustic-photons, volume-photons (the scene has none)",
        "  not swept: caustic-k, caustic-radius, volume-samples, volume-radius (only where --sweep asks for it)",
    ]


def test_shadow_rays_cost_time() -> None:
    four = CostModel(fixed=0.0, photon=0.0, sample=1.0, k=50, light_samples=4)
    seconds = [four.seconds(Point(RenderSettings(light_samples=rays)), []) for rays in (1, None, 4, 16)]
    assert seconds == sorted(seconds)
    assert seconds[1] == seconds[2] == 16.0


# ---- the Pareto front ---------------------------------------------------------------------------------------------

costs = st.lists(st.tuples(st.sampled_from([1.0, 2.0, 3.0, 5.0]), st.sampled_from([-1.0, 0.0, 1.0, 2.0])), max_size=12)


def dominates(one: tuple[float, float], other: tuple[float, float]) -> bool:
    return one[0] <= other[0] and one[1] <= other[1] and one != other


@given(costs)
def test_no_point_of_the_front_is_dominated_and_all_others_are(costs: list[tuple[float, float]]) -> None:
    front = pareto_front(costs)
    assert not any(dominates(other, costs[i]) for i in front for other in costs)
    for i in set(range(len(costs))) - set(front):
        assert any(dominates(costs[j], costs[i]) or costs[j] == costs[i] for j in front)
    assert [costs[i][0] for i in front] == sorted({costs[i][0] for i in front})
