"""Settings of networks that others made: their files, or where they are fetched."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from pydantic import Field

from services.setting_groups import Group

if TYPE_CHECKING:
    from capture.detection.network_files import LandmarkNetwork, NetworkSource


class NetworkSettings(Group):
    """Networks of others that captures and evaluations need."""

    pose_model: Path | None = Field(
        default=None,
        validation_alias="METANERF_POSE_MODEL",
        description="The landmark model's file; fetched once where none is named.",
    )
    face_model: Path | None = Field(
        default=None,
        validation_alias="METANERF_FACE_MODEL",
        description="The face landmarker's, for expressions.",
    )
    hand_model: Path | None = Field(
        default=None,
        validation_alias="METANERF_HAND_MODEL",
        description="The hand landmarker's, for expressions.",
    )
    lpips_backbone: Path | None = Field(
        default=None,
        validation_alias="METANERF_LPIPS_BACKBONE",
        description="Weights (.pth) behind LPIPS; VGG-16 is fetched once where none are named.",
    )
    lpips_backbone_url: str | None = Field(
        default=None,
        validation_alias="METANERF_LPIPS_BACKBONE_URL",
        description="Where to fetch VGG-16.",
    )

    def source(self, network: LandmarkNetwork, cache_dir: Path) -> NetworkSource:
        """Where a landmark network is found."""
        from capture.detection.network_files import NetworkSource

        return NetworkSource(getattr(self, f"{network.name}_model"), cache_dir, network)
