"""What travels as JSON of a picture to render."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from scene.expression import EXPRESSION_COUNT
from services.api.shapes import Body


class Orbit(Body):
    """A camera on a sphere round the person."""

    azimuth_deg: float = Field(
        default=0.0,
        allow_inf_nan=False,
        description="0: in front of how they mostly face; 90: their left.",
    )
    elevation_deg: float = Field(default=5.0, gt=-90.0, lt=90.0)
    distance_m: float | None = Field(
        default=None, gt=0.1, le=100.0, description="Empty: so far that the whole person fits."
    )


class ViewCamera(Body):
    """Where to look from: an orbit, or a pinhole camera by its matrices (OpenCV axes)."""

    orbit: Orbit | None = None
    fov_deg: float = Field(default=35.0, gt=1.0, lt=170.0, description="Vertical field of view.")
    intrinsics: list[list[float]] | None = Field(default=None, description="3 x 3, px.")
    world_to_camera: list[list[float]] | None = Field(default=None, description="3 x 4, m.")


Share = Annotated[float, Field(ge=0.0, le=1.0)]


class ViewPose(Body):
    """A pose of one's own."""

    joint_angles: list[list[float]] = Field(description="24 x 3, axis-angle, rad.")
    root_translation: list[float] = Field(default_factory=lambda: [0.0, 0.0, 0.0], description="m")
    expression: list[Share] = Field(default=[0.0] * EXPRESSION_COUNT, description="Face, hands.")


class NewView(Body):
    """A picture to render."""

    camera: ViewCamera = Field(default_factory=lambda: ViewCamera(orbit=Orbit()))
    width: int = Field(default=512, ge=16, le=4096)
    height: int = Field(default=512, ge=16, le=4096)
    time_s: float | None = Field(
        default=None, allow_inf_nan=False, description="Moment of the motion; empty: its start."
    )
    pose: ViewPose | None = None
    motion_sequence_id: str | None = Field(
        default=None, description="Whose motion to follow; empty: the model's own."
    )
    background: tuple[Share, Share, Share] | None = Field(
        default=None, description="sRGB; empty: transparent, white in a JPEG."
    )
    hide_unseen: bool = Field(
        default=True,
        description="Parts of the body that were never filmed, as legs under a desk, fade out; "
        "else they are shown as they are guessed.",
    )
    shows: Literal["colour", "depth", "normal"] = Field(
        default="colour",
        description="What pixels tell: colour; depth along the camera's axis, 16 bits, mm, 0 where "
        "nobody is; or the surface's normal, xyz from -1 to 1 in the world's axes as 8 bits.",
    )
    format: Literal["png", "jpeg", "webp"] = "png"
