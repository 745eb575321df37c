"""Photons: their paths, the tree that stores them, and gathers from it."""

from wdpm.kernels.lazy_parsing import parse_lazily

parse_lazily()
