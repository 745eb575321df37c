"""Samples that are followed to their ends where they are."""
