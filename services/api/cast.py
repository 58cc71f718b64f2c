"""Tells live sessions of this process that the performers of a meeting have changed."""

from __future__ import annotations

from collections.abc import Awaitable, Callable

from fastapi import Request

CastListener = Callable[[str], Awaitable[None]]
"""Told the id of a meeting whose performers have changed; listed in `app.state.cast_listeners`."""


async def tell_cast_changed(request: Request, meeting_id: str) -> None:
    """Tell every listener of the application that answers `request`."""
    listeners: list[CastListener] = request.app.state.cast_listeners
    for listener in listeners:
        await listener(meeting_id)
