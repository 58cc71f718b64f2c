"""How a splat's 14 parameters lie in one row of memory, shared by the kernels and the model.

Letters: N splats, P = 14 parameters, Q = 10 numbers of a projected splat.
"""

from __future__ import annotations

POSITION, LOG_SCALE, ROTATION, COLOUR, OPACITY = 0, 3, 6, 10, 13
"""First columns: rest position (m), log axis lengths (m), quaternion wxyz, sRGB, opacity logit."""
PARAMETERS = 14

MEAN_X, MEAN_Y, CONIC_A, CONIC_B, CONIC_C, ALPHA, RED, GREEN, BLUE, HALF_HEIGHT = range(10)
"""A splat on the picture: centre (px), inverse covariance (1/px^2), opacity, colour, and how far
(px) above and below its centre it can be seen."""
PROJECTED = 10
CONTRIBUTION = HALF_HEIGHT
"""Column of the summed blending weight in gradients, which have no half height."""

BOX_FILTER_PX2 = 1.0 / 12.0
"""Variance of a pixel's box filter: what a camera adds to every splat's covariance, px^2."""
VISIBILITY_DILATION_PX2 = 4.0 * BOX_FILTER_PX2
"""Dilation for finding which splat a pixel of a smaller picture shows: by the filter alone each is
too faint there to tell, and poses are fitted 0.5 dB worse."""
FAINTEST = 1.0 / 255.0
"""Opacity below which a splat changes no 8-bit pixel."""
HIDDEN_LOGIT = -60.0
"""Opacity of splats of other levels than the one that is drawn: no kernel looks at them further."""
MOST_OPAQUE = 0.99
"""Keeps 1 - alpha away from nil, so that what lies behind still gets a gradient."""
FINISHED = 1.0 / 512.0
"""A tile whose every pixel lets less through is finished."""
NO_LIGHT = 255
"""Light index of splats that keep their colour."""
LEAST_AREA_PX4 = 1e-6
"""Determinant of a covariance on the picture from which a splat counts as no smaller."""
NEAR_M = 0.05
"""Splats nearer to the camera than this are not drawn."""
TILE = 16
"""Pixels a side of a tile."""
EMPTY_BOX = -1
"""First column of the tile box of a splat that is not drawn."""
DIFFERENCE, KNOWN, SHOWN = 0, 3, 4
"""Columns of what is gathered from pixels: the weighted differences' sum (3), the sums of weights
in pixels whose colour is known, and in all."""
GATHERED = 5
UNKNOWN = (255, 0, 0, 0)
"""Pixel of a training picture that tells nothing: no premultiplied colour is red without alpha."""
