"""Photons steered towards what is seen: what each path of the pilot was of use for, and a tree that learns from it."""
