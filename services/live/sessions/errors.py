"""Why a WebRTC connection was not opened."""

from __future__ import annotations

from scene.errors import SceneError


class OfferRefused(SceneError):
    """The SDP offer can't be answered."""


class ServerFull(SceneError):
    """This server has as many connections of a kind as it may."""
