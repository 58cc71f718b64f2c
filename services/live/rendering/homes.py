"""Homes of renderers: what the gateway asks of them, whichever that is."""

from __future__ import annotations

from typing import Protocol

from scene.errors import SceneError


class RendererGone(SceneError):
    """A renderer ended, hangs or cannot be reached; what it held is lost."""


class Renderer(Protocol):
    """One renderer: a `services.live.rendering.stage.RenderStage` somewhere. On the event loop."""

    async def start(self) -> None:
        """Returns once it is warm, for the first time or after it was lost. Raises RendererGone
        where it does not get so far."""
        ...

    async def draw(self, request: bytes) -> bytes:
        """The stage's answer, after those to what was asked before by this way. Raises
        RendererGone."""
        ...

    async def load(self, request: bytes) -> bytes:
        """The same, beside what is drawn. Raises RendererGone."""
        ...

    async def end(self) -> None:
        """End it; returns once it is gone."""
        ...


class RendererHome(Protocol):
    """Where renderers run."""

    def renderer(self) -> Renderer:
        """One more, which is not started."""
        ...

    async def close(self) -> None:
        """Let go of it, once all its renderers were ended."""
        ...
