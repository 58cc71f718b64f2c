"""Splats on a GPU, in Triton: skinned and projected, listed by blocks of the picture, blended.

Letters as in `project_kernels`, whose arithmetic this is. Nothing is sorted twice and no list's
length is asked of the GPU: a block of the picture goes through all splats, front to back, and keeps
those whose boxes it meets; a tile does so with its block's list, a piece at a time, and blends what
is left. Every loop is over sorted splats, so that all lists are sorted too. Sizes are not
specialised: what was compiled for one splat, before the first meeting, serves any number.
"""

# pyright: reportGeneralTypeIssues=false, reportIndexIssue=false, reportArgumentType=false
# pyright: reportOperatorIssue=false, reportAttributeAccessIssue=false, reportCallIssue=false
# (Triton's ranges, tuples and constants are made for its own compiler)
from __future__ import annotations

import triton
import triton.language as tl

from renderer.splats import layout

SHOWN = 12
"""Numbers of a splat as tiles read it: centre, half its inverse covariance, opacity, colour, and
how far above and below its centre it can be seen; two are unused, so that a row is 48 bytes."""
_SHOWN = tl.constexpr(SHOWN)
_P = tl.constexpr(layout.PARAMETERS)
_SCALE = tl.constexpr(layout.LOG_SCALE)
_TURN = tl.constexpr(layout.ROTATION)
_COLOUR = tl.constexpr(layout.COLOUR)
_OPACITY = tl.constexpr(layout.OPACITY)
_FAINTEST = tl.constexpr(layout.FAINTEST)
_FILTER = tl.constexpr(layout.BOX_FILTER_PX2)
_LEAST_AREA = tl.constexpr(layout.LEAST_AREA_PX4)
_NEAR = tl.constexpr(layout.NEAR_M)
_MOST_OPAQUE = tl.constexpr(layout.MOST_OPAQUE)
_EMPTY = tl.constexpr(layout.EMPTY_BOX)
_TILE = tl.constexpr(layout.TILE)
_FINISHED = tl.constexpr(layout.FINISHED)
_FARTHEST = tl.constexpr(3.0e38)


@triton.jit
def _blended_row(transforms, joints, weights, i, there, ROW: tl.constexpr):
    """A row of M = sum_k w_k T_k for each splat: four numbers."""
    a = tl.zeros(i.shape, tl.float32)
    b, c, d = a, a, a
    for k in tl.static_range(4):
        joint = tl.load(joints + 4 * i + k, mask=there, other=0)
        share = tl.load(weights + 4 * i + k, mask=there, other=0.0)
        at = transforms + 16 * joint + 4 * ROW
        a += share * tl.load(at, mask=there, other=0.0)
        b += share * tl.load(at + 1, mask=there, other=0.0)
        c += share * tl.load(at + 2, mask=there, other=0.0)
        d += share * tl.load(at + 3, mask=there, other=0.0)
    return a, b, c, d


@triton.jit
def _camera_row(camera, ROW: tl.constexpr):
    at = camera + 4 * ROW
    return tl.load(at), tl.load(at + 1), tl.load(at + 2), tl.load(at + 3)


@triton.jit
def _dot(row, x, y, z):
    return row[0] * x + row[1] * y + row[2] * z


@triton.jit
def _axis(body, eye, log_length, x, y, z):
    """A splat's axis (x, y, z), skinned, as the camera sees it, its length on it: R A Q S."""
    wx, wy, wz = _dot(body[0], x, y, z), _dot(body[1], x, y, z), _dot(body[2], x, y, z)
    length = tl.exp(log_length)
    return (
        length * _dot(eye[0], wx, wy, wz),
        length * _dot(eye[1], wx, wy, wz),
        length * _dot(eye[2], wx, wy, wz),
    )


