"""The terms of the clip-wide fit, a file each: a new clue is a new file, and a line here.

Those that use landmarks alone hold from the start; those that look at pictures join in once poses
are about right, beside the silhouette, which also tells which frames are outliers.
"""

from __future__ import annotations

from capture.fitting.terms.acceleration import Acceleration
from capture.fitting.terms.clip_priors import ClipPriors
from capture.fitting.terms.floor import FloorContact
from capture.fitting.terms.flow import OpticalFlow
from capture.fitting.terms.foot_sliding import FootSliding
from capture.fitting.terms.joint_angle_prior import JointAnglePrior
from capture.fitting.terms.landmarks_3d import Landmarks3D
from capture.fitting.terms.lifted_pose import LiftedPose
from capture.fitting.terms.part_poses import PartPoses
from capture.fitting.terms.reprojection import ReprojectionError
from capture.fitting.terms.upright import Upright

__all__ = ["IMAGE_TERMS", "LANDMARK_TERMS"]

LANDMARK_TERMS = (
    ReprojectionError,
    PartPoses,
    Landmarks3D,
    JointAnglePrior,
    LiftedPose,
    Upright,
    Acceleration,
    FootSliding,
    ClipPriors,
)
IMAGE_TERMS = (FloorContact, OpticalFlow)
