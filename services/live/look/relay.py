"""Where one performer's encoded pictures go on to, beside the server's own decoder."""

from __future__ import annotations

from typing import Protocol

from renderer.performer_model import PerformerModel
from services.live.look.picture import AlignedPose


class LookRelay(Protocol):
    """Passes one performer's pictures on to the pages that draw them. On the event loop."""

    def pass_frame(self, number: int, data: bytes) -> bool:
        """Pass an encoded frame on; its number counts up. Says whether a key frame is needed."""
        ...

    def drawn_model(self) -> PerformerModel | None:
        """The model that pages draw who have frames; None where no page does."""
        ...

    def pass_pose(self, number: int, aligned: AlignedPose) -> None:
        """Pass on where they were in the frame of this number."""
        ...

    def end(self) -> None:
        """Have every page show the model as it was trained, at once. May be called repeatedly."""
        ...


class NoRelay(LookRelay):
    """Passes nothing on."""

    def pass_frame(self, number: int, data: bytes) -> bool:
        """False."""
        return False

    def drawn_model(self) -> PerformerModel | None:
        """None."""
        return None

    def pass_pose(self, number: int, aligned: AlignedPose) -> None:
        """Nothing."""

    def end(self) -> None:
        """Nothing."""
