"""Lights: which one to ask, sampling them for shadow rays, and photons that leave them."""

from wdpm.kernels.lazy_parsing import parse_lazily

parse_lazily()
