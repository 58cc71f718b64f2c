"""Seats in meetings: taken by joining, renewed by watching or talking, released by leaving.

A seat is a row, so that every gateway counts the same. Whoever joins has `SEAT_LAPSES_S` to open a
view or the control channel (services.control). A view renews its seat every `BEAT_S`, and releases
it when it ends unless the control channel holds it: then the seat outlives a reload of the
page. What a dead gateway or a guest who never came leaves behind lapses, and the next to join finds
it free. Where the meeting has its lobby on, a seat opens nothing until the host has let its owner
in.
"""

from __future__ import annotations

from datetime import datetime, timedelta
from itertools import count

from db.meeting_rows import SEAT_LAPSES_S
from db.models import Admission, BanRow, MeetingRow, ParticipantRow, Role, new_id
from db.repositories import UnitOfWork
from services.auth import GUEST, INVITED, Principal
from services.container import Services
from services.errors import (
    AdmissionDenied,
    AdmissionEnded,
    AwaitingAdmission,
    InvitationRenewed,
    MeetingOver,
    NoSeatFree,
    NotHost,
    NotTakingPart,
    RemovedFromMeeting,
    SeatReleased,
)

MOST_SEATS = 100
"""Viewers of one meeting, of all gateways."""
BEAT_S = 10.0
_RETRY_AFTER_S = 15
TOKEN_LIFETIME = timedelta(hours=12)
_REFUSALS = {
    Admission.WAITING: (
        AwaitingAdmission,
        "one who waits for the host",
        "wait until you are let in",
    ),
    Admission.DENIED: (AdmissionDenied, "one whom the host has not let in", "ask the host"),
    Admission.REMOVED: (RemovedFromMeeting, "one whom the host has sent out", "ask the host"),
    Admission.ENDED: (AdmissionEnded, "one of a meeting that is over", "open another meeting"),
}


def take_seat(
    services: Services, unit: UnitOfWork, meeting: MeetingRow, caller: Principal, display_name: str
) -> tuple[ParticipantRow, str]:
    """The first free seat of a meeting that is locked for it, and the token that opens its view.

    The same token takes the seat up again after a reload or an outage. Raises
    RemovedFromMeeting, InvitationRenewed, MeetingOver, and NoSeatFree when every seat is taken.
    """
    require_open(meeting)
    require_invited(meeting, caller)
    now = services.clock()
    lapsed = now - timedelta(seconds=SEAT_LAPSES_S)
    for gone in [one for one in meeting.participants if one.seen_at < lapsed]:
        meeting.participants.remove(gone)
    unit.flush()
    taken = {one.seat for one in meeting.participants}
    if len(taken) >= MOST_SEATS:
        raise NoSeatFree(
            f"a meeting must have at most {MOST_SEATS} viewers; got one more; try again when "
            "somebody has left",
            _RETRY_AFTER_S,
        )
    role = _role_for(meeting, caller)
    let_in = not meeting.lobby or (role is Role.HOST and not _has_host(meeting))
    participant = ParticipantRow(
        id=new_id(),
        account=caller.account,
        display_name=display_name,
        seat=next(seat for seat in count(1) if seat not in taken),
        joined_at=now,
        seen_at=now,
        # who may host becomes the host on connecting (services.control), where there is none
        role=Role.SPEAKER if role is Role.HOST else role,
        admission=Admission.ADMITTED if let_in else Admission.WAITING,
    )
    meeting.participants.append(participant)
    token, _ = services.tokens.issue(
        caller.account,
        frozenset({"join"}),
        TOKEN_LIFETIME,
        meeting.id,
        participant.id,
        role,
        meeting.invitation,
    )
    return participant, token


def ban(meeting: MeetingRow, sent_out: ParticipantRow, now: datetime) -> None:
    """Let the account of whoever is sent out not come back.

    Where an account is of many, as that of an invitation is, only the lobby keeps one of them out.
    """
    account = sent_out.account
    known = {one.account for one in meeting.bans} | {"", GUEST, INVITED, meeting.account}
    if account not in known:
        meeting.bans.append(BanRow(account=account, at=now))


def _has_host(meeting: MeetingRow) -> bool:
    return any(
        one.role is Role.HOST and one.admission is Admission.ADMITTED
        for one in meeting.participants
    )


def _role_for(meeting: MeetingRow, caller: Principal) -> Role:
    """What somebody may be: whoever opened the meeting may host it.

    The demo's meeting belongs to whichever guest comes first; the account that guests once shared
    opens nothing else for one of them rather than another. A seat's own token grants no second seat
    more than any invitation does: its owner may have been sent out.
    """
    if caller.role is Role.VIEWER:
        return Role.VIEWER
    invited = caller.participant_id is None
    if invited and caller.role is not None:
        return caller.role
    shared = caller.account == GUEST and meeting.label is None
    owns = invited and caller.meeting_id is None and caller.may_use(meeting.account)
    return Role.HOST if owns and not shared else Role.SPEAKER


