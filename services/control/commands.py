"""What people in a meeting may ask for, done on its rows; a refusal is an error that says why."""

from __future__ import annotations

from datetime import datetime, timedelta

from db.errors import NotFound
from db.models import (
    Admission,
    MeetingRow,
    MessageKind,
    MessageRow,
    ParticipantRow,
    Role,
)
from db.repositories import UnitOfWork
from services import meetings, seats
from services.audit import note_of_meeting
from services.auth import Principal
from services.container import Services
from services.control.messages import (
    Admit,
    Agree,
    Caption,
    Command,
    Deny,
    EndMeeting,
    Hello,
    Hosting,
    Leave,
    LetPresent,
    Microphone,
    Mute,
    Network,
    Present,
    RaiseHand,
    React,
    RecordMeeting,
    Remove,
    Say,
    SetLobby,
    SetRole,
    Speech,
)
from services.control.roster import host_of, performers_by_participant, presenter_of
from services.errors import (
    AwaitingAdmission,
    HostCommand,
    MeetingSealed,
    NoSeat,
    SeatReleased,
    TargetIsHost,
    Unauthorized,
    ViewerMayNotSpeak,
)
from services.recording import consent

_PASSING_LASTS_S = 60.0
"""Reactions and captions are sent at once; their rows are deleted after this long."""


def read_caller(services: Services, meeting_id: str, hello: Hello) -> Principal:
    """The principal whose seat a page takes.

    Raises Unauthorized, OtherMeeting or NoSeat for a token of no seat in it.
    """
    caller = services.tokens.read(hello.token)
    caller.require_meeting(meeting_id)
    if "join" not in caller.scopes or caller.participant_id is None:
        raise NoSeat(
            "the token must be one that joining gave; got one without a seat; join the meeting",
        )
    return caller


def account_of(services: Services, hello: Hello) -> str:
    """The account whose token a page brings; empty for one that is not good."""
    try:
        return services.tokens.read(hello.token).account
    except Unauthorized:
        return ""


def connect(services: Services, meeting_id: str, caller: Principal, name: str) -> ParticipantRow:
    """Take up a seat, at first or again.

    Whoever may host is the host from now on where nobody else is. Raises SeatReleased
    where the seat is no longer theirs.
    """
    assert caller.participant_id is not None
    now = services.clock()
    with services.unit_of_work() as unit:
        meeting = unit.meetings.get_for_change(meeting_id)
        me = _find(meeting, caller.participant_id)
        me.display_name = name
        me.heard_at = me.seen_at = now
        # a page that comes, or comes again, says itself when it wants to be heard
        me.microphone = False
        let_in = me.admission in (Admission.ADMITTED, Admission.WAITING)
        if caller.role is Role.HOST and let_in and not host_of(meeting, now):
            me.role, me.admission = Role.HOST, Admission.ADMITTED
            note_of_meeting(services, unit, me.account, "host_changed", meeting_id, to=me.account)
        unit.commit()
    return me


def execute(services: Services, meeting_id: str, participant_id: str, command: Command) -> None:
    """Do what a participant asks for. Raises a ServiceError, or NotFound, that says why not."""
    with services.unit_of_work() as unit:
        meeting = unit.meetings.get_for_change(meeting_id)
        me = _find(meeting, participant_id)
        if isinstance(command, Leave):
            meeting.participants.remove(me)
            meetings.take_along(meeting, me.account, services.clock())
        elif me.admission is not Admission.ADMITTED:
            raise AwaitingAdmission(
                f"a command must come from somebody let in; got {command.type!r} from one who "
                "is not; wait for the host",
            )
        elif isinstance(command, Speech):
            _speak(services, unit, meeting, me, command)
        elif isinstance(command, (RecordMeeting, Agree)):
            _record(services, unit, meeting, me, command)
        else:
            _require_host(me, command)
            _host(services, meeting, me, command)
            _note(services, unit, meeting, me, command)
        unit.commit()


def _speak(
    services: Services,
    unit: UnitOfWork,
    meeting: MeetingRow,
    me: ParticipantRow,
    command: Speech,
) -> None:
    now = services.clock()
    match command:
        case Say(text=text):
            _require_speaker(me)
            unit.meetings.say(_message(me, MessageKind.CHAT, text, services))
        case React(reaction=reaction):
            _say_in_passing(unit, _message(me, MessageKind.REACTION, reaction, services))
        case Caption(text=text):
            _require_speaker(me)
            _say_in_passing(unit, _message(me, MessageKind.CAPTION, text, services))
        case RaiseHand(raised=raised):
            me.hand_at = (me.hand_at or now) if raised else None
        case Microphone(on=on):
            if on:
                _require_speaker(me)
            me.microphone = on
        case Present(on=on):
            _present(meeting, me, on, now)
        case Network(connection=connection):
            me.connection = connection


def _say_in_passing(unit: UnitOfWork, message: MessageRow) -> None:
    """Say what nobody asks for later."""
    unit.meetings.say(message)
    unit.flush()
    passed = message.at - timedelta(seconds=_PASSING_LASTS_S)
    unit.meetings.forget_said(message.meeting_id, message.kind, passed)


