"""The reference of a sweep: what its own shows, and what an interrupted one leaves behind."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wdpm.accuracy.knobs import parse_sweep
from wdpm.accuracy.reference import STATE, trace_reference
from wdpm.accuracy.run import Request, measure
from wdpm.cluster.integrators.registry import REFERENCE
from wdpm.cluster.plan.copies import Copies
from wdpm.cluster.render_settings import EFFECTS_TO_LEAVE_OUT, RenderSettings
from wdpm.images.image import Image, load
from wdpm.local_backend import backend_here
from wdpm.progress import SilentProgress
from wdpm.scenes.errors import ImageError, SettingsError

SIZE = (12, 10)
ONE_THREAD = partial(backend_here, threads=1, copies=Copies.NONE)


def request(folder: Path, **chosen: Any) -> Request:
    settings = {"photons": 2000, "spp": 4, **chosen}
    sweeps = (parse_sweep("spp=4,8"),)
    return Request("cornell-box", folder, size=SIZE, chosen=settings, sweeps=sweeps, reference_time=0.01)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Image:
    """The reference of a sweep that leaves nothing out."""
    folder = tmp_path_factory.mktemp("whole")
    measure(request(folder), ONE_THREAD, SilentProgress())
    return load(folder / "reference-a.exr")


@pytest.mark.parametrize("without", [("indirect",), ("caustics",), ("indirect", "lens")])
def test_what_renders_leave_out_is_bias(without: tuple[str, ...], whole: Image, tmp_path: Path) -> None:
    found = measure(request(tmp_path, without=without, spp=16), ONE_THREAD, SilentProgress())
    dark = load(tmp_path / "reference-a.exr").pixels
    if "lens" not in without:
        # Batches are as many as fit into the time, but the first has the same random numbers.
        assert dark.mean() == pytest.approx(whole.pixels.mean(), rel=0.1)
    bias = found.base.rel_mse.bias
    assert (bias.low > 0.0) == ("indirect" in without)


def test_path_tracing_refuses_just_what_its_reference_shows_all_the_same() -> None:
    refused = set()
    for effect in EFFECTS_TO_LEAVE_OUT:
        try:
            RenderSettings(integrator=REFERENCE, without=(effect,))
        except SettingsError:
            refused.add(effect)
    assert refused == REFERENCE.algorithm.cannot_leave_out


def fake(settings: RenderSettings) -> Image:
    """A render with a value of its own, by its seed."""
    return Image({"beauty": np.full((2, 3, 3), 1.0 + settings.seed / 2**33, np.float32)})


def trace(folder: Path) -> Any:
    return trace_reference(fake, RenderSettings(), 1e-6, folder, "digest", SilentProgress())


def test_a_flipped_byte_of_an_unfinished_reference_is_told(tmp_path: Path) -> None:
    whole = trace(tmp_path)
    path = tmp_path / STATE
    data = path.read_bytes()
    told = []
    for place in range(0, len(data), 3):
        path.write_bytes(data[:place] + bytes([data[place] ^ 0x5A]) + data[place + 1 :])
        try:
            again = trace(tmp_path)
        except ImageError as error:
            told.append(str(error))
        else:  # a byte that nothing depends on, such as one of a date
            assert np.array_equal(again.truth.pixels, whole.truth.pixels)
    assert len(told) > len(data) // 3 / 2
    assert all(f"{STATE}: is broken" in words and "delete it and run again" in words for words in told)


@pytest.mark.parametrize("size", [0, 10, 300])
def test_a_truncated_one_is_told(size: int, tmp_path: Path) -> None:
    trace(tmp_path)
    path = tmp_path / STATE
    path.write_bytes(path.read_bytes()[:size])
    with pytest.raises(ImageError, match=r"is broken.*delete it and run again"):
        trace(tmp_path)


def test_a_black_reference_is_refused(tmp_path: Path) -> None:
    black = Image({"beauty": np.zeros((2, 3, 3), np.float32)})
    with pytest.raises(ImageError, match="is black"):
        trace_reference(lambda _: black, RenderSettings(), 1e-6, tmp_path, "digest", SilentProgress())
