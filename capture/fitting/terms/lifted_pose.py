"""The poses that the lifter believes, in its own usual errors."""

from __future__ import annotations

from capture.fitting.kinematics import rotation_matrices
from capture.fitting.robust import pseudo_huber
from capture.fitting.state import PosedClip
from capture.fitting.term import Term
from scene.arrays import Float, Tensor


class LiftedPose(Term):
    """Squared angles between joints' local rotations and the lifter's, robust.

    Frame by frame the lifter draws everybody towards the usual; how somebody holds their head all
    along shows in the whole clip only, so the same rotation in all frames costs next to nothing
    (`FitState.habits`).
    """

    weight = 5.0

    def energy(self, clip: PosedClip) -> Float[Tensor, ""]:
        state, seen = clip.state, self.seen
        # |R - S|^2 = 8 sin^2(angle / 2), twice the squared angle where that is small
        believed = seen.lifted_rotations @ rotation_matrices(state.habits)
        squared = 0.5 * (state.local_rotations() - believed).square().sum((-1, -2))
        loss = pseudo_huber(squared / seen.lifted_spread_rad.square()) * (1.0 - seen.hidden)
        return (state.frame_confidence * loss.sum(1)).mean()
