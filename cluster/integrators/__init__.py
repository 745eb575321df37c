"""Integrators: each is one object, an Algorithm, that says all that others have to know of it."""
