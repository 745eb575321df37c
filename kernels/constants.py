"""Every constant of the kernels, with its derivation."""

from __future__ import annotations

from typing import Final

import warp as wp

# --- gather: which photons count at a query ------------------------------------------------------------------------

NORMAL_COS: Final = 0.9
"""Least cosine between a photon's normal and the query's: about 26 degrees.

The two sides of a wall differ by 180 degrees and the walls of a room's corner by 90; neighbouring facets of a surface
that is meant to be smooth differ by 360 degrees / facets (a 14-sided column: 26). Surface that turns away further is
left
out of the photons and of the measured area alike (surface_points.py), so a narrow filter costs no light; it only keeps
apart what is lit differently.
"""

FLATTENING: Final = 8.0
"""Ratio of the gather ellipsoid's semi-axes: W in d² = |p - x|² + (W² - 1) (n · (p - x))².

A photon off the tangent plane counts as W times further away (Jensen 2001, section 7.2, squeezes the sphere to a
disc). W = 1 is a ball, which takes photons of a parallel surface a radius away; W -> infinity drops photons of a curved
surface: on a sphere of radius R a photon at distance d is d² / 2R off the plane, which lengthens its distance by the
factor sqrt(1 + (W² - 1) d² / 4R²), 1.2 % at d = R / 25 with W = 8; the measured area shrinks alike, so no light is
lost. A board closer than r / W to the surface still
leaks, if its normal is alike.
"""

COINCIDENT_SHARE2: Final = 2.0**-80
"""Square of the least gather radius as a share of r_max (2^-40): below it the photons count as lying in one place.

The disc's area is a divisor, and flux / area must stay finite: it does where the flux of k photons over the disc of
r_max is up to 2.8e14. A share of r_max, as r_max follows the scene: a fixed length would be another one in other units.
One ulp of a float32 coordinate is 2^-24 of it at least, so distinct photons closer than this do not occur further than
2^-16 r_max from the scene's middle.
"""

MIN_GATHER_RADIUS: Final = 2.0**-60
MAX_GATHER_RADIUS: Final = 2.0**60
"""Bounds of r_max. They say nothing about scenes, only what float32 holds: squares from 2^-120 to 2^120."""

LEAST_SQUARE: Final = 2.0**-120
"""Least square of a radius that is a divisor: 64 / 2^-120 is finite. Above COINCIDENT_SHARE2 only where r_max < 2^-20:
coincident photons are then told by a fixed length, 2^-60."""

MAX_PHOTON_COORDINATE: Final = 1e16
"""Largest photon coordinate: squares of differences, flattened, stay finite: 3 * (2e16)² * 64 = 7.7e34."""

MIN_ARRIVAL_COS: Final = 1e-6
"""Least divisor of the weight of shading normals, ((m + s - n) · d) / (m · d), m a photon's normal.

It keeps the quotient finite; what the weight may be at most is ADJOINT_BOUND.
"""

# --- exact sums ----------------------------------------------------------------------------------------------------

EXACT_SUM_BITS: Final = 40
"""Bits below the exponent of the largest term that an exact sum keeps.

A float32 has 24 bits, so terms down to 2^-16 of the largest are kept whole and smaller ones to 2^-41 of it; an int64
then holds 2^(63 - 40) = 8.4 million terms, and up to 2^(53 - 40) = 8192 terms convert to float64 without rounding.
"""

# Boxes, rays and angles.

PAD_SHARE = 2.0**-19
"""Growth of every box, as a share of the scene's extent.

A ray's origin and a vertex differ by at most twice the extent; the triangle test works in double, so what remains are
the roundings of float32 slab arithmetic: (b - o) * inv_d is three roundings, so a plane is misplaced by at most
3 * 2^-24 * 2 extent < 2^-21 extent. Four times that leaves room for hit points that are rounded to float32.
"""

