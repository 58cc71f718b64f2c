"""People stand and sit upright: the vertical is one of the clip's unknowns, and leaning a residual.

One camera shows least how far a trunk leans towards it or away. What it does show is the camera's
own pitch, by the vertical lines of a room; and that in most frames of most clips nobody leans. Both
share one unknown, so that a trunk which tilts in the picture of a pitched camera is upright.
"""

from __future__ import annotations

import torch

from capture.fitting.observations import Observations
from capture.fitting.robust import geman_mcclure
from capture.fitting.state import FitBody, PosedClip
from capture.fitting.term import Term
from scene.arrays import Float, Tensor
from scene.skeleton import JOINT_NAMES

LEAN_RAD, LEANS = 0.09, 4.0
"""Deviation of an upright trunk from the vertical, and deviations from which somebody leans: a
lifter that has to guess takes people to lean by up to 20 degrees."""
SCENE_RAD = 0.03
"""Deviation of the vertical from that of the scene's lines."""
PITCH_RAD, ROLL_RAD = 0.2, 0.05
"""Of a camera whose scene shows none, from level."""
_PELVIS, _NECK = JOINT_NAMES.index("pelvis"), JOINT_NAMES.index("neck")
_HIPS = [JOINT_NAMES.index(f"{side}_hip") for side in ("left", "right")]


class Upright(Term):
    """Squared angles of trunk and pelvis from the vertical, robust, where nothing shows the legs,
    which would tell; and of the vertical from what is known of it.

    A pelvis that is upright has its hidden legs straight below.
    """

    weight = 1.5

    def __init__(self, body: FitBody, seen: Observations) -> None:
        super().__init__(body, seen)
        self._legs_hidden = seen.hidden[:, _HIPS].min(dim=1).values

    def energy(self, clip: PosedClip) -> Float[Tensor, ""]:
        up, posed = clip.state.up, clip.posed
        trunk = posed.joint_positions[:, _NECK] - posed.joint_positions[:, _PELVIS]
        trunk = torch.nn.functional.normalize(trunk, dim=-1)
        pelvis = posed.global_rotations[:, _PELVIS, :, 1]
        leans = [geman_mcclure(_squared_angle(x, up) / LEAN_RAD**2, LEANS) for x in (trunk, pelvis)]
        return (self._legs_hidden * (leans[0] + leans[1])).mean() + self._of_camera(up)

    def _of_camera(self, up: Float[Tensor, "3"]) -> Float[Tensor, ""]:
        if self.seen.up is not None:
            return 0.5 * _squared_angle(up, self.seen.up) / SCENE_RAD**2
        return 0.5 * ((up[2] / PITCH_RAD).square() + (up[0] / ROLL_RAD).square())


def _squared_angle(a: Float[Tensor, "*batch 3"], b: Float[Tensor, "3"]) -> Float[Tensor, "*batch"]:
    """Between unit vectors, rad^2, while it is small."""
    return (a - b).square().sum(-1)
