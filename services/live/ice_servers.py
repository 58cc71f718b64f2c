"""ICE servers (RFC 8445) for browsers: STUN as it is set, TURN with credentials of its own.

TURN credentials are made of a secret that only the gateway and the TURN server know, so that there
are no accounts and what one browser is given ends by itself (coturn's `use-auth-secret`,
draft-uberti-behave-turn-rest): the username is `expiry:id`, the password the username's HMAC.

The gateway's own connections need no relay: a browser's relay reaches them, and two relays in a row
would only cost time. They use STUN where it is set, from which the relay learns of the gateway's
public address.
"""

from __future__ import annotations

import base64
import hashlib
import hmac
from dataclasses import dataclass, field
from datetime import datetime

from services.live_settings import LiveSettings
from services.seats import TOKEN_LIFETIME


@dataclass(frozen=True)
class IceServer:
    """An entry of `RTCConfiguration.iceServers`."""

    urls: list[str]
    username: str = ""
    credential: str = field(default="", repr=False)


def ice_servers(settings: LiveSettings, holder: str, now: datetime) -> list[IceServer]:
    """What a browser is given; `holder` names it in the TURN server's log."""
    servers = [IceServer([url]) for url in settings.ice_servers]
    if settings.turn_secret is not None:
        # as long as the seat's token: a page asks once and connects again and again
        expiry = int((now + TOKEN_LIFETIME).timestamp())
        username = f"{expiry}:{holder}"
        secret = settings.turn_secret.get_secret_value()
        digest = hmac.digest(secret.encode(), username.encode(), hashlib.sha1)
        password = base64.b64encode(digest).decode()
        servers.append(IceServer(settings.turn_urls, username, password))
    return servers
