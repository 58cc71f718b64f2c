"""How a person looks from beside the camera, told by the very frame that was filmed.

Frames from one side leave each splat's depth free, and splats that lie before one another may have
any colours that give the right sum in that order. From beside, depth and order are others: fray,
and specks on skin and cloth. So some steps look at a person from beside. What they should see are
the frame's own pixels, carried over by the smooth surface of the splats (as warped views teach
depth, Zhou et al. 2017). Where the frame does not show that surface they learn nothing, and beyond
its outline there is to be nothing.
"""

from __future__ import annotations

import numpy as np

from renderer.splats.layout import BOX_FILTER_PX2
from renderer.splats.rasteriser.workspace import Workspace, pack_camera
from renderer.splats.training.views import View
from scene.arrays import Array, Bool, Float, Int, UInt8
from scene.camera import Camera

_RIM_PX = 3
"""Beyond the surface's outline, where splats may still show."""


class PosedSurface:
    """The smooth surface of splats in the pose of one frame."""

    def __init__(
        self,
        parameters: Float[Array, "N P"],
        normals: Float[Array, "N 3"],
        joints: Array,
        weights: Float[Array, "N 4"],
        transforms: Float[Array, "K 4 4"],
    ) -> None:
        """Args:
        parameters: of flat splats on the surface, at rest.
        normals: of the surface, at rest.
        transforms: float32, from rest to the world.
        """
        from renderer.splats.training.beside_kernels import pose_surface

        self._parameters, self._joints, self._weights = parameters, joints, weights
        self._transforms = transforms
        self._places = np.empty((len(parameters), 3), np.float32)
        self.normals = np.empty((len(parameters), 3), np.float32)
        """As posed."""
        pose_surface(
            parameters,
            normals,
            joints,
            weights,
            transforms,
            self._places,
            self.normals,
        )

    @property
    def middle(self) -> Float[Array, "3"]:
        """Mean place, m, in the world."""
        return self._places.mean(axis=0, dtype=np.float64)

    def seen_by(
        self, camera: Camera, work: Workspace
    ) -> tuple[Int[Array, "H W"], Float[Array, "H W"]]:
        """Which splat each pixel of `camera` shows, -1 where none does, and how deep the surface
        lies there, m."""
        from renderer.splats.training.beside_kernels import fill_depths

        front = work.front(
            self._parameters,
            self._joints,
            self._weights,
            self._transforms,
            camera,
            BOX_FILTER_PX2,
        )
        depths = np.empty(front.shape, np.float32)
        fill_depths(front, self._places, self.normals, pack_camera(camera), depths)
        return front, depths


def seen_from_beside(
    frame: View,
    filmed: UInt8[Array, "h w 4"],
    camera: Camera,
    surface: PosedSurface,
    one_sided: Bool[Array, "N"],
    work: Workspace,
) -> View:
    """What `camera` sees of the person in `frame`; pixels are `UNKNOWN` where that is not told.

    Args:
        filmed: the pixels of `frame`, at the size in which they were filmed.
        one_sided: splats of parts that are to be told how they look from beside.
    """
    import cv2

    from renderer.splats.training.beside_kernels import UNKNOWN, carry_over

    _, frame_depths = surface.seen_by(frame.window, work)
    front, depths = surface.seen_by(camera, work)
    rgba = np.empty((*front.shape, 4), np.uint8)
    carry_over(
        filmed,
        frame_depths,
        frame.camera,
        front,
        depths,
        surface.normals,
        one_sided,
        pack_camera(camera),
        rgba,
    )
    reach = np.ones((2 * _RIM_PX + 1, 2 * _RIM_PX + 1), np.uint8)
    near = cv2.dilate((front >= 0).astype(np.uint8), reach) > 0
    rgba[near & (front < 0)] = UNKNOWN
    return View.of(rgba, camera)
