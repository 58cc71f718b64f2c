"""How somebody stands whom their webcam sees no longer: quietly, on the feet that stood."""

from __future__ import annotations

import numpy as np

from scene.limits import ELBOW_HINGE
from scene.rotations import axis_angle_to_matrix
from scene.skeleton import JOINT_NAMES, Skeleton
from services.live.motion.foot_locking import LEGS, FootTarget, placed_joints, with_feet
from services.live.motion.solved_motion import LocalPose

_HANGING_RAD, _ELBOW_RAD = 1.45, 0.3


class RestingStance:
    """One performer's; the same for any thread."""

    def __init__(self, skeleton: Skeleton, yaw_rad: float = 0.0) -> None:
        """Whoever faces their camera is turned by `yaw_rad` about +y."""
        self._rest = np.array(skeleton.rest_joints)
        hanging = self._hanging = np.tile(np.eye(3), (len(self._rest), 1, 1))
        hanging[0] = axis_angle_to_matrix(np.array([0.0, yaw_rad, 0.0]))
        for side, out in (("left", 1.0), ("right", -1.0)):
            shoulder, elbow = (JOINT_NAMES.index(f"{side}_{n}") for n in ("shoulder", "elbow"))
            hanging[shoulder] = axis_angle_to_matrix(np.array([0.0, 0.0, -out * _HANGING_RAD]))
            hanging[elbow] = axis_angle_to_matrix(_ELBOW_RAD * np.array(ELBOW_HINGE[side]))

    def at_rest(self, last: LocalPose, feet_locked: tuple[bool, bool]) -> LocalPose:
        """Arms hanging, facing the front, where the pose `last` stood; feet that were locked stay,
        if the legs reach so far."""
        rest, pelvis = self._rest, self._rest[0] + last.root
        rotations, positions = placed_joints(rest, last.local, pelvis)
        pelvis = np.array([pelvis[0], rest[0, 1], pelvis[2]])
        beneath, below = placed_joints(rest, self._hanging, pelvis)
        feet = []
        for ankle, locked in zip(LEGS[:, 2], feet_locked, strict=True):
            wanted = below[ankle], beneath[ankle]
            foot = FootTarget(positions[ankle], rotations[ankle])
            feet.append(foot.target(*wanted) if locked else wanted)
        return with_feet(rest, self._hanging, pelvis, feet)
