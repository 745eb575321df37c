"""Progressive passes: what each renders, that their mean is right, and that it can be gone on with."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wdpm.api import render
from wdpm.cluster.allotment import Allotment
from wdpm.cluster.render_settings import Indirect, Integrator, RenderSettings, Routing
from wdpm.images.image import Image
from wdpm.kernels.launch import Launcher
from wdpm.progress import Progress, SilentProgress
from wdpm.rendering import pass_journal
from wdpm.rendering import passes as module
from wdpm.rendering.in_process import InProcess
from wdpm.rendering.pass_plan import is_spread, photon_plan, plans_for, samples_of, session_of, smaller_k
from wdpm.rendering.passes import PassAverage, PassPlan, PassRenderer, shrink, spread_samples
from wdpm.rendering.prepare import Prepared, Source, prepare
from wdpm.report.report import from_dict
from wdpm.scenes import cornell_box
from wdpm.scenes.errors import ImageError, SettingsError
from wdpm.scenes.model.scene import Scene

FEW = RenderSettings(photons=2000, spp=6, passes=3, k=20)


@pytest.fixture(scope="module")
def scene() -> Scene:
    return cornell_box((20, 16))


@pytest.fixture(scope="module")
def image(scene: Scene) -> Image:
    """Three passes, rendered without interruption."""
    return render(scene, FEW)


class Stopped(Exception):
    """Stands for a Ctrl-C."""


def stop_after(monkeypatch: pytest.MonkeyPatch, count: int) -> None:
    """Have renders stop when they begin a pass of this number."""
    whole = PassRenderer.render

    def stopping(self: PassRenderer, plan: PassPlan, *samples: Allotment) -> Any:
        if plan.number == count:
            raise Stopped
        return whole(self, plan, *samples)

    monkeypatch.setattr(module.PassRenderer, "render", stopping)


# Plans.


def test_samples_are_spread_over_passes_without_a_gap() -> None:
    assert spread_samples(7, 3) == (PassPlan(0, 0, 3), PassPlan(1, 3, 2), PassPlan(2, 5, 2))
    assert spread_samples(4, 1) == (PassPlan(0, 0, 4),)


def test_samples_of_each_pass_may_be_given(scene: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    uneven = replace(FEW, spp=7, passes=3, pass_samples=(1, 4, 2))
    assert plans_for(uneven) == (PassPlan(0, 0, 1), PassPlan(1, 1, 4), PassPlan(2, 5, 2))
    assert plans_for(uneven, plans_for(uneven)[:2]) == plans_for(uneven)
    assert samples_of((1, 4, 2), given=True) == {"spp": 7, "passes": 3, "pass_samples": (1, 4, 2)}
    assert samples_of((3, 2, 2), given=False) == {"spp": 7, "passes": 3, "pass_samples": ()}
    assert [is_spread(plans_for(each)) for each in (FEW, uneven)] == [True, False]
    whole = render(scene, uneven)
    assert [each["spp"] for each in whole.metadata["report"]["passes"]] == [1, 4, 2]
    assert whole.metadata["settings"]["pass_samples"] == (1, 4, 2)
    journal = tmp_path / "passes"
    with monkeypatch.context() as patch:
        stop_after(patch, 2)
        with pytest.raises(Stopped):
            render(scene, uneven, journal=journal)
    assert render(scene, uneven, threads=1, journal=journal, resume=True).digest() == whole.digest()


@pytest.mark.parametrize(
    ("chosen", "said"),
    [
        ({"pass_samples": (1, 9, 7)}, "pass_samples are 17 in 3 passes, but spp is 16 and passes is 1; give spp 17"),
        ({"pass_samples": (0, 16), "passes": 2}, "one of pass_samples is 0"),
        ({"pass_samples": "1,15", "passes": 2}, "pass_samples is '1,15'; expected whole numbers"),
        ({"pass_samples": 16}, "pass_samples is 16; expected whole numbers"),
    ],
)
def test_samples_of_passes_add_up(chosen: dict[str, Any], said: str) -> None:
    with pytest.raises(SettingsError, match=said):
        RenderSettings(**chosen)


def test_the_radius_shrinks_as_in_the_paper() -> None:
    alpha = 2 / 3
    assert shrink(0) == 1
    assert shrink(1) == (1 + alpha) / 2
    assert shrink(2) == pytest.approx((1 + alpha) / 2 * (2 + alpha) / 3)
    # The product is Gamma(n + 1 + alpha) / (Gamma(1 + alpha) Gamma(n + 2)), which falls as n^(alpha - 1).
    assert shrink(4000) / shrink(500) == pytest.approx(8 ** (alpha - 1), rel=1e-3)
    assert shrink(3, alpha=1.0) == 1


def test_a_pass_has_photons_samples_and_radii_of_its_own(scene: Scene) -> None:
    session = prepare(scene, FEW, 1, Launcher("cpu", 1), SilentProgress()).session
    first, fifth = session_of(session, PassPlan(0, 0, 2)), session_of(session, PassPlan(4, 8, 3))
    assert first.world.photon_plan == session.world.photon_plan
    assert (first.view.first_sample, first.view.spp, first.view.k) == (0, 2, 20)
    share = shrink(4)
    assert fifth.world.global_map.radius == pytest.approx(session.world.global_map.radius * math.sqrt(share))
    assert fifth.world.global_map.band == pytest.approx(session.world.global_map.band * math.sqrt(share))
    assert fifth.world.global_map.paths == session.world.global_map.paths
    assert (fifth.view.first_sample, fifth.view.spp, fifth.view.k) == (8, 3, round(20 * share))
    assert fifth.view.seed == session.view.seed  # the samples of all passes are one sequence
    seeds = [photon_plan(session.world, number).seed for number in range(50)]
    assert seeds[0] == FEW.seed
    assert len(set(seeds)) == 50
    assert all(0 <= seed < 2**32 for seed in seeds)


def test_the_unit_of_beams_leaves_room_for_what_narrower_beams_gather(scene: Scene) -> None:
    world = prepare(scene, FEW, 1, Launcher("cpu", 1), SilentProgress()).session.world
    for number in (1, 7, 100):
        ratio = photon_plan(world, number).volume_unit / world.volume_unit
        assert 1 <= ratio * shrink(number) <= 2
        assert math.frexp(ratio)[0] == 0.5  # a power of two


def test_surface_points_grow_denser_as_discs_shrink(scene: Scene) -> None:
    world = prepare(scene, FEW, 1, Launcher("cpu", 1), SilentProgress()).session.world
    for number in (1, 40, 2000):
        area = photon_plan(world, number).global_map.point_area
        assert area == pytest.approx(world.global_map.point_area * shrink(number))


@pytest.mark.parametrize(("k", "share", "smaller"), [(50, 1.0, 50), (50, 0.5, 25), (50, 0.01, 4), (2, 0.1, 2)])
def test_a_gather_looks_for_fewer_photons_in_a_smaller_disc(k: int, share: float, smaller: int) -> None:
    assert smaller_k(k, share) == smaller


# Images.


def test_one_pass_is_a_plain_render(scene: Scene) -> None:
    settings = replace(FEW, passes=1)
    plain = render(scene, settings)
    assert set(plain.layers).isdisjoint({"noise", "bias"})
    renderer = PassRenderer(scene, InProcess(), settings)
    result = renderer.render(PassPlan(0, 0, settings.spp))
    average = PassAverage(renderer.prepared)
    average.add(result)
    for name, layer in plain.layers.items():
        np.testing.assert_array_equal(result.layers[name], layer, err_msg=name)
        np.testing.assert_array_equal(average.layers()[name], layer, err_msg=name)


def test_images_smaller_than_the_first_grid_of_records_have_a_cache_too() -> None:
    """From pass to pass the grid moves, and in its first round it may pass 16 x 16 pixels by."""
    found = [
        render(cornell_box((16, 16)), replace(FEW, photons=20_000, spp=spp, passes=8, indirect=kind)).layers["indirect"]
        for kind, spp in ((Indirect.CACHE, 8), (Indirect.GATHER, 64))  # records shoot many rays for each sample
    ]
    assert found[0].mean() == pytest.approx(found[1].mean(), rel=0.05)


def test_the_image_is_the_mean_of_its_passes_by_their_samples(scene: Scene) -> None:
    settings = replace(FEW, spp=7)  # passes of 3, 2 and 2 samples
    renderer = PassRenderer(scene, InProcess(), settings)
    results = [renderer.render(plan) for plan in spread_samples(7, 3)]
    image = render(scene, settings)
    for name in ("beauty", "direct", "indirect", "normal", "albedo"):
        mean = np.average([result.layers[name] for result in results], axis=0, weights=[3, 2, 2])
        np.testing.assert_allclose(image.layers[name], mean, rtol=1e-6, atol=1e-7, err_msg=name)
    np.testing.assert_array_equal(image.layers["cell"], results[0].layers["cell"])
    assert not np.array_equal(results[0].layers["indirect"], results[1].layers["indirect"])


def test_depth_is_that_of_what_was_hit(scene: Scene) -> None:
    """A pass of one sample that misses everything, after one of three that do not."""
    renderer = PassRenderer(scene, InProcess(), FEW)
    average = PassAverage(renderer.prepared)
    hit = renderer.render(PassPlan(0, 0, 3))
    missed = replace(hit, plan=PassPlan(1, 3, 1), layers={n: np.zeros_like(x) for n, x in hit.layers.items()})
    average.add(hit)
    average.add(missed)
    np.testing.assert_array_equal(average.layers()["depth"], hit.layers["depth"])
    np.testing.assert_allclose(average.layers()["beauty"], hit.layers["beauty"] * 0.75, rtol=1e-6)


def test_direct_light_of_passes_is_that_of_their_samples_together(scene: Scene) -> None:
    """Samples go on where those of the pass before ended, so what needs no photons is as in a single pass."""
    settings = replace(FEW, photons=0)
    once, thrice = render(scene, replace(settings, passes=1)), render(scene, settings)
    np.testing.assert_allclose(thrice.pixels, once.pixels, rtol=2e-6)
    assert float(thrice.layers["noise"].max()) > 0
    assert "bias" not in thrice.layers


def test_a_path_traced_image_has_noise_and_no_bias(scene: Scene) -> None:
    image = render(scene, replace(FEW, integrator=Integrator.PATH))
    error = from_dict(image.metadata["report"]).error
    assert "bias" not in image.layers
    assert error is not None
    assert error.mse.bias is not None
    assert error.mse.bias.high == 0
    assert error.mse.total == error.mse.noise


def test_the_report_is_of_all_passes_together(scene: Scene, image: Image) -> None:
    report = from_dict(image.metadata["report"])
    one = from_dict(render(scene, replace(FEW, passes=1, spp=2)).metadata["report"])
    assert [each.spp for each in report.passes] == [2, 2, 2]
    assert report.passes[0].radius == one.settings["gather_radius"] > report.passes[2].radius
    assert report.photons.paths == 3 * one.photons.paths
    assert report.photons.asked == 3 * one.photons.asked
    assert report.photons.stored == pytest.approx(3 * one.photons.stored, rel=0.1)
    assert sum(light.stored for light in report.photons.lights) == report.photons.stored
    assert sum(slave.photons for slave in report.slaves) == report.photons.stored
    assert report.slaves[0].triangles == one.slaves[0].triangles
    assert report.energy.imbalance < 1e-9
    assert report.energy.emitted == pytest.approx(one.energy.emitted, rel=1e-6)
    assert (report.settings["passes"], report.settings["spp"]) == (3, 6)
    assert report.error is not None
    assert report.error.passes == 3


def test_memory_is_that_of_one_pass(scene: Scene) -> None:
    """The photons held in each pass are those of one; what the mean needs does not grow."""
    renderer = PassRenderer(scene, InProcess(), FEW)
    average = PassAverage(renderer.prepared)
    held, sizes = [], []
    for plan in spread_samples(20, 20):
        result = renderer.render(plan)
        held.append(sum(sum(slave["photons"]) for slave in result.result.statistics))
        average.add(result)
        sizes.append(average.nbytes)
    assert max(held) < 1.1 * held[0]
    assert max(sizes[8:]) <= max(sizes[:8])  # there are up to eight batches of passes: error_layers


@pytest.mark.parametrize(("spp", "passes"), [(3, 4), (1, 2)])
def test_more_passes_than_samples_are_an_error(scene: Scene, spp: int, passes: int) -> None:
    with pytest.raises(SettingsError, match=f"passes is {passes}, more than spp, which is {spp}"):
        render(scene, RenderSettings(spp=spp, passes=passes))


# Interruptions.


def test_an_interrupted_render_goes_on_to_the_same_bits(
    scene: Scene, image: Image, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    journal = tmp_path / "image.exr.wdpm-passes"
    with monkeypatch.context() as patched:
        stop_after(patched, 2)
        with pytest.raises(Stopped):
            render(scene, FEW, journal=journal)
    assert journal.exists()
    # On other hardware, as it were: settings that change no bit may differ.
    resumed = render(scene, replace(FEW, bucket=8, routing=Routing.MERGE), threads=1, journal=journal, resume=True)
    assert resumed.digest() == image.digest()
    assert not journal.exists()
    report = from_dict(resumed.metadata["report"])
    assert [each.number for each in report.passes] == [0, 1, 2]
    assert report.photons.stored == from_dict(image.metadata["report"]).photons.stored


def test_passes_can_be_added_later(scene: Scene, image: Image, tmp_path: Path) -> None:
    journal = tmp_path / "journal"
    render(scene, replace(FEW, spp=4, passes=2), journal=journal, keep=True)
    assert journal.exists()
    assert render(scene, FEW, journal=journal, resume=True, keep=True).digest() == image.digest()
    # All done: nothing is rendered, and the image is there again.
    assert render(scene, FEW, journal=journal, resume=True).digest() == image.digest()


class Notes(SilentProgress):
    """Keeps what is told."""

    def __init__(self) -> None:
        self.texts: list[str] = []

    def note(self, text: str) -> None:
        self.texts.append(text)


def test_passes_that_are_added_take_samples_of_their_own(scene: Scene, image: Image, tmp_path: Path) -> None:
    journal, notes = tmp_path / "journal", Notes()
    render(scene, replace(FEW, spp=4, passes=2), journal=journal, keep=True)
    longer = render(scene, replace(FEW, spp=4, passes=3), journal=journal, resume=True, progress=notes)
    assert longer.digest() == image.digest()
    assert notes.texts == ["2 passes of 2 samples are done, so 3 take 6 samples in all, not 4"]
    assert longer.metadata["settings"]["spp"] == 6


def test_passes_that_are_done_are_told_as_they_were(scene: Scene, tmp_path: Path) -> None:
    journal, notes = tmp_path / "journal", Notes()
    render(scene, replace(FEW, spp=4, passes=2, pass_samples=(1, 3)), journal=journal, keep=True)
    render(scene, replace(FEW, spp=9, passes=3), journal=journal, resume=True, progress=notes)
    assert notes.texts == ["2 passes of 1 and 3 samples are done, so 3 take 5 samples in all, not 9"]


def test_passes_that_are_added_are_planned_by_the_samples_of_the_first(
    scene: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    planned: list[int] = []
    real = InProcess.prepare

    def noted(backend: InProcess, source: Source, settings: RenderSettings, progress: Progress) -> Prepared:
        planned.append(settings.samples_of_pass)
        return real(backend, source, settings, progress)

    monkeypatch.setattr(InProcess, "prepare", noted)
    journal = tmp_path / "journal"
    render(scene, replace(FEW, spp=5, passes=2), journal=journal, keep=True)
    render(scene, replace(FEW, spp=4, passes=4), journal=journal, resume=True)
    assert planned == [3, 3], "pilot, radii and what is chosen go by that"


@pytest.fixture(scope="module")
def kept(scene: Scene, tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A journal of two passes."""
    journal = tmp_path_factory.mktemp("kept") / "journal"
    render(scene, replace(FEW, spp=4, passes=2), journal=journal, keep=True)
    return journal.read_bytes()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"k": 21}, r"rendered with other settings \(k 20 where 21 is asked for\); give"),
        ({"photons": 2001}, r"rendered with other settings \(.*photons 2000 where 2001 is asked for"),
        ({"seed": 1}, r"rendered with other settings \(seed 0 where 1 is asked for\); give"),
        ({"passes": 1}, "passes is 1, but 2 are done already"),
    ],
)
def test_other_settings_are_an_error(
    scene: Scene, kept: bytes, tmp_path: Path, change: dict[str, Any], message: str
) -> None:
    journal = tmp_path / "journal"
    journal.write_bytes(kept)
    with pytest.raises(SettingsError, match=message):
        render(scene, replace(FEW, **change), journal=journal, resume=True)
    assert journal.read_bytes() == kept


