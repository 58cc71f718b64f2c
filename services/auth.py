"""Bearer tokens (RFC 6750) as signed JWTs (services.signing_keys), with scopes.

`read` looks, `write` changes, `join` enters meetings; a token with a `meeting` enters only that,
and says as what: host, speaker or viewer.
An account (the token's subject) sees its own people, models and meetings and nobody else's. Each
guest of an open server has an account of their own, which their browser keeps with its token; all
of them may meet the demo's performer. A token from before, of the account that guests shared,
works until it ends.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime, timedelta

import jwt

from db.models import Role, new_id
from services.errors import NotOwner, OtherMeeting, Unauthorized
from services.signing_keys import SigningKeys

_ISSUER = "metanerf"
ALL_SCOPES = frozenset({"read", "write", "join"})
GUEST = "guest"
"""The account of the demo's own performer and meeting, which every guest may use."""
INVITED = "invited"
"""The account of everybody who comes by an invitation's token."""
_GUEST_PREFIX = "guest-"
_RENEWABLE = timedelta(days=90)
"""A guest's token that ended so long ago still says who they are."""


def new_guest() -> str:
    """The account of one more guest."""
    return _GUEST_PREFIX + new_id()


def is_guest(account: str) -> bool:
    """Whether an account is that of one guest."""
    return account.startswith(_GUEST_PREFIX)


@dataclass(frozen=True)
class Principal:
    """Who calls, and what they may do."""

    account: str
    scopes: frozenset[str]
    meeting_id: str | None = None
    """The only meeting this token opens, if it is bound to one."""
    participant_id: str | None = None
    """The seat in that meeting which it was given with, if it was given with one."""
    role: Role | None = None
    """What it may be in that meeting. Its host may have changed that since: the row decides."""
    invitation: int = 0
    """Which of that meeting's invitations it came by; see `db.models.MeetingRow.invitation`."""

    @property
    def counted_as(self) -> str:
        """By what bounds tell them from others: an invitation's account is of many, who are told
        apart by their seats."""
        return self.account if self.account != INVITED else self.participant_id or INVITED

    def may_use(self, account: str) -> bool:
        """Whether what `account` owns may be met: one's own, and the demo's for guests."""
        return account == self.account or (account == GUEST and is_guest(self.account))

    def require_use(self, account: str) -> None:
        """Raise NotOwner unless this caller may use what `account` owns."""
        if not self.may_use(account):
            self.require_account(account)

    def require_account(self, account: str) -> None:
        """Raise NotOwner unless what `account` owns is this caller's."""
        if account != self.account:
            raise NotOwner(
                f"the token must be of the account that owns this; got one of {self.account!r}; "
                "use the token it was made with",
            )

    def require_meeting(self, meeting_id: str) -> None:
        """Raise OtherMeeting where this token opens another meeting only."""
        if self.meeting_id is not None and self.meeting_id != meeting_id:
            raise OtherMeeting(
                f"the token must be for meeting {meeting_id!r}; got one for "
                f"{self.meeting_id!r}; join this meeting first",
            )


class Tokens:
    """Issues and reads tokens."""

    def __init__(self, keys: SigningKeys, clock: Callable[[], datetime]) -> None:
        self._keys, self._clock = keys, clock

    def issue(
        self,
        account: str,
        scopes: frozenset[str],
        lifetime: timedelta,
        meeting_id: str | None = None,
        participant_id: str | None = None,
        role: Role | None = None,
        invitation: int = 0,
    ) -> tuple[str, datetime]:
        """A token and when it ends."""
        now = self._clock()
        expires = now + lifetime
        claims: dict[str, object] = {
            "iss": _ISSUER,
            "sub": account,
            "iat": now,
            "exp": expires,
            "scope": " ".join(sorted(scopes)),
        }
        if meeting_id is not None:
            claims["meeting"] = meeting_id
        if participant_id is not None:
            claims["participant"] = participant_id
        if role is not None:
            claims["role"] = role.value
        if invitation:
            claims["invitation"] = invitation
        return self._keys.sign(claims), expires

    def guest_of(self, token: str) -> str | None:
        """The guest whose token this is, or lately was; None for anything else."""
        try:
            caller = self._read(token, self._clock() - _RENEWABLE)
        except Unauthorized:
            return None
        whole = caller.meeting_id is None and is_guest(caller.account)
        return caller.account if whole else None

    def read(self, token: str) -> Principal:
        """Whose token it is. Raises Unauthorized unless it is one of ours and still good."""
        return self._read(token, self._clock())

    def _read(self, token: str, good_at: datetime) -> Principal:
        try:
            claims = self._keys.read(
                token,
                issuer=_ISSUER,
                options={
                    "require": ["sub", "exp", "scope"],
                    "verify_exp": False,
                    "verify_iat": False,
                },
            )
        except jwt.PyJWTError as error:
            raise Unauthorized(f"the token must be signed by this server; got: {error}") from error
        # the clock is ours, so that tests need not wait
        if float(claims["exp"]) <= good_at.timestamp():
            raise Unauthorized("the token must not be over; got one that is; get a new one")
        return Principal(
            str(claims["sub"]),
            frozenset(str(claims["scope"]).split()),
            claims.get("meeting"),
            claims.get("participant"),
            Role(claims["role"]) if "role" in claims else None,
            int(claims.get("invitation", 0)),
        )
