"""Skin and project splats, and the chain rule back: pixels -> parameters.

Letters: M = sum_k w_k T_k (3x4) blended transform, x rest position, p = R (M x) + t camera point,
J perspective Jacobian (2x3), B = J R A Q S with A = M[:, :3], Q rotation, S scales; the covariance
on the picture is C = B B^T + dilation (EWA splatting, Zwicker et al. 2001; Kerbl et al. 2023). The
pixel's filter F spreads a splat's light and makes no more of it: its opacity falls by the square
root of det(C - F) / det(C) (Mip-Splatting, Yu et al. 2024). Else silhouettes, where many splats lie
behind one another, swell by half a pixel, and training sinks the surface to make up for it.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from renderer.splats.layout import (
    ALPHA,
    BLUE,
    BOX_FILTER_PX2,
    COLOUR,
    CONIC_A,
    CONIC_B,
    CONIC_C,
    CONTRIBUTION,
    EMPTY_BOX,
    FAINTEST,
    GREEN,
    HALF_HEIGHT,
    HIDDEN_LOGIT,
    LEAST_AREA_PX4,
    LOG_SCALE,
    MEAN_X,
    MEAN_Y,
    NEAR_M,
    OPACITY,
    POSITION,
    RED,
    ROTATION,
    TILE,
)
from scene.arrays import Array

_F = np.float32
_FILTER = _F(BOX_FILTER_PX2)
_LEAST_AREA = _F(LEAST_AREA_PX4)


@numba.njit(inline="always", fastmath=True)
def _quaternion_matrix(w, x, y, z, out):
    out[0, 0], out[0, 1], out[0, 2] = (
        1 - 2 * (y * y + z * z),
        2 * (x * y - w * z),
        2 * (x * z + w * y),
    )
    out[1, 0], out[1, 1], out[1, 2] = (
        2 * (x * y + w * z),
        1 - 2 * (x * x + z * z),
        2 * (y * z - w * x),
    )
    out[2, 0], out[2, 1], out[2, 2] = (
        2 * (x * z - w * y),
        2 * (y * z + w * x),
        1 - 2 * (x * x + y * y),
    )


@numba.njit(inline="always", fastmath=True)
def _blend(transforms, joints, weights, i, out):
    for r in range(3):
        for c in range(4):
            total = _F(0.0)
            for k in range(4):
                total += weights[i, k] * transforms[joints[i, k], r, c]
            out[r, c] = total


@numba.njit(inline="always", fastmath=True)
def _geometry(parameters, i, blended, camera, quaternion, scaled, spread, point, jacobian):
    """Fill Q, `scaled` = R A, `spread` = R A Q S (so that B = J spread), p and J.

    Returns 1 / |q|.
    """
    px, py, pz = parameters[i, POSITION], parameters[i, POSITION + 1], parameters[i, POSITION + 2]
    wx = blended[0, 0] * px + blended[0, 1] * py + blended[0, 2] * pz + blended[0, 3]
    wy = blended[1, 0] * px + blended[1, 1] * py + blended[1, 2] * pz + blended[1, 3]
    wz = blended[2, 0] * px + blended[2, 1] * py + blended[2, 2] * pz + blended[2, 3]
    for r in range(3):
        point[r] = camera[r, 0] * wx + camera[r, 1] * wy + camera[r, 2] * wz + camera[r, 3]
        for c in range(3):
            scaled[r, c] = (
                camera[r, 0] * blended[0, c]
                + camera[r, 1] * blended[1, c]
                + camera[r, 2] * blended[2, c]
            )
    w, x, y, z = (
        parameters[i, ROTATION],
        parameters[i, ROTATION + 1],
        parameters[i, ROTATION + 2],
        parameters[i, ROTATION + 3],
    )
    inverse_norm = _F(1.0) / math.sqrt(w * w + x * x + y * y + z * z)
    _quaternion_matrix(
        w * inverse_norm, x * inverse_norm, y * inverse_norm, z * inverse_norm, quaternion
    )
    for r in range(3):
        for c in range(3):
            total = (
                scaled[r, 0] * quaternion[0, c]
                + scaled[r, 1] * quaternion[1, c]
                + scaled[r, 2] * quaternion[2, c]
            )
            spread[r, c] = total * math.exp(parameters[i, LOG_SCALE + c])
    fx, fy = camera[3, 0], camera[3, 1]
    inverse_depth = _F(1.0) / max(point[2], _F(NEAR_M))
    jacobian[0, 0], jacobian[0, 1] = fx * inverse_depth, _F(0.0)
    jacobian[0, 2] = -fx * point[0] * inverse_depth * inverse_depth
    jacobian[1, 0], jacobian[1, 1] = _F(0.0), fy * inverse_depth
    jacobian[1, 2] = -fy * point[1] * inverse_depth * inverse_depth
    return inverse_norm


@numba.njit(parallel=True, fastmath=True, nogil=True, cache=True)
def project(
    parameters: Array,  # [N P] float32
    joints: Array,  # [N 4] uint16
    weights: Array,  # [N 4] float32
    transforms: Array,  # [K 4 4] float32, rest -> world
    camera: Array,  # [4 4] float32: rows R|t, then fx fy cx cy
    width: int,
    height: int,
    dilation: float,  # px^2
    projected: Array,  # [N Q] float32, written
    depth: Array,  # [N] float32, written, m
    boxes: Array,  # [N 4] int32, written: tile columns and rows [first, last], EMPTY_BOX if unseen
) -> None:
    """Project every splat; those off the picture get an empty tile box."""
    count = parameters.shape[0]
    tiles_x, tiles_y = (width + TILE - 1) // TILE, (height + TILE - 1) // TILE
    for i in numba.prange(count):
        boxes[i, 0] = EMPTY_BOX
        if parameters[i, OPACITY] <= _F(HIDDEN_LOGIT):
            continue
        blended = np.empty((3, 4), np.float32)
        quaternion, scaled = np.empty((3, 3), np.float32), np.empty((3, 3), np.float32)
        spread, jacobian = np.empty((3, 3), np.float32), np.empty((2, 3), np.float32)
        point = np.empty(3, np.float32)
        _blend(transforms, joints, weights, i, blended)
        _geometry(parameters, i, blended, camera, quaternion, scaled, spread, point, jacobian)
        depth[i] = point[2]
        alpha = _F(1.0) / (_F(1.0) + math.exp(-parameters[i, OPACITY]))
        if point[2] <= NEAR_M or alpha <= FAINTEST:
            continue
        xx, xy, yy = _F(dilation), _F(0.0), _F(dilation)
        for c in range(3):
            bx = jacobian[0, 0] * spread[0, c] + jacobian[0, 2] * spread[2, c]
            by = jacobian[1, 1] * spread[1, c] + jacobian[1, 2] * spread[2, c]
            xx += bx * bx
            xy += bx * by
            yy += by * by
        inverse = _F(1.0) / max(xx * yy - xy * xy, _F(1e-12))
        bare = (xx - _FILTER) * (yy - _FILTER) - xy * xy
        alpha *= math.sqrt(max(bare, _LEAST_AREA) * inverse)
        if alpha <= FAINTEST:
            continue
        mean_x = jacobian[0, 0] * point[0] + camera[3, 2]
        mean_y = jacobian[1, 1] * point[1] + camera[3, 3]
        reach = _F(2.0) * math.log(alpha / _F(FAINTEST))
        half_x, half_y = math.sqrt(reach * xx), math.sqrt(reach * yy)
        if (
            not (half_x < 1e6 and half_y < 1e6)
            or mean_x + half_x < 0
            or mean_y + half_y < 0
            or mean_x - half_x > width
            or mean_y - half_y > height
        ):
            continue
        projected[i, MEAN_X], projected[i, MEAN_Y] = mean_x, mean_y
        projected[i, CONIC_A], projected[i, CONIC_B] = yy * inverse, -xy * inverse
        projected[i, CONIC_C], projected[i, ALPHA] = xx * inverse, alpha
        projected[i, HALF_HEIGHT] = half_y
        projected[i, RED] = parameters[i, COLOUR]
        projected[i, GREEN] = parameters[i, COLOUR + 1]
        projected[i, BLUE] = parameters[i, COLOUR + 2]
        boxes[i, 0] = max(0, int((mean_x - half_x) / TILE))
        boxes[i, 1] = min(tiles_x - 1, int((mean_x + half_x) / TILE))
        boxes[i, 2] = max(0, int((mean_y - half_y) / TILE))
        boxes[i, 3] = min(tiles_y - 1, int((mean_y + half_y) / TILE))


@numba.njit(fastmath=True, nogil=True, cache=True)
def _chain_rule_range(
    parameters: Array,  # [N P] float32
    joints: Array,  # [N 4] uint16
    weights: Array,  # [N 4] float32
    transforms: Array,  # [K 4 4] float32
    camera: Array,  # [4 4] float32
    projected: Array,  # [N Q] float32
    boxes: Array,  # [N 4] int32
    start: int,
    stop: int,
    on_picture: Array,  # [N Q] float32: gradient by what was projected; last: contribution
    gradient: Array,  # [N P] float32, written
) -> None:
    """`chain_rule` for splats [start, stop)."""
    blended = np.empty((3, 4), np.float32)
    q, scaled = np.empty((3, 3), np.float32), np.empty((3, 3), np.float32)
    spread, jacobian = np.empty((3, 3), np.float32), np.empty((2, 3), np.float32)
    point = np.empty(3, np.float32)
    by_b, by_spread = np.empty((2, 3), np.float32), np.empty((3, 3), np.float32)
    by_q, by_point = np.empty((3, 3), np.float32), np.empty(3, np.float32)
    by_world = np.empty(3, np.float32)
    for i in range(start, stop):
        if boxes[i, 0] == EMPTY_BOX or on_picture[i, CONTRIBUTION] == 0.0:
            gradient[i, :] = 0.0
            continue
        _blend(transforms, joints, weights, i, blended)
        inverse_norm = _geometry(parameters, i, blended, camera, q, scaled, spread, point, jacobian)
        a, b, c = projected[i, CONIC_A], projected[i, CONIC_B], projected[i, CONIC_C]
        ga, gb, gc = (
            on_picture[i, CONIC_A],
            _F(0.5) * on_picture[i, CONIC_B],
            on_picture[i, CONIC_C],
        )
        # dL/dcov = -C G C for the symmetric C (inverse covariance) and G (its gradient)
        ha0, ha1 = a * ga + b * gb, a * gb + b * gc
        hb0, hb1 = b * ga + c * gb, b * gb + c * gc
        cov_xx, cov_xy, cov_yy = -(ha0 * a + ha1 * b), -(ha0 * b + ha1 * c), -(hb0 * b + hb1 * c)
        alpha = projected[i, ALPHA]
        area = _F(1.0) / max(a * c - b * b, _F(1e-12))
        xx, xy, yy = c * area - _FILTER, -b * area, a * area - _FILTER
        bare = xx * yy - xy * xy
        if bare > _LEAST_AREA:
            # d log sqrt(det(C - F) / det(C)) / dC = ((C - F)^-1 - C^-1) / 2
            half = _F(0.5) * on_picture[i, ALPHA] * alpha
            cov_xx += half * (yy / bare - a)
            cov_xy -= half * (xy / bare + b)
            cov_yy += half * (xx / bare - c)
        for k in range(3):
            bx = jacobian[0, 0] * spread[0, k] + jacobian[0, 2] * spread[2, k]
            by = jacobian[1, 1] * spread[1, k] + jacobian[1, 2] * spread[2, k]
            by_b[0, k] = _F(2.0) * (cov_xx * bx + cov_xy * by)
            by_b[1, k] = _F(2.0) * (cov_xy * bx + cov_yy * by)
        j02, j12 = _F(0.0), _F(0.0)
        j00, j11 = _F(0.0), _F(0.0)
        for k in range(3):
            by_spread[0, k] = jacobian[0, 0] * by_b[0, k]
            by_spread[1, k] = jacobian[1, 1] * by_b[1, k]
            by_spread[2, k] = jacobian[0, 2] * by_b[0, k] + jacobian[1, 2] * by_b[1, k]
            j00 += by_b[0, k] * spread[0, k]
            j02 += by_b[0, k] * spread[2, k]
            j11 += by_b[1, k] * spread[1, k]
            j12 += by_b[1, k] * spread[2, k]
        for k in range(3):
            gradient[i, LOG_SCALE + k] = (
                by_spread[0, k] * spread[0, k]
                + by_spread[1, k] * spread[1, k]
                + by_spread[2, k] * spread[2, k]
            )
            scale = math.exp(parameters[i, LOG_SCALE + k])
            for r in range(3):
                by_q[r, k] = scale * (
                    scaled[0, r] * by_spread[0, k]
                    + scaled[1, r] * by_spread[1, k]
                    + scaled[2, r] * by_spread[2, k]
                )
        _quaternion_gradient(parameters, i, inverse_norm, by_q, gradient)
        fx, fy = camera[3, 0], camera[3, 1]
        iz = _F(1.0) / point[2]
        gu, gv = on_picture[i, MEAN_X], on_picture[i, MEAN_Y]
        by_point[0] = gu * fx * iz - j02 * fx * iz * iz
        by_point[1] = gv * fy * iz - j12 * fy * iz * iz
        by_point[2] = (
            -(gu * fx * point[0] + gv * fy * point[1]) * iz * iz
            - (j00 * fx + j11 * fy) * iz * iz
            + _F(2.0) * (j02 * fx * point[0] + j12 * fy * point[1]) * iz * iz * iz
        )
        for r in range(3):
            by_world[r] = (
                camera[0, r] * by_point[0] + camera[1, r] * by_point[1] + camera[2, r] * by_point[2]
            )
        for k in range(3):
            gradient[i, POSITION + k] = (
                blended[0, k] * by_world[0]
                + blended[1, k] * by_world[1]
                + blended[2, k] * by_world[2]
            )
            gradient[i, COLOUR + k] = on_picture[i, RED + k]
        through = _F(1.0) / (_F(1.0) + math.exp(parameters[i, OPACITY]))
        gradient[i, OPACITY] = on_picture[i, ALPHA] * alpha * through


@numba.njit(parallel=True, fastmath=True, nogil=True, cache=True)
def chain_rule(
    parameters: Array,  # [N P] float32
    joints: Array,  # [N 4] uint16
    weights: Array,  # [N 4] float32
    transforms: Array,  # [K 4 4] float32
    camera: Array,  # [4 4] float32
    projected: Array,  # [N Q] float32
    boxes: Array,  # [N 4] int32
    on_picture: Array,  # [N Q] float32: gradient by what was projected; last: contribution
    threads: int,
    gradient: Array,  # [N P] float32, written
) -> None:
    """Gradients of all splats by their parameters."""
    count = parameters.shape[0]
    for thread in numba.prange(threads):
        _chain_rule_range(
            parameters,
            joints,
            weights,
            transforms,
            camera,
            projected,
            boxes,
            count * thread // threads,
            count * (thread + 1) // threads,
            on_picture,
            gradient,
        )


@numba.njit(inline="always", fastmath=True)
def _quaternion_gradient(parameters, i, inverse_norm, g, gradient):
    """Gradient by the raw quaternion: through the matrix, then through the normalisation."""
    w = parameters[i, ROTATION] * inverse_norm
    x = parameters[i, ROTATION + 1] * inverse_norm
    y = parameters[i, ROTATION + 2] * inverse_norm
    z = parameters[i, ROTATION + 3] * inverse_norm
    two = _F(2.0)
    gw = two * (-z * g[0, 1] + y * g[0, 2] + z * g[1, 0] - x * g[1, 2] - y * g[2, 0] + x * g[2, 1])
    gx = two * (
        y * (g[0, 1] + g[1, 0])
        + z * (g[0, 2] + g[2, 0])
        - two * x * (g[1, 1] + g[2, 2])
        + w * (g[2, 1] - g[1, 2])
    )
    gy = two * (
        x * (g[0, 1] + g[1, 0])
        + z * (g[1, 2] + g[2, 1])
        - two * y * (g[0, 0] + g[2, 2])
        + w * (g[0, 2] - g[2, 0])
    )
    gz = two * (
        x * (g[0, 2] + g[2, 0])
        + y * (g[1, 2] + g[2, 1])
        - two * z * (g[0, 0] + g[1, 1])
        + w * (g[1, 0] - g[0, 1])
    )
    along = gw * w + gx * x + gy * y + gz * z
    gradient[i, ROTATION] = (gw - along * w) * inverse_norm
    gradient[i, ROTATION + 1] = (gx - along * x) * inverse_norm
    gradient[i, ROTATION + 2] = (gy - along * y) * inverse_norm
    gradient[i, ROTATION + 3] = (gz - along * z) * inverse_norm
