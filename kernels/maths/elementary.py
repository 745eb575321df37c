"""Elementary functions with the same bits on every machine: exp, log, pow, sine, cosine, arc functions, erf, erfinv.

Warp's own call the C library on a CPU and the vendor's on a GPU; those round differently from version to version, and
the image must not. These use additions, multiplications and divisions only, which IEEE 754 rounds the same everywhere.

Arguments and results are float32. In between all is float64: reduce the argument, evaluate a polynomial whose relative
error is below 1e-10, round once. So results are off by half an ulp and a hair, but for arguments that need more than
float64's 53 bits, as each function states. Subnormal results are rounded like any others. NaN gives NaN.

Sources: the reductions are in Muller, Elementary Functions (3rd edition, 2016); pi/2 is split after Cody & Waite 1980.
The power series are textbook ones, cut where the next term is below 1e-10 of the sum.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import warp as wp

from wdpm.kernels.maths.exact_sum import power_of_two

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


def _coefficients(values: Sequence[float]) -> Any:
    """Coefficients of 1, x, x² ... as a constant of kernels."""
    return wp.constant(wp.types.vector(length=len(values), dtype=wp.float64)(*values))


_INF = wp.constant(wp.float32(math.inf))
_NAN = wp.constant(wp.float32(math.nan))
_ZERO = wp.constant(wp.float64(0.0))
_ONE = wp.constant(wp.float64(1.0))
_TWO = wp.constant(wp.float64(2.0))
_BEYOND = wp.constant(wp.float64(1e300))  # stands for infinity: above all of float32, and its quotients are no NaN

_PI = wp.constant(wp.float64(math.pi))
_HALF_PI = wp.constant(wp.float64(math.pi / 2))
_QUARTER_PI = wp.constant(wp.float64(math.pi / 4))
_TWO_OVER_PI = wp.constant(wp.float64(2 / math.pi))
_HALF_PI_HIGH = wp.constant(wp.float64(float.fromhex("0x1.921fb544p+0")))  # 33 bits of pi/2: n times it is exact
_HALF_PI_LOW = wp.constant(wp.float64(float.fromhex("0x1.0b4611a626331p-34")))  # the next 53
_TAN_PI_8 = wp.constant(wp.float64(math.sqrt(2) - 1))
_LN2 = wp.constant(wp.float64(0.6931471805599453))
_LOG2_E = wp.constant(wp.float64(1.4426950408889634))
_SQRT2 = wp.constant(wp.float64(math.sqrt(2)))
_EXP_LEAST = wp.constant(wp.float64(-104.0))  # e^x is below half the least subnormal
_EXP_LARGEST = wp.constant(wp.float64(89.0))  # e^x is above the largest float32
_SMALL_EXPONENT = wp.constant(wp.float64(0.34))  # below ln(2) / 2: e^x needs no power of two

_SINE = _coefficients([(-1) ** k / math.factorial(2 * k + 1) for k in range(6)])  # of r² <= (pi/4)²
_COSINE = _coefficients([(-1) ** k / math.factorial(2 * k) for k in range(7)])
_EXPONENTIAL = _coefficients([1 / math.factorial(k + 1) for k in range(10)])  # (e^r - 1) / r, |r| <= ln(2) / 2
_ARTANH = _coefficients([2 / (2 * k + 1) for k in range(8)])  # log((1 + s) / (1 - s)) / s of s² <= 0.0295
_ARCTAN = _coefficients([(-1) ** k / (2 * k + 1) for k in range(13)])  # of t² <= tan²(pi/8)

# The three below are Chebyshev interpolations of SciPy's float64 functions, as polynomials of an interval scaled to
# [-1, 1]; largest relative errors are 2e-11, 7e-11 and 2e-10.
_ERF_END = wp.constant(wp.float64(4.0))  # beyond it erf is 1 to 2e-8, which rounds to 1
_ERF = _coefficients(  # erf(x) / x of x²/8 - 1, 0 <= x <= 4
    [
        *(3.5353099564340e-01, -1.7657623321424e-01, 1.3167511686644e-01, -1.0771044890916e-01, 9.0208996186486e-02),
        *(-7.4727728381788e-02, 5.9886860282343e-02, -4.5766463410772e-02, 3.3061073270408e-02, -2.2466263957812e-02),
        *(1.4347218438342e-02, -8.6298323217321e-03, 4.8612537921854e-03, -2.5306731595290e-03, 1.2770781548568e-03),
        *(-6.7279658746496e-04, 2.9513373366873e-04, -7.2462031488917e-05, 3.2981665143613e-05, -3.6683496303676e-05),
        1.2873585826134e-05,
    ]
)
# erfinv(y) / y is smooth in w = -log(1 - y²) near 0 and in its root further out (Giles 2010, "Approximating the erfinv
# function", whose split this is). The largest w of a float32 is 15.95.
_ERFINV_SPLIT = wp.constant(wp.float64(5.0))
_ERFINV_MIDDLE = wp.constant(wp.float64((math.sqrt(17) + math.sqrt(5)) / 2))
_ERFINV_SCALE = wp.constant(wp.float64(2 / (math.sqrt(17) - math.sqrt(5))))
_ERFINV_NEAR = _coefficients(  # of 2/5 w - 1, 0 <= w <= 5
    [
        *(1.5014093511110e00, 6.1660069196315e-01, -2.6108236313460e-02, -1.9573563806549e-02, 8.5254159930206e-03),
        *(-4.8787904794981e-04, -8.3425665251264e-04, 2.9214161689360e-04, 2.0891572794750e-05, -4.1406239317290e-05),
        *(7.9412397609901e-06, 2.9332374219927e-06, -1.2638286260713e-06),
    ]
)
_ERFINV_FAR = _coefficients(  # of sqrt(w) scaled, 5 <= w <= 17
    [
        *(3.0131301142791e00, 9.4771098644226e-01, 5.5583080701862e-03, -3.8165426965803e-03, 2.5051876707574e-03),
        *(-1.5900494293172e-03, 7.9669377321943e-04, -2.4046618086855e-04, -1.8791995802684e-05, 7.0051607016793e-05),
        *(-3.1836357171896e-05, -2.5406973725713e-06, 4.5241017687240e-06),
    ]
)


@wp.func
def _polynomial(coefficients: Any, x: wp.float64) -> wp.float64:
    """Horner's rule."""
    degree = len(coefficients) - 1
    total = coefficients[degree]
    for k in range(degree):
        total = total * x + coefficients[degree - 1 - k]
    return total


