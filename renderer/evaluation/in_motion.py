"""Pictures of a model in a moment of a motion: loose clothes depend on what was before."""

from __future__ import annotations

import numpy as np

from renderer.performer_model import PerformerModel
from renderer.splats.cloth.hanging import MotionPath
from scene.arrays import Array, Float
from scene.camera import Camera
from scene.motion import Motion, Pose


def rendered_in(
    model: PerformerModel, camera: Camera, pose: Pose, motion: Motion | None
) -> Float[Array, "H W 4"]:
    """`model` in `pose`, with loose clothes as they swing by then in `motion`, premultiplied.

    They have settled in `pose` where it is no moment of `motion`, or there is none.
    """
    return rendered_hung(model, camera, pose, hung_in(model, pose, motion))


def rendered_hung(
    model: PerformerModel, camera: Camera, pose: Pose, hung: Float[Array, "V 3"] | None
) -> Float[Array, "H W 4"]:
    """`model` in `pose`, with loose clothes as they hang by `hung_in`, premultiplied."""
    if hung is None or model.splats is None:
        return model.render(camera, pose)
    return model.splats.render(camera, pose, hung)


def hung_in(model: PerformerModel, pose: Pose, motion: Motion | None) -> Float[Array, "V 3"] | None:
    """Where loose clothes hang by `pose` in `motion`; None without any, or where it is no moment of
    that."""
    splats = model.splats
    if splats is None or splats.cloth is None or motion is None or not _within(motion, pose):
        return None
    path = MotionPath.of(motion, splats.skeleton, np.array([pose.time_s]))
    return path.hung(splats.cloth)[0]


def _within(motion: Motion, pose: Pose) -> bool:
    return bool(motion.times_s[0] <= pose.time_s <= motion.times_s[-1])
