"""A field of a ray is declared once: structs, functions that load and store, schemas and checks are made of that."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp

from wdpm.cluster.batch import SCHEMAS, Kind
from wdpm.kernels import columns, ray_fields
from wdpm.kernels.camera.paths import Paths, Vertex, load_path, store_path
from wdpm.kernels.camera.rays import Rays
from wdpm.kernels.camera.shadow_rays import Segments, Walks
from wdpm.kernels.camera.vertices import Shots, Stretches
from wdpm.kernels.fields import Fields
from wdpm.kernels.photons.beam import Beams
from wdpm.kernels.photons.deposits import StoredPhotons
from wdpm.kernels.photons.flight import Flight, load_photon, store_photon

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.kernel
def copy_paths(paths: Paths, paths_out: Paths) -> None:
    """Load and store."""
    i = wp.tid()
    store_path(load_path(paths, i), i, paths_out)


@wp.kernel
def copy_photons(flight: Flight, flight_out: Flight) -> None:
    """Load and store, with the hit as a struct of its own in between."""
    i = wp.tid()
    store_photon(load_photon(flight, i, wp.uint32(0)), i, flight_out)


@pytest.mark.parametrize(
    ("struct", "fields"),
    [
        (Rays, ray_fields.CAMERA_RAY),
        (Paths, ray_fields.PATH),
        (Segments, ray_fields.SEGMENT),
        (Shots, ray_fields.SHOT),
        (Walks, ray_fields.WALK),
        (Stretches, ray_fields.STRETCH),
        (Flight, ray_fields.PHOTON),
        (StoredPhotons, ray_fields.STORED_PHOTON),
    ],
)
def test_a_struct_of_arrays_takes_a_batch_as_it_is(struct: wp.Struct, fields: Fields) -> None:
    arrays = {name: np.ones((3, *field.shape), field.dtype) for name, field in fields.items()}
    more = {name: np.ones(3, np.int32) for name in struct.vars if name not in fields}
    back = columns.download(columns.upload(struct, {**arrays, **more}, "cpu"), fields)
    assert list(back) == list(fields)
    for name, field in fields.items():
        assert back[name].dtype == np.dtype(field.dtype), name
        assert back[name].shape == (3, *field.shape), name
        np.testing.assert_array_equal(back[name], arrays[name])


@pytest.mark.parametrize(
    ("struct", "fields", "copy"),
    [(Paths, ray_fields.PATH, copy_paths), (Flight, ray_fields.PHOTON, copy_photons)],
    ids=["path", "photon"],
)
def test_loading_and_storing_moves_every_field(struct: wp.Struct, fields: Fields, copy: wp.Kernel) -> None:
    """A field that either forgot would come back as zeros."""
    rng = np.random.default_rng(1)
    arrays = {name: rng.integers(1, 1000, (5, *field.shape)).astype(field.dtype) for name, field in fields.items()}
    copied = columns.zeros(struct, 5, "cpu")
    wp.launch(copy, 5, inputs=[columns.upload(struct, arrays, "cpu"), copied], device="cpu")
    for name, array in columns.download(copied, fields).items():
        np.testing.assert_array_equal(array, arrays[name], err_msg=name)


def test_a_vertex_knows_what_travels() -> None:
    assert ray_fields.PATH.keys() <= Vertex.vars.keys()


def test_beams_know_what_travels_but_for_where_it_goes() -> None:
    assert ray_fields.BEAM.keys() - Beams.vars.keys() == {"slot", "place", "radiance"}


def test_every_field_has_a_meaning_and_one_type_wherever_it_occurs() -> None:
    """But for sums, which are of the same things, in double."""
    types: dict[str, object] = {}
    for kind in Kind:
        for name, field in SCHEMAS[kind].items():
            assert field.meaning, f"{kind.value}.{name}"
            is_sum = kind in (Kind.PIXELS, Kind.GATHERED) and field.dtype == "<f8"
            one = "<f4" if is_sum else field.dtype
            assert types.setdefault(name, (one, field.shape)) == (one, field.shape), name


def test_every_number_of_a_thing_is_bounded() -> None:
    """What kernels look up by: a number that points outside would be read there."""
    lookups = {"prim", "owner", "cell", "light", "pixel", "medium", "map", "place"}
    for kind in Kind:
        for name, field in SCHEMAS[kind].items():
            if name in lookups:
                assert field.least is not None, f"{kind.value}.{name}"
