"""What compares a device with the CPU: tried with the CPU as the device, and with one that is wrong."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import warp as wp

from wdpm.bench.gpu import device_check
from wdpm.bench.gpu.allowance import Allowance
from wdpm.bench.gpu.launches import LaunchComparison, Repeat, first_difference
from wdpm.cli import main
from wdpm.cluster.render_settings import Indirect, RenderSettings
from wdpm.kernels import columns
from wdpm.kernels.launch import Launcher
from wdpm.kernels.photons.deposits import Deposits
from wdpm.progress import SilentProgress
from wdpm.scenes.model.scene import Scene

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.struct
class Numbers:
    """An array in a struct."""

    x: wp.array[wp.float32]


@wp.kernel
def doubles(numbers: Numbers, offset: wp.int32, sum_out: wp.array[wp.float32]) -> None:
    """Refines its input in place, which a repetition must not see."""
    i = offset + wp.tid()
    numbers.x[i] = numbers.x[i] * 2.0
    sum_out[i] = numbers.x[i] + 1.0


def launch(comparison: LaunchComparison) -> None:
    numbers = Numbers()
    numbers.x = wp.array(np.arange(5, dtype=np.float32), device="cpu")
    out = wp.empty(5, dtype=wp.float32, device="cpu")
    with comparison.watching():
        Launcher("cpu", 1)(doubles, 5, numbers=numbers, sum_out=out)
    np.testing.assert_array_equal(out.numpy(), np.arange(5) * 2 + 1)


def test_a_launch_is_repeated_on_the_same_input() -> None:
    comparison = LaunchComparison("cpu")
    launch(comparison)
    launch(comparison)
    record = comparison.kernels["doubles"]
    assert (record.launches, record.items, record.differing, record.first) == (2, 10, 0, None)


def test_the_first_element_that_differs_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """A device that is wrong by one rounding in two elements of an array inside a struct."""
    right = Repeat.run

    def wrong(repeat: Repeat, kernel: wp.Kernel) -> None:
        right(repeat, kernel)
        numbers = repeat._copied[0][1][0].x.numpy()
        numbers[2:4] = np.nextafter(numbers[2:4], np.float32(100))

    monkeypatch.setattr(Repeat, "run", wrong)
    comparison = LaunchComparison("cpu")
    launch(comparison)
    record = comparison.kernels["doubles"]
    assert record.differing == 1
    assert str(record.first) == "numbers.x[2] is 4.0000005 (0x40800001), expected 4.0 (0x40800000) (2 differ)"


def test_launches_are_themselves_again_afterwards() -> None:
    before = Launcher.run
    with LaunchComparison("cpu").watching():
        assert Launcher.run is not before
    assert Launcher.run is before


@pytest.mark.parametrize(
    ("expected", "got", "index"),
    [
        ([1.0, 2.0], [1.0, 2.0], None),
        ([1.0, 2.0], [1.0, 3.0], (1,)),
        ([0.0], [-0.0], (0,)),
        ([np.nan, 1.0], [-np.nan, 1.0], None),
        ([np.nan, 1.0], [0.0, 1.0], (0,)),
        ([[1.0, 2.0], [3.0, 4.0]], [[1.0, 2.0], [0.0, 0.0]], (1, 0)),
    ],
)
def test_differences_are_of_bits(expected: Any, got: Any, index: tuple[int, ...] | None) -> None:
    difference = first_difference("x", np.array(expected, np.float32), np.array(got, np.float32))
    assert (None if difference is None else difference.index) == index


def deposits(ids: list[int]) -> Any:
    """Two chunks of room for three photons each: two in the first, one in the second."""
    made = columns.empty_nested(Deposits, {"photons": 6}, "cpu")
    made.capacity = 3
    made.count = wp.array([2, 1], dtype=wp.int32, device="cpu")
    for name in columns.struct_of(made.photons).vars:
        getattr(made.photons, name).zero_()
    made.photons.id = wp.array(ids, dtype=wp.int64, device="cpu")
    return made


@pytest.mark.parametrize(
    ("ids", "equal"), [([5, 4, 0, 9, 0, 0], True), ([4, 5, 7, 9, 8, 8], True), ([4, 6, 0, 9, 0, 0], False)]
)
def test_stored_photons_have_no_order(ids: list[int], equal: bool) -> None:
    repeat = Repeat("cpu", [(1, [deposits([4, 5, 0, 9, 0, 0])])])
    repeat._copied = [(1, [deposits(ids)])]
    assert (not repeat.differences(["deposits"])) == equal


def test_all_launches_of_a_render_are_equal() -> None:
    kernels = device_check.compare_kernels("cpu", SilentProgress(), ["diffuse box"], [{"indirect": Indirect.GATHER}])
    assert {"trace_photons", "visit_camera_rays", "shade_vertices", "gather_at_photons"} <= kernels.keys()
    assert {name: str(record.first) for name, record in kernels.items() if record.differing} == {}


@pytest.mark.sockets
def test_images_of_the_device_and_of_a_mixed_cluster() -> None:
    figures = device_check.measure(
        "cpu",
        SilentProgress(),
        RenderSettings(spp=1, photons=2000),
        scenes=["cornell-box"],
        size=(16, 12),
        threads=2,
        kernels=lambda *_, **__: {},
    )
    (scene,) = figures.scenes
    assert (scene.device_equal, scene.mixed_equal, figures.left_out, figures.equal) == (True, True, (), True)
    assert "visit_camera_rays" in figures.unseen
    (kernels, _) = figures.grids()
    assert "The CPU stood in for a GPU" in kernels.notes[0]


def test_a_scene_that_differs_is_said() -> None:
    scene = device_check.SceneBits("box", (2.0, 1.0, 3.0), True, False)
    figures = device_check.DeviceFigures(("cuda:0", "A GPU"), {}, (), (scene,), ("late",))
    assert not figures.equal
    (kernels, scenes) = figures.grids()
    assert scenes.rows[0] == ("box", "2.00 s", "1.00 s", "2.00", "equal", "3.00 s", "DIFFER")
    assert "No time was left for: late." in scenes.notes
    assert not any("stood in" in note for note in kernels.notes)


def test_no_gpu_is_said_in_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    if wp.is_cuda_available():
        pytest.skip("there is a GPU here")
    assert main.main(["bench", "device"]) == 2
    assert "there is no device 'cuda:0' on this machine" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_every_kernel_is_compared() -> None:
    kernels = device_check.compare_kernels("cpu", SilentProgress())
    assert {name: str(record.first) for name, record in kernels.items() if record.differing} == {}
    unseen = set(device_check.all_kernels(trees=False)) - kernels.keys()
    # Neither the master has a device, nor what looks at a scene before it is sent, nor who teaches a guide to caustics.
    on_the_host = {"find_neighbours", "find_fronts", "_join", "fit_lobes", "guided_pdfs"}
    under_the_sky = {"numbers_of_paths"}  # where few photons come indoors
    assert unseen == {"_fill_rows", "_fill_columns", *on_the_host, *under_the_sky}


def test_a_budget_holds_for_kernels_as_for_images(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each takes as long as is told; nothing is begun that would end too late, if it took as long as those before."""
    now = [0.0]
    began: list[str] = []

    def rendered(_scene: Scene, settings: RenderSettings, **_: object) -> None:
        began.append(settings.indirect.value)
        now[0] += 4.0

    monkeypatch.setattr(device_check, "render_in_process", rendered)
    allowance = Allowance(9.0, lambda: now[0])
    ways = [{"indirect": Indirect.MAP}, {"indirect": Indirect.GATHER}, {"indirect": Indirect.CACHE}]
    device_check.compare_kernels("cpu", SilentProgress(), ["diffuse box"], ways, allowance)
    assert began == ["map", "gather"]
    assert allowance.left_out == ["kernels of diffuse box, indirect cache"]
    assert list(allowance.of([("first", 1), ("second", 2)])) == [1, 2]  # of things that take no time
    now[0] = 9.5
    assert list(allowance.of([("third", 3)])) == []
    assert allowance.left_out[1:] == ["third"]