@triton.jit(do_not_specialize=["count", "width", "height"])
def project(
    parameters,
    joints,
    weights,
    transforms,
    camera,
    count,
    width,
    height,
    dilation,
    shown,
    depth,
    boxes,
    BLOCK: tl.constexpr,
):
    """shown [N SHOWN], depth [N] (m; past all others where unseen) and boxes [N 4] of parameters
    [N P], joints [N 4] int32, weights [N 4], transforms [K 4 4] and camera [4 4]."""
    i = tl.program_id(0) * BLOCK + tl.arange(0, BLOCK)
    there = i < count
    row = parameters + _P * i
    px = tl.load(row, mask=there, other=0.0)
    py = tl.load(row + 1, mask=there, other=0.0)
    pz = tl.load(row + 2, mask=there, other=0.0)
    body = (
        _blended_row(transforms, joints, weights, i, there, 0),
        _blended_row(transforms, joints, weights, i, there, 1),
        _blended_row(transforms, joints, weights, i, there, 2),
    )
    eye = _camera_row(camera, 0), _camera_row(camera, 1), _camera_row(camera, 2)
    lens = _camera_row(camera, 3)
    wx = _dot(body[0], px, py, pz) + body[0][3]
    wy = _dot(body[1], px, py, pz) + body[1][3]
    wz = _dot(body[2], px, py, pz) + body[2][3]
    x = _dot(eye[0], wx, wy, wz) + eye[0][3]
    y = _dot(eye[1], wx, wy, wz) + eye[1][3]
    z = _dot(eye[2], wx, wy, wz) + eye[2][3]

    qw = tl.load(row + _TURN, mask=there, other=1.0)
    qx = tl.load(row + _TURN + 1, mask=there, other=0.0)
    qy = tl.load(row + _TURN + 2, mask=there, other=0.0)
    qz = tl.load(row + _TURN + 3, mask=there, other=0.0)
    unit = 1.0 / tl.sqrt(qw * qw + qx * qx + qy * qy + qz * qz)
    qw, qx, qy, qz = qw * unit, qx * unit, qy * unit, qz * unit
    first = _axis(
        body,
        eye,
        tl.load(row + _SCALE, mask=there, other=0.0),
        1 - 2 * (qy * qy + qz * qz),
        2 * (qx * qy + qw * qz),
        2 * (qx * qz - qw * qy),
    )
    second = _axis(
        body,
        eye,
        tl.load(row + _SCALE + 1, mask=there, other=0.0),
        2 * (qx * qy - qw * qz),
        1 - 2 * (qx * qx + qz * qz),
        2 * (qy * qz + qw * qx),
    )
    third = _axis(
        body,
        eye,
        tl.load(row + _SCALE + 2, mask=there, other=0.0),
        2 * (qx * qz + qw * qy),
        2 * (qy * qz - qw * qx),
        1 - 2 * (qx * qx + qy * qy),
    )
    near = 1.0 / tl.maximum(z, _NEAR)
    jx, jxz = lens[0] * near, -lens[0] * x * near * near
    jy, jyz = lens[1] * near, -lens[1] * y * near * near
    x1, y1 = jx * first[0] + jxz * first[2], jy * first[1] + jyz * first[2]
    x2, y2 = jx * second[0] + jxz * second[2], jy * second[1] + jyz * second[2]
    x3, y3 = jx * third[0] + jxz * third[2], jy * third[1] + jyz * third[2]
    xx = dilation + x1 * x1 + x2 * x2 + x3 * x3
    yy = dilation + y1 * y1 + y2 * y2 + y3 * y3
    xy = x1 * y1 + x2 * y2 + x3 * y3
    inverse = 1.0 / tl.maximum(xx * yy - xy * xy, 1e-12)

    mean_x, mean_y = jx * x + lens[2], jy * y + lens[3]
    bare = (xx - _FILTER) * (yy - _FILTER) - xy * xy
    kept = tl.sqrt(tl.maximum(bare, _LEAST_AREA) * inverse)
    alpha = kept * tl.sigmoid(tl.load(row + _OPACITY, mask=there, other=0.0))
    reach = 2.0 * tl.log(tl.maximum(alpha / _FAINTEST, 1.0))
    half_x, half_y = tl.sqrt(reach * xx), tl.sqrt(reach * yy)
    seen = there & (z > _NEAR) & (alpha > _FAINTEST) & (half_x < 1e6) & (half_y < 1e6)
    seen = seen & (mean_x + half_x >= 0) & (mean_x - half_x <= width)
    seen = seen & (mean_y + half_y >= 0) & (mean_y - half_y <= height)
    out = shown + _SHOWN * i
    tl.store(out, mean_x, mask=seen)
    tl.store(out + 1, mean_y, mask=seen)
    tl.store(out + 2, -0.5 * yy * inverse, mask=seen)
    tl.store(out + 3, xy * inverse, mask=seen)
    tl.store(out + 4, -0.5 * xx * inverse, mask=seen)
    tl.store(out + 5, alpha, mask=seen)
    for channel in tl.static_range(3):
        value = tl.load(row + _COLOUR + channel, mask=there, other=0.0)
        tl.store(out + 6 + channel, value, mask=seen)
    tl.store(out + 9, half_y, mask=seen)
    tl.store(depth + i, tl.where(seen, z, _FARTHEST), mask=there)
    # off the picture a float may be past all integers
    left = tl.maximum(tl.where(seen, (mean_x - half_x) / _TILE, 0.0), 0.0).to(tl.int32)
    right = tl.minimum(tl.where(seen, (mean_x + half_x) / _TILE, 0.0), width / _TILE).to(tl.int32)
    top = tl.maximum(tl.where(seen, (mean_y - half_y) / _TILE, 0.0), 0.0).to(tl.int32)
    bottom = tl.minimum(tl.where(seen, (mean_y + half_y) / _TILE, 0.0), height / _TILE).to(tl.int32)
    tl.store(boxes + 4 * i, tl.where(seen, left, _EMPTY), mask=there)
    tl.store(boxes + 4 * i + 1, right, mask=there)
    tl.store(boxes + 4 * i + 2, top, mask=there)
    tl.store(boxes + 4 * i + 3, bottom, mask=there)


