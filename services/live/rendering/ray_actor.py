"""What a Ray actor does for a gateway: it is a renderer. This module does not import Ray."""

from __future__ import annotations

import os


class RendererActor:
    """A stage in a process of its own on a node; warm once it was made."""

    def __init__(self, threads: int) -> None:
        """It draws by so many threads."""
        os.environ.setdefault("NUMBA_NUM_THREADS", str(threads))  # before numba is there
        from renderer.scene_renderer import warm_up
        from services.live.rendering.stage import RenderStage

        warm_up()
        self._stage = RenderStage()

    def answer(self, request: bytes) -> bytes:
        """The stage's."""
        return self._stage.answer(request)
