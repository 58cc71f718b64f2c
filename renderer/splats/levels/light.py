"""How much each splat shows in pictures from all round: what merging it with others costs."""

from __future__ import annotations

import numpy as np

from renderer.splats.layout import BOX_FILTER_PX2, CONTRIBUTION, PROJECTED
from renderer.splats.model import SplatModel
from renderer.splats.rasteriser.workspace import Workspace, pack_camera
from scene.arrays import Array, Float
from scene.camera import orbit_camera

_VIEWS, _SIZE_PX = 8, 256
_DISTANCE_HEIGHTS = 2.0
_ELEVATIONS_RAD = (0.1, 0.5)
_TURN_RAD = 2.4
"""The golden angle: any number of views go evenly all round."""


def light_all_round(model: SplatModel, views: int = _VIEWS) -> Float[Array, "N"]:
    """Blending weight of each splat, px, summed over `views` of 256 px all round in poses of its
    own."""
    import numba

    from renderer.splats.rasteriser.tile_kernels import draw_and_differentiate

    size = (_SIZE_PX, _SIZE_PX)
    work, threads = Workspace(len(model)), numba.get_num_threads()
    nothing = np.zeros((*size, 4), np.uint8)
    summed = np.zeros((threads, len(model), PROJECTED), np.float32)
    height_m = model.skeleton.height_m
    for view in range(views):
        pose = model.motion.pose(view * len(model.motion) // views)
        upright = np.array([0.0, pose.root_translation[1], 0.0])
        camera = orbit_camera(
            (0.0, 0.55 * height_m, 0.0),
            _DISTANCE_HEIGHTS * height_m,
            view * _TURN_RAD,
            _ELEVATIONS_RAD[view % 2],
            *size,
        )
        transforms = model.skeleton.skinning_transforms(pose.joint_angles, upright)
        work.arrange(
            model.parameters,
            model.joints,
            model.weights,
            transforms.astype(np.float32),
            pack_camera(camera),
            *size,
            BOX_FILTER_PX2,
        )
        draw_and_differentiate(
            work.projected,
            work.starts,
            work.entries,
            nothing,
            np.zeros(3, np.float32),
            1.0,
            summed,
            np.zeros(threads),
        )
    return summed[:, :, CONTRIBUTION].sum(axis=0)
