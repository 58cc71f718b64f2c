"""Notes that a browser keeps for the server while somebody logs in: signed, each for one purpose.

They are JWTs as bearer tokens are (services.auth), by a key of their own, so that neither passes
for the other.
"""

from __future__ import annotations

from collections.abc import Callable
from datetime import datetime, timedelta

import jwt

from services.errors import LoginStale
from services.signing_keys import SigningKeys


class Tickets:
    """Writes and reads them."""

    def __init__(self, keys: SigningKeys, clock: Callable[[], datetime]) -> None:
        self._keys = keys.for_purpose(b"metanerf tickets")
        self._clock = clock

    def write(self, purpose: str, lifetime: timedelta, **notes: str) -> str:
        """A note that is good for `purpose` alone."""
        claims = {"aud": purpose, "exp": self._clock() + lifetime, "notes": notes}
        return self._keys.sign(claims)

    def read(self, purpose: str, ticket: str) -> dict[str, str]:
        """What was noted. Raises LoginStale unless it was written for `purpose` and is not over."""
        try:
            claims = self._keys.read(
                ticket,
                audience=purpose,
                options={"require": ["exp", "aud"], "verify_exp": False},
            )
        except jwt.PyJWTError as error:
            raise LoginStale(
                "the request must bring the cookie of a login that this browser began; got "
                f"{error if ticket else 'none'}; log in again"
            ) from error
        # the clock is ours, so that tests need not wait
        if float(claims["exp"]) <= self._clock().timestamp():
            raise LoginStale(
                "a login must be done within its time; got one that is over; log in again"
            )
        return claims["notes"]
