"""Lights: which one to ask, sampling them for shadow rays, and photons that leave them."""

from wdpm.kernels.parsed_late import parse_late

parse_late()
