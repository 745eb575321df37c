"""Scenes that are made by code."""
