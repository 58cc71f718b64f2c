"""The secrets that sign tokens and tickets: one signs, others are taken beside it.

So a secret can be replaced without anybody being thrown out: what the previous one signed holds
until that is forgotten, and gateways that are replaced one after the other know each other's. What
is signed names its key by a digest of it (`kid`, RFC 7515); what was signed before keys had names
is tried with each.
"""

from __future__ import annotations

import hashlib
import hmac
from collections.abc import Iterable
from typing import Any

import jwt

_ALGORITHM = "HS256"
_KEY_ID_DIGITS = 8


class SigningKeys:
    """Signs and reads JWTs (RFC 7519, HS256)."""

    def __init__(self, current: str | bytes, others: Iterable[str | bytes] = ()) -> None:
        """`current` signs; `others` are the previous ones, and the next."""
        keys = [one.encode() if isinstance(one, str) else one for one in (current, *others)]
        self._current = keys[0]
        self._by_id = {_key_id(key): key for key in keys}

    def for_purpose(self, purpose: bytes) -> SigningKeys:
        """Keys made of these, of which neither passes for the other."""
        made = [hmac.digest(key, purpose, hashlib.sha256) for key in self._by_id.values()]
        return SigningKeys(made[0], made[1:])

    def sign(self, claims: dict[str, Any]) -> str:
        """A JWT of `claims`."""
        headers = {"kid": _key_id(self._current)}
        return jwt.encode(claims, self._current, _ALGORITHM, headers=headers)

    def read(self, token: str, **how: Any) -> dict[str, Any]:
        """Its claims, checked as `how` says to `jwt.decode`. Raises jwt.PyJWTError."""
        key_id = jwt.get_unverified_header(token).get("kid")
        keys = list(self._by_id.values()) if key_id is None else [self._by_id.get(key_id)]
        for key in keys[:-1]:
            try:
                return _read(token, key, how)
            except jwt.InvalidSignatureError:
                continue
        return _read(token, keys[-1], how)


def _read(token: str, key: bytes | None, how: dict[str, Any]) -> dict[str, Any]:
    if key is None:
        raise jwt.InvalidSignatureError("a key that is not, or no longer, this server's")
    return jwt.decode(token, key, [_ALGORITHM], **how)


def _key_id(key: bytes) -> str:
    return hashlib.sha256(b"metanerf key id " + key).hexdigest()[:_KEY_ID_DIGITS]
