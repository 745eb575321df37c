"""Photons steered towards what is seen: where that pays, and nowhere else; the same mean, and the same bits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from furnaces import quad
from window_room import hut_before_a_mirror, hut_on_a_field, open_ground, sky

from wdpm.cluster.plan.effects import features_of
from wdpm.cluster.plan.photon_pilot import LEAST_PATHS, PhotonPilot, fly_pilot
from wdpm.cluster.plan.render_plan import make_render_plan
from wdpm.cluster.plan.steering import caustics
from wdpm.cluster.plan.steering.caustics import FEW
from wdpm.cluster.plan.steering.pilot import WORTH, emission_of, steered_pilot, steering_in_words
from wdpm.cluster.plan.steering.tree import UNSTEERED, Known, Sample, learn, weights
from wdpm.cluster.plan.view import view_of
from wdpm.cluster.render_settings import Integrator, RenderSettings
from wdpm.cluster.world import NO_STEERING, START_NUMBERS, View
from wdpm.kernels.compile import compile_kernels
from wdpm.kernels.launch import Launcher
from wdpm.kernels.photons.deposits import CAUSTIC_MAP, GLOBAL_MAP
from wdpm.rendering.automatic_settings import choose_settings
from wdpm.scenes import cornell_box
from wdpm.scenes.flat.flatten import FlatScene, flatten
from wdpm.scenes.model.bsdfs import Conductor
from wdpm.scenes.model.scene import Material, Scene

PHOTONS = RenderSettings(integrator=Integrator.PHOTONS, spp=4, photons=20_000)


def flown(what: Scene, threads: int = 1) -> PhotonPilot:
    flat = flatten(what)
    pilot = fly_pilot(flat, features_of(flat, PHOTONS), PHOTONS, Launcher("cpu", threads))
    return steered_pilot(flat, pilot, view_of(flat, PHOTONS, 1))


@pytest.fixture
def whatever_the_samples(monkeypatch: pytest.MonkeyPatch) -> None:
    """Caustic photons are steered in small images, too."""
    monkeypatch.setattr(caustics, "SAMPLES_A_PATH", 0)


def sample_of(count: int, seed: int = 1) -> Sample:
    """Paths of use where two of their numbers lie about the middle, as those of a car on a field do."""
    numbers = np.random.default_rng(seed).random((count, START_NUMBERS))
    return Sample(numbers, (np.abs(numbers[:, 1:3] - 0.5) < 0.05).all(axis=1) / count)


def test_a_tree_finds_what_is_of_use_and_leaves_nothing_out() -> None:
    tree, others = learn(sample_of(1 << 15)), sample_of(1 << 15, seed=2)
    assert others.moment(tree) < 0.05 * others.moment(NO_STEERING)
    least, most = (float(bound(weights(tree, others.numbers))) for bound in (np.min, np.max))
    assert least < 0.05
    assert 1.0 < most <= 1.0 / UNSTEERED + 1e-9


def test_chances_of_a_trees_leaves_are_one_in_all() -> None:
    """The volume of each leaf over its weight is its chance."""
    tree = learn(sample_of(1 << 15))
    numbers = np.random.default_rng(3).random((1 << 16, START_NUMBERS))
    chance = 1.0 / weights(tree, numbers)
    assert chance.mean() == pytest.approx(1.0, abs=4.0 * chance.std() / 2**8)


@pytest.mark.parametrize("square", [np.zeros(4096), np.ones(4096), np.eye(1, 4096)[0]])
def test_a_sample_that_tells_nothing_teaches_nothing(square: np.ndarray) -> None:
    sample = Sample(np.random.default_rng(4).random((4096, START_NUMBERS)), square)
    assert not len(learn(sample))
    known = Known()
    known.add(NO_STEERING, sample.numbers, square)
    assert not known.learn(1.0)
    assert (known.tree, known.left) == (NO_STEERING, 1.0)


def test_nothing_is_learnt_that_no_judge_can_tell() -> None:
    """Half of the paths judge what the others teach; perhaps none of theirs is of use."""
    sample, known = sample_of(1 << 12), Known()
    known.add(NO_STEERING, sample.numbers, np.where(np.arange(1 << 12) % 2 == 0, sample.square, 0.0))
    assert not known.learn(1.0)
    assert (known.tree, known.left) == (NO_STEERING, 1.0)


def test_rounds_of_paths_tell_the_same_as_unsteered_ones() -> None:
    """What steered paths tell of the whole is what others tell, by the density that all rounds have together."""
    known, rng = Known(), np.random.default_rng(5)
    for _ in range(3):
        numbers = rng.random((1 << 15, START_NUMBERS))
        chance = 1.0 / weights(known.tree, numbers)
        numbers = numbers[rng.random(len(numbers)) < chance / chance.max()]  # as many as the tree would send there
        of_use = (np.abs(numbers[:, 1:3] - 0.5) < 0.05).all(axis=1)
        known.add(known.tree, numbers, of_use * weights(known.tree, numbers))
        known.learn(1.0)
    assert known._sample().square.sum() == pytest.approx(0.01, rel=0.05)
    assert known.left < 0.05


def test_on_a_field_photons_are_steered_into_the_hut_and_carry_the_same_light() -> None:
    what = hut_on_a_field()
    flat, steered = flatten(what), flown(what)
    plain = fly_pilot(flat, features_of(flat, PHOTONS), PHOTONS, Launcher("cpu", 1))
    assert steered.left is not None
    assert steered.left < WORTH
    assert "second moment" in steering_in_words(steered)[0]
    within = []
    for pilot in (plain, steered):
        photons = pilot.photons[GLOBAL_MAP]
        inside = (np.abs(photons["position"] * flat.unit - (0, 1, 0)).max(axis=1)) <= 1.01
        within.append((inside.sum(), photons["flux"][inside].sum() / pilot.paths))
    assert within[1][0] > 10 * within[0][0]
    noise = 1.0 / np.sqrt(within[0][0])
    assert within[1][1] == pytest.approx(within[0][1], rel=4.0 * noise)


def mirror_on_a_field() -> Scene:
    """Under a sky with a sun: the ground has next to no light but theirs."""
    ground = open_ground(sky())
    mirror = replace(quad((-1, 0, -1), (2, 0, 0), (0, 1.5, 0)), material=len(ground.materials))
    materials = (*ground.materials, Material("mirror", Conductor()))
    return replace(ground, meshes=(*ground.meshes, mirror), materials=materials)


@pytest.mark.parametrize(
    ("what", "spp", "faint"),
    [(mirror_on_a_field(), 1, True), (mirror_on_a_field(), 64, False), (hut_before_a_mirror(), 1, False)],
)
def test_photons_of_indirect_light_that_samples_are_noisier_than_are_not_steered(
    what: Scene, spp: int, faint: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of one sample a pixel nobody sees where so little light comes from."""
    asked: list[bool] = []

    def noted(flat: FlatScene, pilot: PhotonPilot, view: View, *, is_faint: bool) -> PhotonPilot:
        asked.append(is_faint)
        return steered_pilot(flat, pilot, view, is_faint=is_faint)

    monkeypatch.setattr("wdpm.cluster.plan.integrator_trial.steered_pilot", noted)
    chosen = RenderSettings(integrator=Integrator.AUTO, spp=spp, all_effects=True)
    choose_settings(flatten(what), chosen, Launcher("cpu", 1), lambda features: compile_kernels("cpu", features))
    assert asked == [faint]