def _present(meeting: MeetingRow, me: ParticipantRow, on: bool, now: datetime) -> None:
    """Share at once where nobody else does, and as the host; otherwise ask the host."""
    if on:
        _require_speaker(me)
        if presenter_of(meeting, now) in (None, me.id) or me.role is Role.HOST:
            meeting.presenter_id, meeting.presenter_asks_id = me.id, None
        else:
            meeting.presenter_asks_id = me.id
        return
    if meeting.presenter_id == me.id:
        meeting.presenter_id = None
    if meeting.presenter_asks_id == me.id:
        meeting.presenter_asks_id = None


def _record(
    services: Services,
    unit: UnitOfWork,
    meeting: MeetingRow,
    me: ParticipantRow,
    command: RecordMeeting | Agree,
) -> None:
    now = services.clock()
    performer_id = performers_by_participant(meeting, now).get(me.id)
    if isinstance(command, Agree):
        consent.answer(unit, meeting, me, performer_id, now, agreed=command.on)
        return
    _require_host(me, command)
    under_way = unit.recordings.under_way(meeting.id)
    if command.on:
        if meeting.sealed:
            raise MeetingSealed(
                "a meeting that is recorded must not be sealed; got one whose motion this server "
                "cannot read; open another meeting to record it"
            )
        consent.ask(unit, meeting, me, performer_id, now)
    elif under_way is not None:
        consent.end(under_way, "the host ended it", now)


def _host(
    services: Services,
    meeting: MeetingRow,
    me: ParticipantRow,
    command: Hosting,
) -> None:
    match command:
        case Admit(participant_id=who):
            _find(meeting, who, Admission.WAITING).admission = Admission.ADMITTED
        case Deny(participant_id=who):
            _find(meeting, who, Admission.WAITING).admission = Admission.DENIED
        case Remove(participant_id=who):
            sent_out = _find_other(meeting, who, me)
            sent_out.admission = Admission.REMOVED
            seats.ban(meeting, sent_out, services.clock())
            # otherwise the same link would bring them back at once
            _have_wait(meeting)
        case Mute(participant_id=who):
            _find_other(meeting, who, me).microphone = False
        case SetRole(participant_id=who, role=role):
            other = _find_other(meeting, who, me)
            other.role = role
            other.microphone = other.microphone and role is not Role.VIEWER
            if role is Role.HOST:
                me.role = Role.SPEAKER
        case LetPresent(participant_id=who, on=on):
            other = _find(meeting, who, Admission.ADMITTED)
            if on:
                meeting.presenter_id, meeting.presenter_asks_id = other.id, None
            else:
                _present(meeting, other, False, services.clock())
        case SetLobby(on=True):
            _have_wait(meeting)
        case SetLobby():
            meeting.lobby = False
            for one in meeting.participants:
                if one.admission is Admission.WAITING:
                    one.admission = Admission.ADMITTED
        case EndMeeting():
            for one in meeting.participants:
                one.admission = Admission.ENDED
            # one that is found by name goes on for whoever comes next
            if meeting.label is None:
                meeting.ended_at = services.clock()


def _note(
    services: Services, unit: UnitOfWork, meeting: MeetingRow, me: ParticipantRow, command: Hosting
) -> None:
    """Have the audit log tell what changes who may do what."""
    accounts = {one.id: one.account for one in meeting.participants}
    match command:
        case SetRole(participant_id=who, role=Role.HOST):
            what, to = "host_changed", accounts[who]
        case Remove(participant_id=who):
            what, to = "member_removed", accounts[who]
        case EndMeeting():
            what, to = "ended", None
        case _:
            return
    details = {} if to is None else {"to": to}
    note_of_meeting(services, unit, me.account, what, meeting.id, **details)


def _have_wait(meeting: MeetingRow) -> None:
    """Turn the lobby on; whoever only looked in so far has not come yet, and waits like others."""
    meeting.lobby = True
    for one in meeting.participants:
        if one.heard_at is None and one.admission is Admission.ADMITTED:
            one.admission = Admission.WAITING


def _require_speaker(me: ParticipantRow) -> None:
    if me.role is Role.VIEWER:
        raise ViewerMayNotSpeak(
            "whoever talks or writes must be the host or a speaker; got a viewer; raise a hand",
        )


def _require_host(me: ParticipantRow, command: Command) -> None:
    if me.role is not Role.HOST:
        raise HostCommand(
            f"{command.type!r} must come from the host; got it from a {me.role.value}; "
            "ask the host",
        )


def _find(
    meeting: MeetingRow, participant_id: str, admission: Admission | None = None
) -> ParticipantRow:
    for one in meeting.participants:
        if one.id == participant_id and admission in (None, one.admission):
            return one
    kind = "somebody in this meeting" if admission is None else f"somebody who is {admission.value}"
    refused = SeatReleased if admission is None else NotFound
    raise refused(
        f"participant_id must be that of {kind}; got {participant_id!r}; look at the roster, "
        "or join again"
    )


def _find_other(meeting: MeetingRow, participant_id: str, me: ParticipantRow) -> ParticipantRow:
    if participant_id == me.id:
        raise TargetIsHost(
            "this must be done to somebody else; got the host's own id; make another "
            "the host first",
        )
    return _find(meeting, participant_id, Admission.ADMITTED)


def _message(me: ParticipantRow, kind: MessageKind, text: str, services: Services) -> MessageRow:
    return MessageRow(
        meeting_id=me.meeting_id,
        kind=kind,
        participant_id=me.id,
        name=me.display_name,
        text=text,
        at=services.clock(),
    )
