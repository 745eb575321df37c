"""Lights: which one to ask, sampling them for shadow rays, and photons that leave them."""
