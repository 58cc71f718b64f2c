"""The lifter's poses, in units of its predicted error."""

from __future__ import annotations

from capture.fitting.kinematics import rotation_matrices
from capture.fitting.robust import pseudo_huber
from capture.fitting.state import PosedClip
from capture.fitting.term import Term
from scene.arrays import Float, Tensor


class LiftedPose(Term):
    """Squared angles between joints' local rotations and the lifter's, robust.

    The lifter regresses each frame towards the mean pose; a person's constant deviation shows only
    in the whole clip, so the same rotation in all frames costs next to nothing
    (`FitState.lifter_bias`).
    """

    weight = 5.0

    def energy(self, clip: PosedClip) -> Float[Tensor, ""]:
        state, seen = clip.state, self.seen
        # |R - S|^2 = 8 sin^2(angle / 2), twice the squared angle where that is small
        lifted = seen.lifted_rotations @ rotation_matrices(state.lifter_bias)
        squared = 0.5 * (clip.local_rotations - lifted).square().sum((-1, -2))
        loss = pseudo_huber(squared / seen.lifted_spread_rad.square()) * (1.0 - seen.hidden)
        return (state.frame_confidence * loss.sum(1)).mean()
