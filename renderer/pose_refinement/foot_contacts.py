"""Foot contacts: standing feet keep one height while poses are refined.

Pixels determine depth worst, and with it height under a camera that looks down: refined by pixels
alone, standing people bob by centimetres. The floor is at y = 0, so heels and toes there are in
contact, and move up or down only together: longer legs lower the whole floor.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from renderer.pose_refinement.photometry import descendants, pose_jacobian
from scene.arrays import Array, Float
from scene.motion import Motion
from scene.skeleton import FOOT_JOINTS, Skeleton

_FEET = list(FOOT_JOINTS)
_SOLE_OFFSETS_M = np.array([-0.05, 0.05, -0.05, 0.05])
"""Offsets of the sole's points from their joints along z: heels behind ankles, toes before
balls."""
_CONTACT_M = 0.03
"""Height at which the contact weight is a quarter."""
DEVIATION_M = 0.01
"""Deviation of the height of a contact."""
_UP = np.array([[0.0, 1.0, 0.0]])


@dataclass(frozen=True, eq=False)
class FootContacts:
    """Heights of heels and toes in all frames, and their contact weights."""

    heights: Float[Array, "F 4"]
    """m, as estimated."""
    contact: Float[Array, "F 4"]
    """0 to 1."""

    @classmethod
    def of(cls, skeleton: Skeleton, motion: Motion) -> FootContacts:
        """Contacts of `motion` with y = 0; none of invisible feet."""
        transforms = skeleton.joint_transforms(motion.joint_angles, motion.root_translation)
        heights = sole_positions(skeleton, transforms)[..., 1]
        squared = np.square(heights / _CONTACT_M)
        return cls(heights, motion.confidence[:, _FEET] / (1.0 + squared) ** 2)

    def equations(
        self, skeleton: Skeleton, angles: Float[Array, "F 24 3"], root: Float[Array, "F 3"]
    ) -> tuple[Float[Array, "F 75 75"], Float[Array, "F 75"]]:
        """Normal equations, in nats, of a step that restores the contacts; parameters
        as in `renderer.pose_refinement.photometry`."""
        transforms = skeleton.joint_transforms(angles, root)
        share = descendants(skeleton).T[_FEET]
        up = np.tile(_UP, (len(_FEET), 1))
        soles = sole_positions(skeleton, transforms)
        jacobian = np.stack(
            [
                pose_jacobian(sole, up, share, place)
                for sole, place in zip(soles, transforms, strict=True)
            ]
        )
        height_error = self.heights - soles[..., 1]
        height_error -= (self.contact * height_error).sum() / max(self.contact.sum(), 1e-9)
        weighted = np.swapaxes(jacobian * self.contact[..., None], 1, 2) / DEVIATION_M**2
        return weighted @ jacobian, (weighted @ height_error[..., None])[..., 0]


def sole_positions(
    skeleton: Skeleton, transforms: Float[Array, "F 24 4 4"]
) -> Float[Array, "F 4 3"]:
    """Positions of heels and toes, which lie on y = 0 at rest."""
    offsets = np.zeros((len(_FEET), 3))
    offsets[:, 1], offsets[:, 2] = -skeleton.rest_joints[_FEET, 1], _SOLE_OFFSETS_M
    feet = transforms[:, _FEET]
    return (feet[..., :3, :3] @ offsets[..., None])[..., 0] + feet[..., :3, 3]