@pytest.mark.parametrize("other", [cornell_box((20, 17)), cornell_box((16, 16))])
def test_another_camera_is_an_error(other: Scene, kept: bytes, tmp_path: Path) -> None:
    journal = tmp_path / "journal"
    journal.write_bytes(kept)
    with pytest.raises(SettingsError, match="another camera"):
        render(other, FEW, journal=journal, resume=True)


def test_another_scene_is_an_error(scene: Scene, kept: bytes, tmp_path: Path) -> None:
    journal = tmp_path / "journal"
    journal.write_bytes(kept)
    with pytest.raises(SettingsError, match="another scene"):
        render(replace(scene, meshes=scene.meshes[1:]), FEW, journal=journal, resume=True)


def test_another_version_is_an_error(
    scene: Scene, kept: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    journal = tmp_path / "journal"
    journal.write_bytes(kept)
    monkeypatch.setattr("wdpm.rendering.pass_journal.versions", lambda: {"wdpm code": "other"})
    with pytest.raises(SettingsError, match="another version"):
        render(scene, FEW, journal=journal, resume=True)


def error_of_reading(journal: Path, data: bytes) -> str | None:
    """What is said about a journal of these bytes; None if it is whole, as some bytes of a zip file mean nothing."""
    journal.write_bytes(data)
    try:
        saved = module.read_journal(journal)
    except (ImageError, SettingsError) as error:
        return str(error)
    assert saved.plans == (PassPlan(0, 0, 2), PassPlan(1, 2, 2))
    return None


def test_a_broken_journal_is_an_error_wherever_it_is_broken(kept: bytes, tmp_path: Path) -> None:
    journal = tmp_path / "journal"
    rng = np.random.default_rng(0)
    whole = np.frombuffer(kept, np.uint8)
    broken = [b"", b"nonsense", kept[: len(kept) // 2], kept[:-1]]
    for at in rng.integers(0, len(kept), 40):
        changed = whole.copy()
        changed[at] ^= 0xFF
        broken.append(changed.tobytes())
    errors = [error for data in broken if (error := error_of_reading(journal, data)) is not None]
    assert all(str(journal) in error for error in errors)
    assert len(errors) >= 25


def test_nothing_to_resume_is_an_error(scene: Scene, tmp_path: Path) -> None:
    with pytest.raises(SettingsError, match="no such file, so there is no interrupted render to resume"):
        render(scene, FEW, journal=tmp_path / "none", resume=True)
    with pytest.raises(SettingsError, match="no journal"):
        render(scene, FEW, resume=True)


def test_passes_that_were_kept_are_not_overwritten(scene: Scene, kept: bytes, tmp_path: Path) -> None:
    journal = tmp_path / "journal"
    journal.write_bytes(kept)
    with pytest.raises(SettingsError, match="give --resume to go on, or delete it"):
        render(scene, FEW, journal=journal)
    assert journal.read_bytes() == kept


def test_a_full_disk_costs_no_pass(scene: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Passes go on without a journal, and it is tried again after each."""
    tries: list[Path] = []
    notes: list[str] = []
    write = pass_journal.write_arrays

    def full(path: Path, *what: Any) -> None:
        tries.append(path)
        if len(tries) < 3:
            raise ImageError(f"{path}: cannot be written: no space left on device")
        write(path, *what)

    class Notes(SilentProgress):
        def note(self, text: str) -> None:
            notes.append(text)

    journal = tmp_path / "journal"
    settings = replace(FEW, spp=3, passes=3)
    with monkeypatch.context() as patched:
        patched.setattr(pass_journal, "write_arrays", full)
        image = render(scene, settings, journal=journal, keep=True, progress=Notes())
    assert image.digest() == render(scene, settings).digest()
    assert len(tries) == 3
    assert [note for note in notes if "the render goes on without" in note] == [
        f"{journal}: cannot be written: no space left on device; the render goes on without, and tries again after "
        "each pass"
    ]
    assert len(module.read_journal(journal).plans) == 3
