"""A field in one pose on a GPU, in Triton: rays are marched, skinned, evaluated and added up.

Letters: t distance along a ray (m), M_i rest -> world of joint i, sigma density (1/m), f
likelihood, T transmittance. A sample is `ray * slots + slot`. The arithmetic is that of `marching`,
`skinning`, `networks` and `canonical`; networks run as in `renderer.fused`: products of half
precision numbers, summed in single precision. Between the kernels only samples that may show
anything are kept.

Numbers that change from frame to frame are not specialised: each kind would be compiled anew, in
the middle of a meeting.
"""

# pyright: reportGeneralTypeIssues=false, reportIndexIssue=false, reportArgumentType=false
# pyright: reportOperatorIssue=false, reportAttributeAccessIssue=false, reportCallIssue=false
# (Triton's ranges, tuples and constants are made for its own compiler)
from __future__ import annotations

import triton
import triton.language as tl

_LEAST_WEIGHT = tl.constexpr(1e-4)


@triton.jit
def _three(at):
    return tl.load(at), tl.load(at + 1), tl.load(at + 2)


@triton.jit
def _direction(view, ray, width):
    """Unit direction through the centre of a window's pixel; view: rotation, eye, cx, cy and the
    inverse of the intrinsics' first two rows and columns."""
    column = (ray % width) + 0.5 - tl.load(view + 12)
    line = (ray // width) + 0.5 - tl.load(view + 13)
    u = column * tl.load(view + 14) + line * tl.load(view + 15)
    v = column * tl.load(view + 16) + line * tl.load(view + 17)
    r = _three(view), _three(view + 3), _three(view + 6)
    x = u * r[0][0] + v * r[1][0] + r[2][0]
    y = u * r[0][1] + v * r[1][1] + r[2][1]
    z = u * r[0][2] + v * r[1][2] + r[2][2]
    unit = 1.0 / tl.sqrt(x * x + y * y + z * z)
    return x * unit, y * unit, z * unit


@triton.jit
def _crossed(low, high, origin, direction):
    """Where a ray enters and leaves one axis of a box, m."""
    safe = tl.where(tl.abs(direction) < 1e-9, 1e-9, direction)
    one, other = (low - origin) / safe, (high - origin) / safe
    return tl.minimum(one, other), tl.maximum(one, other)


@triton.jit
def _span(view, box, direction):
    """Where a ray enters and leaves the box, m; it misses it where it leaves before it enters."""
    eye, low, high = _three(view + 9), _three(box), _three(box + 3)
    x = _crossed(low[0], high[0], eye[0], direction[0])
    y = _crossed(low[1], high[1], eye[1], direction[1])
    z = _crossed(low[2], high[2], eye[2], direction[2])
    near = tl.maximum(tl.maximum(x[0], y[0]), tl.maximum(z[0], 0.0))
    return near, tl.minimum(tl.minimum(x[1], y[1]), z[1])


@triton.jit
def _trilinear(table, x, y, z, mask, depth, height, width):
    """Interpolated numbers of a grid at grid coordinates within it."""
    x0 = tl.minimum(tl.floor(x), width - 2.0)
    y0 = tl.minimum(tl.floor(y), height - 2.0)
    z0 = tl.minimum(tl.floor(z), depth - 2.0)
    fx, fy, fz = x - x0, y - y0, z - z0
    at = table + (z0.to(tl.int32) * height + y0.to(tl.int32)) * width + x0.to(tl.int32)
    total = tl.zeros(x.shape, tl.float32)
    for dz in tl.static_range(2):
        for dy in tl.static_range(2):
            corner = at + (dz * height + dy) * width
            below = tl.load(corner, mask=mask, other=0.0) * (1.0 - fx)
            along = below + tl.load(corner + 1, mask=mask, other=0.0) * fx
            total += along * (fz if dz else 1.0 - fz) * (fy if dy else 1.0 - fy)
    return total


@triton.jit
def _canonical(x, y, z, mask, transforms, reaches, volume, channels, depth, height, width,
               JOINTS: tl.constexpr):  # fmt: skip
    """Where world points come from, and their likelihood (`skinning.reached_skinning`).

    transforms [K 3 4]; reaches [K 6]: the canonical box of each joint; volume: low corner and grid
    points a metre; channels [K D H W].
    """
    total = tl.zeros(x.shape, tl.float32)
    cx, cy, cz = total, total, total
    low, scale = _three(volume), _three(volume + 3)
    for joint in range(JOINTS):
        m = transforms + 12 * joint
        dx, dy, dz = x - tl.load(m + 3), y - tl.load(m + 7), z - tl.load(m + 11)
        nx = tl.load(m) * dx + tl.load(m + 4) * dy + tl.load(m + 8) * dz
        ny = tl.load(m + 1) * dx + tl.load(m + 5) * dy + tl.load(m + 9) * dz
        nz = tl.load(m + 2) * dx + tl.load(m + 6) * dy + tl.load(m + 10) * dz
        first, last = _three(reaches + 6 * joint), _three(reaches + 6 * joint + 3)
        inside = mask & (nx >= first[0]) & (nx <= last[0]) & (ny >= first[1]) & (ny <= last[1])
        inside = inside & (nz >= first[2]) & (nz <= last[2])
        if tl.max(inside.to(tl.int32), 0) > 0:
            weight = _trilinear(
                channels + joint * depth * height * width,
                tl.where(inside, (nx - low[0]) * scale[0], 0.0),
                tl.where(inside, (ny - low[1]) * scale[1], 0.0),
                tl.where(inside, (nz - low[2]) * scale[2], 0.0),
                inside, depth, height, width,
            )  # fmt: skip
            total += weight
            cx += weight * nx
            cy += weight * ny
            cz += weight * nz
    share = 1.0 / tl.maximum(total, _LEAST_WEIGHT)
    return cx * share, cy * share, cz * share, tl.minimum(total, 1.0)


@triton.jit
def _holds(live, cells, x, y, z, mask, depth, height, width):
    """Whether the cell of each point is live (`OccupancyGrid`); cells: low corner, cells a m."""
    low, scale = _three(cells), _three(cells + 3)
    i = tl.minimum(tl.maximum((x - low[0]) * scale[0], 0.0), width - 2.0).to(tl.int32)
    j = tl.minimum(tl.maximum((y - low[1]) * scale[1], 0.0), height - 2.0).to(tl.int32)
    k = tl.minimum(tl.maximum((z - low[2]) * scale[2], 0.0), depth - 2.0).to(tl.int32)
    return tl.load(live + (k * height + j) * width + i, mask=mask, other=0) != 0


@triton.jit(do_not_specialize=["width"])
def march(
    view, box, transforms, reaches, volume, channels, live, cells, kept, counts, steps, width,
    depth, height, across, live_depth, live_height, live_width,
    JOINTS: tl.constexpr, SLOTS: tl.constexpr, LEAST: tl.constexpr, BLOCK: tl.constexpr,
):  # fmt: skip
    """One program a ray: which of its samples may show anything into kept [R SLOTS], how many into
    counts [R], and its step (m) into steps [R]."""
    ray = tl.program_id(0)
    slot = tl.arange(0, BLOCK)
    there = slot < SLOTS
    out = kept + ray.to(tl.int64) * SLOTS + slot
    direction = _direction(view, ray, width)
    near, far = _span(view, box, direction)
    step = (far - near) / SLOTS
    tl.store(steps + ray, step)
    if far <= near:
        tl.store(out, tl.zeros((BLOCK,), tl.int8), mask=there)
        tl.store(counts + ray, 0)
    else:
        eye, t = _three(view + 9), near + (slot + 0.5) * step
        x, y, z, likelihood = _canonical(
            eye[0] + t * direction[0], eye[1] + t * direction[1], eye[2] + t * direction[2],
            there, transforms, reaches, volume, channels, depth, height, across, JOINTS,
        )  # fmt: skip
        keep = there & (likelihood > LEAST)
        keep = keep & _holds(live, cells, x, y, z, keep, live_depth, live_height, live_width)
        tl.store(out, keep.to(tl.int8), mask=there)
        tl.store(counts + ray, tl.sum(keep.to(tl.int32), 0))


@triton.jit
def _encoded(x, y, z, window, IDENTITY: tl.constexpr, INPUTS: tl.constexpr):
    """Positional encoding of points, padded to INPUTS columns, each times its `window`; the
    points themselves first where IDENTITY."""
    column = tl.arange(0, INPUTS)
    wave = column - 3 if IDENTITY else column
    kind = wave % 6
    axis = tl.where(wave < 0, column, kind % 3)[None, :]
    value = tl.where(axis == 0, x[:, None], tl.where(axis == 1, y[:, None], z[:, None]))
    angle = value * tl.exp2((tl.maximum(wave, 0) // 6).to(tl.float32))[None, :]
    turned = tl.where((kind < 3)[None, :], tl.sin(angle), tl.cos(angle))
    if IDENTITY:
        turned = tl.where((wave < 0)[None, :], value, turned)
    return (turned * tl.load(window + column)[None, :]).to(tl.float16)


@triton.jit
def _network(encoded, first, offset, hidden, again, last,
             INPUTS: tl.constexpr, WIDTH: tl.constexpr, OUTPUTS: tl.constexpr,
             DEPTH: tl.constexpr, SKIP: tl.constexpr):  # fmt: skip
    """Outputs of an MLP whose layer SKIP reads the encoding once more; `offset` [WIDTH] is what its
    first layer adds to every row. Weights as [in, out], half precision."""
    unit = tl.arange(0, WIDTH)
    into, column = tl.arange(0, INPUTS)[:, None], tl.arange(0, OUTPUTS)[None, :]
    value = tl.dot(encoded, tl.load(first + into * WIDTH + unit[None, :]))
    value = tl.maximum(value + tl.load(offset + unit)[None, :], 0.0).to(tl.float16)
    for layer in tl.static_range(2, DEPTH + 1):
        at = hidden + (layer - 2) * WIDTH * WIDTH + unit[:, None] * WIDTH + unit[None, :]
        made = tl.dot(value, tl.load(at))
        if layer == SKIP:
            made = tl.dot(encoded, tl.load(again + into * WIDTH + unit[None, :]), made)
        value = tl.maximum(made, 0.0).to(tl.float16)
    return tl.dot(value, tl.load(last + unit[:, None] * OUTPUTS + column))


@triton.jit
def _column(rows, NUMBER: tl.constexpr, COLUMNS: tl.constexpr):
    mine = tl.arange(0, COLUMNS)[None, :] == NUMBER
    return tl.sum(tl.where(mine, rows, 0.0), 1)


@triton.jit(do_not_specialize=["count", "width"])
def skin(
    samples, count, view, box, transforms, reaches, volume, channels, steps, width,
    depth, height, across, found,
    JOINTS: tl.constexpr, SLOTS: tl.constexpr, BLOCK: tl.constexpr,
):  # fmt: skip
    """found [N 4]: canonical points of `samples` [N], before residual motion; their likelihood."""
    n = tl.program_id(0) * BLOCK + tl.arange(0, BLOCK)
    there = n < count
    sample = tl.load(samples + n, mask=there, other=0)
    ray, slot = sample // SLOTS, sample % SLOTS
    direction = _direction(view, ray, width)
    near, _ = _span(view, box, direction)
    t = near + (slot + 0.5) * tl.load(steps + ray, mask=there, other=0.0)
    eye = _three(view + 9)
    x, y, z, likelihood = _canonical(
        eye[0] + t * direction[0], eye[1] + t * direction[1], eye[2] + t * direction[2],
        there, transforms, reaches, volume, channels, depth, height, across, JOINTS,
    )  # fmt: skip
    out = found + 4 * n
    tl.store(out, x, mask=there)
    tl.store(out + 1, y, mask=there)
    tl.store(out + 2, z, mask=there)
    tl.store(out + 3, likelihood, mask=there)


@triton.jit(do_not_specialize=["count"])
def move(
    found, count, live, cells, live_depth, live_height, live_width,
    window, first, offset, hidden, again, last,
    MOVED: tl.constexpr, INPUTS: tl.constexpr, WIDTH: tl.constexpr, OUTPUTS: tl.constexpr,
    DEPTH: tl.constexpr, SKIP: tl.constexpr, BLOCK: tl.constexpr,
):  # fmt: skip
    """Adds the residual motion to `found` [N 4] where MOVED, and takes away the likelihood of what
    lies where the canonical space is empty."""
    n = tl.program_id(0) * BLOCK + tl.arange(0, BLOCK)
    there = n < count
    out = found + 4 * n
    x = tl.load(out, mask=there, other=0.0)
    y = tl.load(out + 1, mask=there, other=0.0)
    z = tl.load(out + 2, mask=there, other=0.0)
    if MOVED:
        change = _network(
            _encoded(x, y, z, window, False, INPUTS), first, offset, hidden, again, last,
            INPUTS, WIDTH, OUTPUTS, DEPTH, SKIP,
        )  # fmt: skip
        x += _column(change, 0, OUTPUTS)
        y += _column(change, 1, OUTPUTS)
        z += _column(change, 2, OUTPUTS)
        tl.store(out, x, mask=there)
        tl.store(out + 1, y, mask=there)
        tl.store(out + 2, z, mask=there)
    filled = _holds(live, cells, x, y, z, there, live_depth, live_height, live_width)
    tl.store(out + 3, tl.zeros((BLOCK,), tl.float32), mask=there & (filled == 0))


@triton.jit(do_not_specialize=["count"])
def evaluate(
    chosen, count, samples, found, steps, window, first, offset, hidden, again, last, rgba,
    SCALE: tl.constexpr, START: tl.constexpr, SLOTS: tl.constexpr, INPUTS: tl.constexpr,
    WIDTH: tl.constexpr, OUTPUTS: tl.constexpr, DEPTH: tl.constexpr, SKIP: tl.constexpr,
    BLOCK: tl.constexpr,
):  # fmt: skip
    """Colour and alpha of the samples `chosen` [count] into their rows of rgba [N 4]."""
    n = tl.program_id(0) * BLOCK + tl.arange(0, BLOCK)
    there = n < count
    row = tl.load(chosen + n, mask=there, other=0)
    x = tl.load(found + 4 * row, mask=there, other=0.0)
    y = tl.load(found + 4 * row + 1, mask=there, other=0.0)
    z = tl.load(found + 4 * row + 2, mask=there, other=0.0)
    made = _network(
        _encoded(x, y, z, window, True, INPUTS), first, offset, hidden, again, last,
        INPUTS, WIDTH, OUTPUTS, DEPTH, SKIP,
    )  # fmt: skip
    ray = tl.load(samples + row, mask=there, other=0) // SLOTS
    step = tl.load(steps + ray, mask=there, other=0.0)
    density = tl.maximum(SCALE * _column(made, 3, OUTPUTS) + START, 0.0)
    alpha = tl.load(found + 4 * row + 3, mask=there, other=0.0) * (1.0 - tl.exp(-density * step))
    out = rgba + 4 * row
    tl.store(out, tl.sigmoid(_column(made, 0, OUTPUTS)), mask=there)
    tl.store(out + 1, tl.sigmoid(_column(made, 1, OUTPUTS)), mask=there)
    tl.store(out + 2, tl.sigmoid(_column(made, 2, OUTPUTS)), mask=there)
    tl.store(out + 3, alpha, mask=there)


@triton.jit(do_not_specialize=["rays"])
def composite(rgba, ends, counts, rays, picture, BLOCK: tl.constexpr):
    """Samples of each ray, front to back, into picture [R 4]: premultiplied RGBA. A ray's samples
    are the `counts` [R] before `ends` [R]."""
    ray = tl.program_id(0) * BLOCK + tl.arange(0, BLOCK)
    there = ray < rays
    mine = tl.load(counts + ray, mask=there, other=0)
    start = tl.load(ends + ray, mask=there, other=0) - mine
    through = tl.full((BLOCK,), 1.0, tl.float32)
    red = tl.zeros((BLOCK,), tl.float32)
    green, blue = red, red
    for place in range(tl.max(mine, 0)):
        at = rgba + 4 * (start + place)
        some = there & (place < mine)
        weight = through * tl.load(at + 3, mask=some, other=0.0)
        red += weight * tl.load(at, mask=some, other=0.0)
        green += weight * tl.load(at + 1, mask=some, other=0.0)
        blue += weight * tl.load(at + 2, mask=some, other=0.0)
        through -= weight
    out = picture + 4 * ray
    tl.store(out, red, mask=there)
    tl.store(out + 1, green, mask=there)
    tl.store(out + 2, blue, mask=there)
    tl.store(out + 3, 1.0 - through, mask=there)
