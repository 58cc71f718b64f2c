"""PersonField: the four networks together, from a world point in a pose to colour and density."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import nn

from renderer.field.networks.canonical import CanonicalField, NarrowBand
from renderer.field.networks.mlps import PoseRefiner, ResidualMotion, SkeletonMotion
from renderer.field.rendering.occupancy_grid import OccupancyGrid
from renderer.field.sizes import FieldSizes
from renderer.field.skinning.inverse_skinning import WeightVolume, rotations, skinning_transforms
from renderer.field.skinning.rest_shape import RestShape, bone_shape, rest_shape
from scene.arrays import Bool, Float, Tensor
from scene.body import Body
from scene.skeleton import Skeleton

_LIKELY_OUTSIDE_M = 0.05
"""How far above the skin a body is likely where no grid says its own reach."""


class PersonField(nn.Module):
    """One person: learnt weights and what they hang on."""

    rest_joints: Tensor
    low: Tensor
    high: Tensor

    def __init__(
        self,
        sizes: FieldSizes,
        skeleton: Skeleton,
        prior: Float[Tensor, "C D H W"],
        low: Float[Tensor, "3"],
        high: Float[Tensor, "3"],
        shell: NarrowBand | None,
    ) -> None:
        super().__init__()
        self.sizes = sizes
        self.skeleton = skeleton
        self.shell = shell
        joints = torch.from_numpy(skeleton.rest_joints).float()
        self.register_buffer("rest_joints", joints, persistent=False)
        self.register_buffer("low", low, persistent=False)
        self.register_buffer("high", high, persistent=False)
        count = len(skeleton.names)
        self.refiner = PoseRefiner(sizes.refiner, count, sizes.backend) if sizes.refiner else None
        self.motion = SkeletonMotion(sizes, prior)
        self.residual = ResidualMotion(sizes, count) if sizes.residual else None
        self.canonical = CanonicalField(sizes, low, high, shell)
        self.residual_opened: float | None = None
        """Fraction of the residual's window that is open; None: the residual is off."""
        self.occupied: OccupancyGrid | None = None
        """Where the canonical space of a trained MLP holds anything; None: not known (yet)."""

    @classmethod
    def for_body(cls, sizes: FieldSizes, body: Body) -> PersonField:
        """An untrained field over the prior knowledge of `body`."""
        outside = sizes.grid.outside_m if sizes.grid else _LIKELY_OUTSIDE_M
        if sizes.bone_prior:
            shape = bone_shape(body.skeleton, sizes.volume, outside)
        else:
            shape = rest_shape(body, sizes.volume, outside)
        return cls.for_shape(sizes, body.skeleton, shape)

    @classmethod
    def for_shape(cls, sizes: FieldSizes, skeleton: Skeleton, shape: RestShape) -> PersonField:
        """An untrained field over `shape`, its density started at the expected skin."""
        low, high = torch.from_numpy(shape.low), torch.from_numpy(shape.high)
        prior = torch.from_numpy(shape.prior)
        if sizes.grid is None:
            return cls(sizes, skeleton, prior, low, high, None)
        shell, distance = NarrowBand.around(shape, sizes.grid)
        field = cls(sizes, skeleton, prior, low, high, shell)
        field.canonical.start_from(shell, distance)
        return field

    def bake(self) -> None:
        """Keep the weight volume as it stands and drop the CNN that made it: its input never
        changes, so neither does what it makes. Nothing about motion is learnt after this."""
        with torch.no_grad():
            volume = self.motion()
        self.sizes = replace(self.sizes, latent=0)
        self.motion = SkeletonMotion(self.sizes, volume)

    def weight_volume(self) -> WeightVolume:
        """The weight volume as it stands, ready for look-ups."""
        return WeightVolume.of(self.motion(), self.low, self.high)

    def transforms(
        self,
        joint_angles: Float[Tensor, "K 3"],
        root_translation: Float[Tensor, "3"],
        *,
        refine: bool,
    ) -> Float[Tensor, "K 3 4"]:
        """M_i (rest -> world), with the refiner's corrections where asked and present.

        Corrections belong to the estimates the refiner was trained on; live poses come without.
        """
        local = rotations(joint_angles)
        if refine and self.refiner is not None:
            local = local @ rotations(self.refiner(joint_angles[None])[0])
        return skinning_transforms(local, root_translation, self.rest_joints, self.skeleton.parents)

    def moved(
        self, canonical: Float[Tensor, "N 3"], joint_angles: Float[Tensor, "K 3"]
    ) -> Float[Tensor, "N 3"]:
        """Skeleton-canonical points after the residual motion, where that is on."""
        if self.residual is None or self.residual_opened is None:
            return canonical
        return canonical + self.residual(canonical, joint_angles, self.residual_opened)

    def occupied_at(self, canonical: Float[Tensor, "N 3"]) -> Bool[Tensor, "N"] | None:
        """Whether anything is at canonical points (after residual motion); None: not known."""
        return None if self.occupied is None else self.occupied.holds(canonical)
