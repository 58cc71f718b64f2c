"""Feet that stand stay at one height while poses are refined.

Pixels tell depth worst, and with it height under a camera that looks down: refined by pixels alone,
who stands bobs by centimetres. The floor is at y = 0, so a heel or toes that the estimate has there
stand, and go up or down only as all that stand do: longer legs put the whole floor lower.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from renderer.pose_refinement.photometry import descendants, pose_jacobian
from scene.arrays import Array, Float
from scene.motion import Motion
from scene.skeleton import FOOT_JOINTS, Skeleton

_FEET = list(FOOT_JOINTS)
_SOLES_M = np.array([-0.05, 0.05, -0.05, 0.05])
"""How far before its joint each place of a sole lies: heels behind ankles, toes before balls."""
_STANDING_M = 0.03
"""Height from which a sole is in the air."""
_DEVIATION_M = 0.01
"""Of the height of what stands."""
_UP = np.array([[0.0, 1.0, 0.0]])


@dataclass(frozen=True, eq=False)
class FootContacts:
    """Heights of heels and toes in all frames, and how far each stands."""

    heights: Float[Array, "F 4"]
    """m, as estimated."""
    stands: Float[Array, "F 4"]
    """0 to 1."""

    @classmethod
    def of(cls, skeleton: Skeleton, motion: Motion) -> FootContacts:
        """What stands in `motion`, on y = 0; feet that nobody saw do not."""
        places = skeleton.joint_transforms(motion.joint_angles, motion.root_translation)
        heights = _soles(skeleton, places)[..., 1]
        in_the_air = np.square(heights / _STANDING_M)
        return cls(heights, motion.confidence[:, _FEET] / (1.0 + in_the_air) ** 2)

    def equations(
        self, skeleton: Skeleton, angles: Float[Array, "F 24 3"], root: Float[Array, "F 3"]
    ) -> tuple[Float[Array, "F 75 75"], Float[Array, "F 75"]]:
        """Matrices and vectors, in nats, of a step from these poses to where feet stand; numbered
        as in `renderer.pose_refinement.photometry`."""
        places = skeleton.joint_transforms(angles, root)
        share = descendants(skeleton).T[_FEET]
        up = np.tile(_UP, (len(_FEET), 1, 1))
        soles = _soles(skeleton, places)
        moved = np.stack([
            pose_jacobian(sole, up, share, place, None)[:, 0]
            for sole, place in zip(soles, places, strict=True)
        ])  # fmt: skip
        sunk = self.heights - soles[..., 1]
        sunk -= (self.stands * sunk).sum() / max(self.stands.sum(), 1e-9)
        weighted = np.swapaxes(moved * self.stands[..., None], 1, 2) / _DEVIATION_M**2
        return weighted @ moved, (weighted @ sunk[..., None])[..., 0]


def _soles(skeleton: Skeleton, places: Float[Array, "F 24 4 4"]) -> Float[Array, "F 4 3"]:
    """Where heels and toes are, which lie on y = 0 at rest."""
    below = np.zeros((len(_FEET), 3))
    below[:, 1], below[:, 2] = -skeleton.rest_joints[_FEET, 1], _SOLES_M
    feet = places[:, _FEET]
    return (feet[..., :3, :3] @ below[..., None])[..., 0] + feet[..., :3, 3]