def test_photons_are_not_steered_to_what_is_not_seen() -> None:
    flat = flatten(hut_on_a_field())
    pilot = fly_pilot(flat, features_of(flat, PHOTONS), PHOTONS, Launcher("cpu", 1))
    assert steered_pilot(flat, pilot, view_of(flat, PHOTONS, 1), is_faint=True).left == 1.0


def test_caustic_photons_of_few_samples_are_not_steered() -> None:
    """What the rounds fly the render would fly itself."""
    small, large = hut_before_a_mirror((32, 24)), hut_before_a_mirror((512, 256))
    assert 32 * 24 * PHOTONS.spp < caustics.SAMPLES_A_PATH * caustics.ROUNDS * LEAST_PATHS
    assert flown(small).caustics_left == 1.0
    assert flown(large).caustics_left < 0.2


@pytest.mark.usefixtures("whatever_the_samples")
def test_of_the_sun_on_a_mirror_photons_are_steered_to_what_it_throws_it_on_and_carry_the_same_light() -> None:
    what = hut_before_a_mirror()
    flat, steered = flatten(what), flown(what)
    plain = fly_pilot(flat, features_of(flat, PHOTONS), PHOTONS, Launcher("cpu", 1))
    assert steered.caustics_left < 0.2
    assert "caustic photons steered" in steering_in_words(steered)[-1]
    few, many = (pilot.photons[CAUSTIC_MAP] for pilot in (plain, steered))
    assert len(many["id"]) > 8 * len(few["id"]) > 0
    flux = [photons["flux"].sum() / pilot.paths for photons, pilot in ((few, plain), (many, steered))]
    assert flux[1] == pytest.approx(flux[0], rel=4.0 / np.sqrt(len(few["id"])))


@pytest.mark.usefixtures("whatever_the_samples")
def test_caustics_that_most_paths_find_are_not_steered() -> None:
    room = cornell_box((32, 32))
    floor = next(mesh for mesh in room.meshes if "floor" in mesh.name)
    mirror = replace(floor, material=len(room.materials))
    meshes = tuple(mirror if mesh is floor else mesh for mesh in room.meshes)
    pilot = flown(replace(room, meshes=meshes, materials=(*room.materials, Material("mirror", Conductor()))))
    assert len(pilot.photons[CAUSTIC_MAP]["id"]) > FEW * pilot.paths
    assert pilot.caustics_left == 1.0
    assert not len(emission_of(pilot).caustic_steering)


def test_who_asks_for_no_steering_has_none() -> None:
    plan = make_render_plan(flatten(hut_on_a_field()), replace(PHOTONS, unsteered=True), 1, Launcher("cpu", 1))
    assert not len(plan.world.emission.steering)
    assert not any("steered" in words for words in plan.chose)


def test_in_a_closed_room_photons_stay_as_they_are() -> None:
    pilot = flown(cornell_box((32, 32)))
    assert pilot.left == 1.0
    assert not len(emission_of(pilot).steering)
    assert steering_in_words(pilot) == ()


def test_a_tree_is_the_same_on_any_number_of_threads_and_cells() -> None:
    one, two = (emission_of(flown(hut_on_a_field(), threads)) for threads in (1, 2))
    planned = make_render_plan(flatten(hut_on_a_field()), PHOTONS, 4, Launcher("cpu", 1)).world.emission
    for other in (two, planned):
        np.testing.assert_array_equal(one.share, other.share)
        for name, column in vars(one.steering).items():
            np.testing.assert_array_equal(column, getattr(other.steering, name))