@wp.func
def sincos_wide(x: wp.float64) -> wp.vec2d:
    """(sin x, cos x) for |x| <= 1e5 [radians], to 1e-11."""
    quarter = wp.rint(x * _TWO_OVER_PI)
    r = (x - quarter * _HALF_PI_HIGH) - quarter * _HALF_PI_LOW
    r2 = r * r
    sine = r * _polynomial(_SINE, r2)
    cosine = _polynomial(_COSINE, r2)
    turn = wp.int32(quarter) & 3
    if turn == 1:
        return wp.vec2d(cosine, -sine)
    if turn == 2:
        return wp.vec2d(-sine, -cosine)
    if turn == 3:
        return wp.vec2d(-cosine, sine)
    return wp.vec2d(sine, cosine)


@wp.func
def sincos_of(x: wp.float32) -> wp.vec2:
    """(sin x, cos x) for |x| <= 1e5 [radians]; NaN beyond, where the reduction would lose bits."""
    if not (wp.abs(x) <= 1.0e5):
        return wp.vec2(_NAN, _NAN)
    return wp.vec2(sincos_wide(wp.float64(x)))


@wp.func
def _exp_wide(x: wp.float64) -> wp.float64:
    """e^x where a float32 can tell it from 0 and infinity; those two, and NaN for NaN, elsewhere."""
    if x > _EXP_LARGEST:
        return wp.float64(_INF)
    if x < _EXP_LEAST:
        return _ZERO
    if x != x:
        return x
    n = wp.rint(x * _LOG2_E)
    r = x - n * _LN2
    return (_ONE + r * _polynomial(_EXPONENTIAL, r)) * power_of_two(wp.int32(n))


@wp.func
def _log_wide(x: wp.float64) -> wp.float64:
    """Natural logarithm of a normal positive float64."""
    bits = wp.cast(x, wp.uint64)
    e = wp.int32(bits >> wp.uint64(52)) - 1023
    m = wp.cast((bits & wp.uint64(0xFFFFFFFFFFFFF)) | wp.uint64(0x3FF0000000000000), wp.float64)
    if m > _SQRT2:
        m = m / _TWO
        e = e + 1
    s = (m - _ONE) / (m + _ONE)
    return wp.float64(e) * _LN2 + s * _polynomial(_ARTANH, s * s)


@wp.func
def exp_of(x: wp.float32) -> wp.float32:
    """e^x: 0 where it is below the least subnormal, inf where above the largest float."""
    return wp.float32(_exp_wide(wp.float64(x)))


