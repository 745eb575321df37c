"""Surfaces that are thin: what gets through leaves at the other side, in the same medium, and nothing is refracted."""
