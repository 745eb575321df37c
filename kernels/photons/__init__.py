"""Photons: their paths, the tree that stores them, and gathers from it."""
