"""Renders to an error or a time that was asked for."""