@triton.jit
def _meets(boxes, i, there, left, right, top, bottom):
    """Which of the splats `i` have a box that meets the tiles from `left` to `right`, ..."""
    first = tl.load(boxes + 4 * i, mask=there, other=_EMPTY)
    met = there & (first != _EMPTY) & (first <= right)
    met = met & (tl.load(boxes + 4 * i + 1, mask=met, other=-1) >= left)
    met = met & (tl.load(boxes + 4 * i + 2, mask=met, other=0) <= bottom)
    return met & (tl.load(boxes + 4 * i + 3, mask=met, other=-1) >= top)


@triton.jit(do_not_specialize=["count", "blocks_x"])
def list_blocks(
    order, boxes, count, blocks_x, lists, lengths, SIDE: tl.constexpr, PIECE: tl.constexpr
):
    """One program a block of SIDE x SIDE tiles: its splats, front to back, into its row of lists
    [blocks N], how many into lengths [blocks]."""
    block = tl.program_id(0)
    left, top = (block % blocks_x) * SIDE, (block // blocks_x) * SIDE
    found = 0
    out = lists + block.to(tl.int64) * count
    for start in range(0, count, PIECE):
        place = start + tl.arange(0, PIECE)
        i = tl.load(order + place, mask=place < count, other=0)
        met = _meets(boxes, i, place < count, left, left + SIDE - 1, top, top + SIDE - 1)
        rank = tl.cumsum(met.to(tl.int32), 0)
        tl.store(out + found + rank - 1, i.to(tl.int32), mask=met)
        found += tl.sum(met.to(tl.int32), 0)
    tl.store(lengths + block, found)


@triton.jit(do_not_specialize=["count", "width", "height", "tiles_x", "blocks_x"])
def blend(
    shown,
    boxes,
    lists,
    lengths,
    count,
    width,
    height,
    tiles_x,
    blocks_x,
    kept,
    busy,
    out,
    SIDE: tl.constexpr,
    PIECE: tl.constexpr,
):
    """One program a tile: out [H W 4] premultiplied, busy [tiles] where anybody is.

    kept [tiles PIECE] is room for a piece of a tile's own list.
    """
    tile = tl.program_id(0)
    tile_x, tile_y = tile % tiles_x, tile // tiles_x
    block = (tile_y // SIDE) * blocks_x + tile_x // SIDE
    inside = tl.arange(0, _TILE * _TILE)
    column, line = tile_x * _TILE + inside % _TILE, tile_y * _TILE + inside // _TILE
    x, y = column + 0.5, line + 0.5
    through = tl.full((_TILE * _TILE,), 1.0, tl.float32)
    red = tl.zeros((_TILE * _TILE,), tl.float32)
    green, blue = red, red
    length = tl.load(lengths + block)
    mine = lists + block.to(tl.int64) * count
    room = kept + tile * PIECE
    start, some = 0, 0
    while start < length:
        place = start + tl.arange(0, PIECE)
        i = tl.load(mine + place, mask=place < length, other=0)
        met = _meets(boxes, i, place < length, tile_x, tile_x, tile_y, tile_y)
        rank = tl.cumsum(met.to(tl.int32), 0)
        tl.store(room + rank - 1, i, mask=met)
        found = tl.sum(met.to(tl.int32), 0)
        tl.debug_barrier()
        for n in range(found):
            splat = shown + _SHOWN * tl.load(room + n)
            dx, dy = x - tl.load(splat), y - tl.load(splat + 1)
            power = tl.load(splat + 4) * dy * dy
            power += dx * (tl.load(splat + 3) * dy + tl.load(splat + 2) * dx)
            alpha = tl.load(splat + 5) * tl.exp(tl.minimum(power, 0.0))
            # the same pixels as in the CPU's tiles: whole lines
            near = tl.abs(dy) <= tl.load(splat + 9)
            weight = through * tl.where(near, tl.minimum(alpha, _MOST_OPAQUE), 0.0)
            through -= weight
            red += weight * tl.load(splat + 6)
            green += weight * tl.load(splat + 7)
            blue += weight * tl.load(splat + 8)
        tl.debug_barrier()
        some += found
        start = tl.where(tl.max(through, 0) < _FINISHED, length, start + PIECE)
    there = (column < width) & (line < height)
    at = out + 4 * (line.to(tl.int64) * width + column)
    tl.store(at, red, mask=there)
    tl.store(at + 1, green, mask=there)
    tl.store(at + 2, blue, mask=there)
    tl.store(at + 3, 1.0 - through, mask=there)
    tl.store(busy + tile, some > 0)
