"""Lobes that paths go on by: their density, that it is whole, and which regions have any."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp
from light_rig import Array, numbers

from wdpm.cluster.guide import NO_CAUSTIC_GUIDE
from wdpm.kernels.camera import caustic_guide
from wdpm.kernels.camera.caustic_guide import CausticGuide, guided_direction, guided_pdf, lobes_at
from wdpm.kernels.maths.directions import uniform_sphere

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

COUNT = 1 << 18
PLACE = (0.1, -0.2, 0.3)


@wp.kernel
def _sampled(
    known: CausticGuide,
    place: wp.vec3,
    u: wp.array[wp.vec2],
    direction_out: wp.array[wp.vec3],
    pdf_out: wp.array[wp.float32],
):
    i = wp.tid()
    region = lobes_at(known, place)
    direction_out[i] = guided_direction(known, region, place, u[i])
    pdf_out[i] = guided_pdf(known, region, place, direction_out[i])


@wp.kernel
def _everywhere(
    known: CausticGuide,
    place: wp.vec3,
    u: wp.array[wp.vec2],
    direction_out: wp.array[wp.vec3],
    pdf_out: wp.array[wp.float32],
):
    i = wp.tid()
    direction_out[i] = uniform_sphere(u[i])
    pdf_out[i] = guided_pdf(known, lobes_at(known, place), place, direction_out[i])


@wp.kernel
def _regions(known: CausticGuide, place: wp.array[wp.vec3], region_out: wp.array[wp.int32]):
    i = wp.tid()
    region_out[i] = lobes_at(known, place[i])


def lobes(rims: list[float]) -> CausticGuide:
    """Two regions, x below and above 0, of which the second has lobes of these widths, in several blocks of eight."""
    count = len(rims)
    rng = np.random.default_rng(count)
    share = rng.uniform(0.2, 1.0, count)
    return caustic_guide.upload(
        np.zeros(1, np.int32),
        np.zeros(1, np.float32),
        np.array([0, 0, count], np.int32),
        rng.uniform(-2, 2, (count, 3)).astype(np.float32),
        np.array(rims, np.float32),
        (share / share.sum()).astype(np.float32),
        np.array([0.0, 0.25], np.float32),
        "cpu",
    )


WIDE = lobes([0.02, 0.05, 0.3, 1.0, 0.6, 0.2, 0.1, 0.01, 0.9, 0.4, 0.03])
NARROW = lobes([1e-6, 1e-5, 1e-4, 1e-3, 1e-2])


def launched(kernel: wp.Kernel, known: CausticGuide, seed: int) -> tuple[Array, Array]:
    """Directions and densities of COUNT numbers."""
    u = wp.array(numbers(COUNT, seed), dtype=wp.vec2, device="cpu")
    out = [wp.zeros(COUNT, dtype=kind, device="cpu") for kind in (wp.vec3, wp.float32)]
    wp.launch(kernel, COUNT, inputs=[known, wp.vec3(*PLACE), u, *out], device="cpu")
    direction, pdf = (each.numpy().astype(np.float64) for each in out)
    return direction, pdf


@pytest.mark.parametrize("known", [WIDE, NARROW], ids=["wide", "narrow"])
def test_directions_have_length_1_and_a_density(known: CausticGuide) -> None:
    direction, pdf = launched(_sampled, known, 1)
    np.testing.assert_allclose(np.linalg.norm(direction, axis=1), 1.0, atol=1e-6)
    assert (pdf > 0).mean() > 0.9999  # at the rim of a lobe it is 0, and rounding may go beyond


def test_lobes_are_whole() -> None:
    _, pdf = launched(_everywhere, WIDE, 2)
    assert pdf.mean() * 4 * np.pi == pytest.approx(1.0, abs=5 * pdf.std() * 4 * np.pi / np.sqrt(COUNT))


def test_directions_are_as_dense_as_is_said() -> None:
    """Integrals of smooth functions over the sphere, by drawn directions and by those from all around."""
    drawn, _ = launched(_sampled, WIDE, 1)
    ways, pdf = launched(_everywhere, WIDE, 2)
    for power in (1, 2):
        for axis in range(3):
            by_drawn, by_all = drawn[:, axis] ** power, ways[:, axis] ** power * pdf * 4 * np.pi
            error = np.hypot(by_drawn.std(), by_all.std()) / np.sqrt(COUNT)
            assert abs(by_drawn.mean() - by_all.mean()) < 5 * error


def test_narrow_lobes_are_whole_too() -> None:
    """The mean of 1 over a density, of directions drawn by it, is the solid angle that has any: that of all lobes."""
    _, pdf = launched(_sampled, NARROW, 3)
    apart = lobes([1e-4])
    _, alone = launched(_sampled, apart, 3)
    rim = 1e-4 * float(caustic_guide.WIDE)
    some = alone > 0
    assert (1.0 / alone[some]).mean() == pytest.approx(2 * np.pi * rim, rel=0.1)
    assert pdf.max() > 1e4


def test_a_region_without_lobes_has_none() -> None:
    places = wp.array([(-1, 0, 0), (1, 0, 0)], dtype=wp.vec3, device="cpu")
    for known, expected in ((WIDE, [-1, 1]), (caustic_guide.upload(**vars(NO_CAUSTIC_GUIDE), device="cpu"), [-1, -1])):
        found = wp.zeros(2, dtype=wp.int32, device="cpu")
        wp.launch(_regions, 2, inputs=[known, places, found], device="cpu")
        assert found.numpy().tolist() == expected
