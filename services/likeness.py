"""What a person's likeness may be used for: nothing beyond what they have consented to.

The consent is on the person's row (`db.person_rows`) and is asked at each use, so that revoking it,
or its end, needs no other row changed: what is shown, driven or recorded meanwhile stops with the
next look at the rows (`services.control.hub`).
"""

from __future__ import annotations

from collections.abc import Collection
from datetime import datetime, timedelta
from typing import Any

from db.models import (
    ConsentState,
    PersonRow,
    Purpose,
    RecordingChunkRow,
    RecordingExportRow,
)
from db.repositories import UnitOfWork
from scene.errors import InvalidInput
from services.auth import GUEST, is_guest
from services.errors import NoConsent

_LONGEST = timedelta(days=36_525)


def give_consent(
    person: PersonRow, purposes: Collection[Purpose], until: datetime | None, now: datetime
) -> None:
    """Have a person consent to `purposes`, until a moment or without an end, instead of before.

    Raises InvalidInput where the end is not in the next hundred years.
    """
    if until is not None and not now < until <= now + _LONGEST:
        raise InvalidInput(
            f"until must be in the next hundred years; got {until.isoformat()}; give a later day, "
            "or revoke the consent"
        )
    person.consent_purposes = [one.value for one in Purpose if one in purposes]
    person.consent_until, person.consent_revoked_at = until, None


def consent_details(person: PersonRow) -> dict[str, Any]:
    """What a person consents to, as the audit log keeps it."""
    until = person.consent_until
    purposes = list(person.consent_purposes)
    return {"purposes": purposes, "until": until.isoformat() if until else None}


def require_consent(person: PersonRow, purpose: Purpose, now: datetime) -> None:
    """Raise NoConsent unless a person's consent covers `purpose` at `now`."""
    if person.consents_to(purpose, now):
        return
    raise NoConsent(
        f"the person must consent to {purpose}; got {person.name}, whose consent "
        f"{_what_of_it(person, now)}; whoever made them can give it again under Your consent "
        "on the page, or by PUT /v1/people/{id}/consent"
    )


def may_drive(account: str | None, owner: str, *, lent: bool) -> bool:
    """Whether `account` may drive a person of `owner`: their own, or one who is `lent` to whoever
    is in the meeting; those of the demo are for guests alone."""
    if not account:
        return False
    return account == owner or (lent and (owner != GUEST or is_guest(account)))


def shown_chunks(
    unit: UnitOfWork, recording_id: str, now: datetime, track: str | None = None
) -> list[RecordingChunkRow]:
    """The chunks of a recording, or of one of its tracks, by track and number; without those of
    people whose consent does not cover recordings at `now`."""
    withheld = {
        person.id
        for person in unit.recordings.people(recording_id)
        if not person.consents_to(Purpose.RECORDINGS, now)
    }
    chunks = unit.recordings.chunks(recording_id, track)
    return [chunk for chunk in chunks if chunk.person_id not in withheld]


def require_consents(unit: UnitOfWork, video: RecordingExportRow, now: datetime) -> None:
    """Raise NoConsent unless everybody whom a video shows consents to recordings at `now`: nobody
    can be taken out of it."""
    for person in unit.recordings.people(video.recording_id):
        if video.shows is None or person.id in video.shows:
            require_consent(person, Purpose.RECORDINGS, now)


def _what_of_it(person: PersonRow, now: datetime) -> str:
    match person.consent_state(now):
        case ConsentState.REVOKED:
            return f"was revoked at {person.consent_revoked_at:%Y-%m-%d %H:%M} UTC"
        case ConsentState.ENDED:
            return f"ended at {person.consent_until:%Y-%m-%d %H:%M} UTC"
        case ConsentState.GIVEN:
            return f"is for {', '.join(person.consent_purposes) or 'nothing'}"
