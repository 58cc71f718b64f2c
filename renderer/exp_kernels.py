"""e^x in single precision, as code that a compiler turns into vectors."""

from __future__ import annotations

import numba
import numpy as np

_F = np.float32


@numba.njit(inline="always", fastmath=True)
def exp_falling(x):
    """e^x for x <= 0, relative error under 5e-6: 2^n by exponent bits times a polynomial.

    Every step is float32 or int32: one int64 (as `math.floor` gives) would widen all of it.
    """
    y = max(x, _F(-80.0)) * _F(1.4426950408889634)
    n = np.int32(y - _F(0.5))
    f = y - _F(n)
    p = _F(1.0) + f * (
        _F(0.69314718)
        + f * (_F(0.24022651) + f * (_F(0.0555041) + f * (_F(0.00961813) + f * _F(0.00133336))))
    )
    return p * np.int32((n + np.int32(127)) << np.int32(23)).view(np.float32)