OFFSET_SHARE = wp.constant(2.0**-22)
"""Distance from a surface at which rays leave it, as a share of |n| . |p| (the 1-norm of p seen along n).

A hit point is computed in double and rounded once: it lies within 2^-24 |p_i| of the surface along each axis, so
within 2^-24 |n| . |p| along the normal. Adding the offset rounds once more, by as much. Half of 2^-22 covers both;
the other half covers the rounding of the normal itself.
"""

OFFSET_MIN_SHARE = 2.0**-48
"""Least such distance, as a share of the scene's extent: weights and corners are combined in double, and the roundings
of three products and two sums stay below 2^-50 extent."""

PI = wp.constant(3.14159265358979)
INV_PI = wp.constant(0.318309886183791)

ADJOINT_BOUND = wp.constant(4.0)
"""Largest factor by which an interpolated normal may weigh a photon up.

Photons arrive by the geometric normal's cosine and count by the shading normal's. The ratio has no bound at grazing
arrival, and its second moment diverges: single photons would outshine all others (on meshes with badly smoothed
normals, by 100 times). Bounded at 4, what is lost is light that arrives within 15 degrees of grazing on surfaces whose
normals lean towards it by more than the tessellation of a smooth shape makes them: 0.7 % of the irradiance where
they lean by 10 degrees, nothing where normals are flat.
"""

LEAST_POINTS = wp.constant(16.0)
"""Surface points that the area of a gather is counted from, at least: their stratified count is then off by some 8 %,
less than the 14 % of 50 photons."""

COLLISION_MARGIN = wp.constant(2.0**28)
"""Least distance between a collision in a medium and a surface beyond it, in units of OFFSET_MIN_SHARE of the extent.

That is 2^-20 of the extent. A point on a ray is off it by a rounding of its coordinates and of its distance, 2^-23
extent together; the rest covers rays that graze a surface. What collides nearer than this to a
surface hits the surface instead: a share of 2^-20 extent * sigma_t of all photons that get there."""

# Camera paths.

ROULETTE_FROM = wp.constant(8)
"""Vertices before Russian roulette begins: eight let light through two glass objects, one inside the other."""

ROULETTE_FROM_OF_PATHS = wp.constant(4)
"""The same in path tracing, where most vertices are diffuse and further ones bring less and less.

Relative squared error times CPU time, from 4, with 8 for comparison: 0.0021 and 0.0024 in cbox, 0.0190 and 0.0232 in
sibenik; the median over pixels 14 to 31 % lower, in glass-cbox too. (From 2 it is higher again. The mean of glass-cbox
is made by few samples that paths find behind glass by chance: those grow, from 0.5 to 0.7.)"""

ROULETTE_FROM_OF_GATHERS = wp.constant(2)
"""The same of gather rays that go on by diffuse surfaces without any irradiance to read: hardly a photon landed there,
so little light is at stake, and each further bounce costs a round through all cells."""

WEAK_REFLECTION = wp.constant(0.1)
"""Throughput below which Russian roulette ends paths of photon mapping that leave a diffuse surface by its gloss.

What the surface's diffuse part shows is known there, and its gloss adds a twentieth or so. The first such ray is always
traced, as what floors mirror must not be noisy; a reflection in a reflection adds little."""

WEAK_REFLECTION_OF_GATHERS = wp.constant(0.5)
"""The same of gather rays, many of which are averaged, from where they arrive on."""

SURVIVAL_MOST = wp.constant(0.95)
"""Largest probability of survival: between two perfect mirrors, 400 vertices are then reached once in 10^9 paths."""

SURVIVAL_MOST_IN_MEDIUM = wp.constant(0.999)
"""The same after a collision in a medium, for path tracing. A white fog of optical depth 40 scatters a path hundreds of
times before it gets out: at 0.95 one path in 10^9 would, and bring 10^9 times its light. The price is time: a path in
white fog without end has all its vertices. (What more vertices than the limit would bring is lost at any value.)"""
