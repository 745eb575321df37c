"""Photons: their paths, the tree that stores them, and gathers from it."""

from wdpm.kernels.parsed_late import parse_late

parse_late()