def require_invited(meeting: MeetingRow, caller: Principal) -> None:
    """Raise RemovedFromMeeting, or InvitationRenewed, unless `caller` may come to this meeting.

    Its id is its invitation until that is renewed; from then on, whoever is not in it and has not
    opened it must have come by the newest.
    """
    require_not_removed(meeting, caller)
    opened = caller.participant_id is None and caller.may_use(meeting.account)
    inside = any(
        one.id == caller.participant_id and one.admission is Admission.ADMITTED
        for one in meeting.participants
    )
    if not (opened or inside or caller.invitation == meeting.invitation):
        raise InvitationRenewed(
            "whoever comes must bring the newest invitation; got an older one; ask the host",
        )


def require_not_removed(meeting: MeetingRow, caller: Principal) -> None:
    """Raise RemovedFromMeeting for somebody whom the host has sent out."""
    if any(ban.account == caller.account for ban in meeting.bans):
        raise RemovedFromMeeting(
            "whoever comes must not have been sent out; got somebody who was; ask the host",
        )


def require_taking_part(meeting: MeetingRow, caller: Principal, now: datetime) -> None:
    """Raise RemovedFromMeeting, MeetingOver or NotTakingPart unless the caller opened the meeting,
    or their account has a seat in it and may be seen and heard."""
    require_open(meeting)
    require_not_removed(meeting, caller)
    if caller.may_use(meeting.account):
        return
    if caller.account in {GUEST, INVITED} or caller.account not in meeting.accounts_at(now):
        raise NotTakingPart(
            "whoever brings somebody must sit in the meeting with the account that owns them, let "
            "in and as more than a viewer; got one who does not; join the meeting first",
        )


def require_host(meeting: MeetingRow, caller: Principal) -> None:
    """Raise NotHost unless the caller sits as its host, or opened the meeting."""
    if caller.participant_id is None:
        caller.require_account(meeting.account)
        may = "write" in caller.scopes
    else:
        may = any(
            one.id == caller.participant_id
            and one.role is Role.HOST
            and one.admission is Admission.ADMITTED
            for one in meeting.participants
        )
    if not may:
        raise NotHost(
            "the token must be of the meeting's host; got one of somebody else; ask the host",
        )


def require_open(meeting: MeetingRow) -> None:
    """Raise MeetingOver for a meeting that was ended."""
    if meeting.ended_at is not None:
        raise MeetingOver(
            f"a meeting must not be over; got one that was ended at {meeting.ended_at:%H:%M} UTC; "
            "open another",
        )


def renew_seats(services: Services, participant_ids: set[str]) -> set[str]:
    """Note that these seats are in use; returns those that have not been released."""
    with services.unit_of_work() as unit:
        kept = unit.meetings.seen(participant_ids, services.clock())
        unit.commit()
    return kept


def take_up(services: Services, participant_id: str) -> None:
    """Note that a seat is in use from now on. Raises SeatReleased where it was given back."""
    if not renew_seats(services, {participant_id}):
        raise _released()


def require_admitted(meeting: MeetingRow, caller: Principal) -> None:
    """Raise MeetingOver, or a Forbidden, unless `caller` may see and hear this meeting now.

    A caller without a seat, such as a foreign viewer, is let in only where nobody has to wait and
    the invitation was never renewed.
    """
    require_open(meeting)
    if caller.participant_id is None:
        require_invited(meeting, caller)
        if not admits_without_seat(meeting):
            raise AwaitingAdmission(
                "the token must be of somebody whom the host has let in; got one without a seat; "
                "join the meeting and wait",
            )
        return
    found = next((one for one in meeting.participants if one.id == caller.participant_id), None)
    if found is None:
        raise _released()
    if found.admission is not Admission.ADMITTED:
        refused, got, mend = _REFUSALS[found.admission]
        raise refused(f"the token must be of somebody let in; got {got}; {mend}")


def _released() -> SeatReleased:
    return SeatReleased(
        "the token must be of a seat that is taken; got one whose seat was given back; "
        "join the meeting again",
    )


def admits_without_seat(meeting: MeetingRow) -> bool:
    """Whether a viewer without a seat may look on."""
    return not meeting.lobby and meeting.invitation == 0 and meeting.ended_at is None


def release_seats(services: Services, participant_ids: set[str]) -> None:
    """Release these seats, but for those that somebody may come back to (services.control)."""
    lapsed = services.clock() - timedelta(seconds=SEAT_LAPSES_S)
    with services.unit_of_work() as unit:
        unit.meetings.drop_participants(participant_ids, unless_heard_since=lapsed)
        unit.commit()
