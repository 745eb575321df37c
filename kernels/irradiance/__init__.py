"""Irradiance that is computed at few places and read at many: at photons, and in the irradiance cache."""

from wdpm.kernels.parsed_late import parse_late

parse_late()
