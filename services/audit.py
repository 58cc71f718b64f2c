"""The audit log: who did what, when. Nothing of it names a person's face, a link or an address.

| action | when |
| --- | --- |
| `account.logged_in` | somebody took a token after logging in by the provider |
| `access.refused` | a token was not good, or not for what was asked, on any way in; some a minute |
| `person.added`, `person.erased`, `consent.given`, `consent.revoked` | |
| `sequence.uploaded`, `sequence.kept`, `sequence.deleted` | a clip, also one whose time was over |
| `recording.exported`, `recording.left`, `recording.deleted` | a video was asked for, and so on |
| `meeting.invitation_renewed`, `meeting.host_changed` | |
| `meeting.member_removed`, `meeting.ended` | |

A meeting is named by its digest, as in logs: its id is its invitation.
"""

from __future__ import annotations

from typing import Any

from db.models import AuditEventRow
from db.repositories import UnitOfWork
from services.container import Services
from services.errors import TooManyRequests
from services.logs import meeting_digest

KEEPER = ""
"""The account of what the server does by itself."""


def note(
    services: Services,
    unit: UnitOfWork,
    account: str,
    action: str,
    person_id: str | None = None,
    **details: Any,
) -> None:
    """Have an event stored as the transaction commits. One about a person goes with them."""
    unit.audit.add(
        AuditEventRow(
            person_id=person_id,
            at=services.clock(),
            account=account,
            action=action,
            details=details,
        )
    )


def note_of_meeting(
    services: Services, unit: UnitOfWork, account: str, what: str, meeting_id: str, **details: Any
) -> None:
    """The same of something that was done to a meeting."""
    digest = meeting_digest(meeting_id)
    note(services, unit, account, f"meeting.{what}", meeting=digest, **details)


def note_refusal(
    services: Services, caller: str, account: str, route: str, error: Exception
) -> None:
    """Store that something was refused; where one caller is refused often, not each time.

    Args: caller: who is told apart from others, by account or address, and is not stored. route: a
        pattern, without ids.
    """
    try:
        services.refusal_limit.take(caller)
    except TooManyRequests:
        return
    with services.unit_of_work() as unit:
        note(services, unit, account, "access.refused", route=route, error=type(error).__name__)
        unit.commit()
