"""Irradiance that is computed at few places and read at many: at photons, and in the irradiance cache."""

from wdpm.kernels.lazy_parsing import parse_lazily

parse_lazily()
