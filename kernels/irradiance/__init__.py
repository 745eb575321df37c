"""Irradiance that is computed at few places and read at many: at photons, and in the irradiance cache."""
