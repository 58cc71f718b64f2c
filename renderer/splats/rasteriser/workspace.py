"""Buffers between splats and a picture: projected, sorted by depth, listed by tiles."""

from __future__ import annotations

import numpy as np

from renderer.splats.layout import PROJECTED, TILE
from scene.arrays import Array, Float, Int
from scene.camera import Camera

_ENTRIES_AT_FIRST = 1 << 16


class Workspace:
    """Buffers of one renderer: made once, grown when a picture or its lists outgrow them."""

    def __init__(self, count: int) -> None:
        self.projected = np.zeros((count, PROJECTED), np.float32)
        self.depth = np.zeros(count, np.float32)
        self.boxes = np.zeros((count, 4), np.int32)
        self.order = np.zeros(count, np.int32)
        self.entries = np.zeros(_ENTRIES_AT_FIRST, np.int32)
        self.starts = np.zeros(1, np.int32)
        self._fill = np.zeros(0, np.int32)

    def arrange(
        self,
        parameters: Float[Array, "N P"],
        joints: Array,
        weights: Float[Array, "N 4"],
        transforms: Float[Array, "K 4 4"],
        packed_camera: Float[Array, "4 4"],
        width: int,
        height: int,
        dilation: float,
    ) -> None:
        """Project, sort and hand out to tiles: afterwards `starts` and `entries` are ready."""
        from renderer.splats.rasteriser.projection_kernels import project
        from renderer.splats.rasteriser.tile_kernels import count_entries, depth_order, fill_entries

        tiles_x, tiles_y = -(-width // TILE), -(-height // TILE)
        if len(self._fill) != tiles_x * tiles_y:
            self._fill = np.zeros(tiles_x * tiles_y, np.int32)
            self.starts = np.zeros(tiles_x * tiles_y + 1, np.int32)
        project(
            parameters,
            joints,
            weights,
            transforms,
            packed_camera,
            width,
            height,
            dilation,
            self.projected,
            self.depth,
            self.boxes,
        )
        drawn = depth_order(self.depth, self.boxes, self.order)
        length = count_entries(self.boxes, self.order, drawn, tiles_x, self.starts)
        if length > len(self.entries):
            self.entries = np.zeros(int(1.5 * length), np.int32)
        fill_entries(self.boxes, self.order, drawn, tiles_x, self.starts, self._fill, self.entries)

    def front(
        self,
        parameters: Float[Array, "N P"],
        joints: Array,
        weights: Float[Array, "N 4"],
        transforms: Float[Array, "K 4 4"],
        camera: Camera,
        dilation: float,
    ) -> Int[Array, "H W"]:
        """Which splat each pixel shows: the one that gives it most; -1 where none does."""
        import numba

        from renderer.splats.rasteriser.visibility_kernels import fill_visibility_buffer

        self.arrange(
            parameters,
            joints,
            weights,
            transforms,
            pack_camera(camera),
            camera.width,
            camera.height,
            dilation,
        )
        front = np.empty((camera.height, camera.width), np.int32)
        threads = numba.get_num_threads()
        fill_visibility_buffer(self.projected, self.starts, self.entries, threads, front)
        return front

    def front_of_pixels(
        self, rows: Int[Array, "M"], columns: Int[Array, "M"], width: int
    ) -> Int[Array, "M"]:
        """The same of some pixels of what was arranged, a picture of `width`."""
        from renderer.splats.rasteriser.visibility_kernels import front_of_pixels

        front = np.empty(len(rows), np.int32)
        places = (rows.astype(np.int32), columns.astype(np.int32))
        front_of_pixels(self.projected, self.starts, self.entries, width, *places, front)
        return front


def pack_camera(camera: Camera) -> Float[Array, "4 4"]:
    """float32 rows R|t, then fx, fy, cx, cy: what the kernels take."""
    packed = np.empty((4, 4), np.float32)
    packed[:3] = camera.world_to_camera
    k = camera.intrinsics
    packed[3] = (k[0, 0], k[1, 1], k[0, 2], k[1, 2])
    return packed
