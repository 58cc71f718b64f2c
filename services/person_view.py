"""Where to look at one person from: a sphere round them, told by the way they face.

Azimuth 0 is in front of the way the person mostly faces in the motion that is shown, +90 degrees at
their left, whichever way that is in the world; a pose of its own counts as a motion of one moment.
"""

from __future__ import annotations

import math

from scene.camera import Camera, orbit_camera
from scene.motion import Motion, Pose
from scene.skeleton import Skeleton
from services.live.room import facing_yaw

_MARGIN = 1.25
"""The whole person and some air, when the distance is left open."""


def person_camera(
    skeleton: Skeleton,
    motion: Motion,
    pose: Pose,
    *,
    azimuth_deg: float,
    elevation_deg: float,
    distance_m: float | None,
    width: int,
    height: int,
    fov_y_rad: float,
) -> Camera:
    """A camera of `width` x `height` px that looks at a person of `skeleton` standing in `pose`.

    The side is counted from how they face in `motion`. Without a distance all of them is seen.
    """
    joints = skeleton.joint_transforms(pose.joint_angles, pose.root_translation)[:, :3, 3]
    centre = joints.mean(axis=0)
    centre[1] = 0.5 * (joints[:, 1].min() + joints[:, 1].max())
    if distance_m is None:
        narrow = min(1.0, width / height)
        distance_m = 0.5 * _MARGIN * skeleton.height_m / math.tan(0.5 * fov_y_rad) / narrow
    azimuth_rad = math.radians(azimuth_deg) - facing_yaw(motion)
    return orbit_camera(
        centre, distance_m, azimuth_rad, math.radians(elevation_deg), width, height, fov_y_rad
    )