@wp.func
def expm1_of(x: wp.float32) -> wp.float32:
    """e^x - 1, exact to an ulp near 0 too: minus it is what an optical depth of -x absorbs."""
    wide = wp.float64(x)
    if wp.abs(wide) < _SMALL_EXPONENT:
        return wp.float32(wide * _polynomial(_EXPONENTIAL, wide))
    return wp.float32(_exp_wide(wide) - _ONE)


@wp.func
def log_of(x: wp.float32) -> wp.float32:
    """Natural logarithm: -inf at 0, inf at inf, NaN below 0."""
    if x == 0.0:
        return -_INF
    if x == _INF:
        return _INF
    if not (x > 0.0):
        return _NAN
    return wp.float32(_log_wide(wp.float64(x)))


@wp.func
def log1p_of(x: wp.float32) -> wp.float32:
    """log(1 + x), exact to an ulp near 0 too: -inf at -1, inf at inf, NaN below -1."""
    if wp.abs(x) < 0.25:
        wide = wp.float64(x)
        s = wide / (_TWO + wide)
        return wp.float32(s * _polynomial(_ARTANH, s * s))
    if x == -1.0:
        return -_INF
    if x == _INF:
        return _INF
    if not (x > -1.0):
        return _NAN
    return wp.float32(_log_wide(_ONE + wp.float64(x)))


@wp.func
def pow_of(x: wp.float32, y: wp.float32) -> wp.float32:
    """x^y for x >= 0, NaN below. As IEEE 754 has it, x^0 = 1^y = 1 for every x and y, 0^y is 0 or inf by y's sign."""
    if y == 0.0 or x == 1.0:
        return 1.0
    if not (x >= 0.0) or y != y:
        return _NAN
    if x == 0.0 or x == _INF:
        if (x == 0.0) == (y > 0.0):
            return 0.0
        return _INF
    return wp.float32(_exp_wide(wp.float64(y) * _log_wide(wp.float64(x))))


@wp.func
def atan2_wide(y: wp.float64, x: wp.float64) -> wp.float64:
    """Angle of (x, y) for finite float64, to 1e-10 of itself."""
    a = wp.abs(x)
    b = wp.abs(y)
    low = wp.min(a, b)
    high = wp.max(a, b)
    if high == _ZERO:
        return _ZERO
    t = low / high
    angle = wp.float64(0.0)
    if t > _TAN_PI_8:
        t = (t - _ONE) / (t + _ONE)
        angle = _QUARTER_PI
    angle = angle + t * _polynomial(_ARCTAN, t * t)
    if b > a:
        angle = _HALF_PI - angle
    if x < _ZERO:
        angle = _PI - angle
    if y < _ZERO:
        angle = -angle
    return angle


@wp.func
def _without_infinity(x: wp.float32) -> wp.float64:
    return wp.clamp(wp.float64(x), -_BEYOND, _BEYOND)


@wp.func
def atan2_of(y: wp.float32, x: wp.float32) -> wp.float32:
    """Angle of the point (x, y) from the x axis in (-pi, pi]. The sign of a zero does not count; (0, 0) gives 0."""
    if x != x or y != y:
        return _NAN
    return wp.float32(atan2_wide(_without_infinity(y), _without_infinity(x)))


@wp.func
def acos_of(x: wp.float32) -> wp.float32:
    """Arc cosine in [0, pi]; x is clamped to [-1, 1] first."""
    if x != x:
        return _NAN
    c = wp.clamp(wp.float64(x), -_ONE, _ONE)
    return wp.float32(atan2_wide(wp.sqrt((_ONE - c) * (_ONE + c)), c))


@wp.func
def erf_of(x: wp.float32) -> wp.float32:
    """Error function, 2 / sqrt(pi) times the integral of e^-t² from 0 to x."""
    wide = wp.float64(x)
    if wide >= _ERF_END:
        return 1.0
    if wide <= -_ERF_END:
        return -1.0
    return wp.float32(wide * _polynomial(_ERF, wide * wide / wp.float64(8.0) - _ONE))


@wp.func
def erfinv_of(y: wp.float32) -> wp.float32:
    """The x with erf(x) = y: -inf and inf at -1 and 1, NaN beyond."""
    if y == 1.0 or y == -1.0:
        return y * _INF
    if not (wp.abs(y) < 1.0):
        return _NAN
    wide = wp.float64(y)
    w = -_log_wide((_ONE - wide) * (_ONE + wide))
    if w < _ERFINV_SPLIT:
        return wp.float32(wide * _polynomial(_ERFINV_NEAR, w / wp.float64(2.5) - _ONE))
    return wp.float32(wide * _polynomial(_ERFINV_FAR, (wp.sqrt(w) - _ERFINV_MIDDLE) * _ERFINV_SCALE))
