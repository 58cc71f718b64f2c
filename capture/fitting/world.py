"""From the camera's frame to the world: where the floor is, where the person stands."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from capture.body.inverse_kinematics import unit
from capture.detection.landmark_arrays import joint_confidence
from capture.fitting.result import Fit
from capture.fitting.terms.floor import upward
from scene.arrays import Array, Float
from scene.body import Body
from scene.motion import Motion, Pose
from scene.rotations import axis_angle_to_matrix, matrix_to_axis_angle
from scene.skeleton import JOINT_NAMES

OPENGL_TO_OPENCV = np.diag([1.0, -1.0, -1.0])
"""The fit's frame (OpenGL: y up, z towards the viewer) to OpenCV's camera frame."""
_LEGS_SEEN, _LEGS_SHARE = 0.3, 0.2
"""Confidence in knees and ankles, and the share of the frames that have it: who is filmed close to
the camera first, and then from head to foot, has legs."""
_LOWEST_PERCENTILE = 10.0

_J = {name: index for index, name in enumerate(JOINT_NAMES)}


@dataclass(frozen=True, eq=False)
class PlacedFit:
    """A fit in world coordinates."""

    body: Body
    motion: Motion
    """With the confidence of each joint."""
    world_to_camera: Float[Array, "3 4"]
    legs_seen: bool


def place_in_world(fit: Fit, times_s: Float[Array, "F"]) -> PlacedFit:
    """Rotate the fit upright, with the floor at y = 0 and the person about x = z = 0.

    The camera ends up on the side of +z. Where the fit found no floor, it is where the lowest point
    of the surface is in nearly all frames.
    """
    body, confidence = fit.body, joint_confidence(fit.weights)
    legs = [_J["left_knee"], _J["right_knee"], _J["left_ankle"], _J["right_ankle"]]
    in_frames = np.median(confidence[:, legs], axis=1) > _LEGS_SEEN
    legs_seen = bool(in_frames.mean() >= _LEGS_SHARE)
    shift = fit.pelvis - body.skeleton.rest_joints[0]
    joints = body.skeleton.joint_transforms(fit.joint_angles, shift)[..., :3, 3]
    up = fit.up if not legs_seen else upward(joints) if fit.floor is None else fit.floor[:3]
    up_rotation = _upright(up)
    pelvis = fit.pelvis @ up_rotation.T
    angles = fit.joint_angles.copy()
    angles[:, 0] = matrix_to_axis_angle(up_rotation @ axis_angle_to_matrix(angles[:, 0]))
    root = pelvis - body.skeleton.rest_joints[0]
    middle = np.median(pelvis, axis=0)
    level = _lowest(body, angles, root) if fit.floor is None else fit.floor[3]
    origin = np.array([middle[0], level, middle[2]])
    motion = Motion(times_s, angles, root - origin, confidence)
    # x_fit = up_rotation^T (x_world + origin)
    rotation = OPENGL_TO_OPENCV @ up_rotation.T
    world_to_camera = np.concatenate([rotation, (rotation @ origin)[:, None]], axis=1)
    return PlacedFit(body, motion, world_to_camera, legs_seen)


def _upright(up: Array) -> Array:
    """Rotation camera -> world: `up` becomes y, and the camera's side stays at +z."""
    towards = np.array([0.0, 0.0, 1.0])
    z = unit(towards - (towards @ up) * up)
    return np.stack([np.cross(up, z), up, z])


def _lowest(body: Body, angles: Array, root: Array) -> float:
    lowest = [
        body.posed_vertices(Pose(angles[frame], root[frame]))[:, 1].min()
        for frame in np.unique(np.linspace(0, len(angles) - 1, 24).astype(int))
    ]
    return float(np.percentile(lowest, _LOWEST_PERCENTILE))
