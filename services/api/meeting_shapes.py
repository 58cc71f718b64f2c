"""Meetings, performers and seats as JSON."""

from __future__ import annotations

from datetime import datetime
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from db.models import Admission, MeetingRow, PerformerRow, Purpose, Role
from services import meetings
from services.api.shapes import Body
from services.arrangement import DefaultViewpoint, view_from_the_front
from services.auth import Principal
from services.likeness import may_drive
from services.live.ice_servers import IceServer
from services.names import Name

Owner = Literal["own", "demo", "other"]


class Viewpoint(BaseModel):
    """From where one looks at first: an orbit round a target."""

    model_config = ConfigDict(from_attributes=True)

    target: tuple[float, float, float] = Field(description="World, m.")
    azimuth_rad: float = Field(description="0 looks from +z, +pi/2 from +x.")
    elevation_rad: float = Field(description="Positive above the target.")
    distance_m: float = Field(description="From the target; more where the width needs it.")
    width_m: float = Field(description="What is to be in sight at the target.")
    depth_m: float = Field(description="How far behind the target the last performer is.")
    narrow: Viewpoint | None = Field(
        description="What a picture shows instead that would have to step back for the width."
    )

    @classmethod
    def of(cls, view: DefaultViewpoint) -> Viewpoint:
        return cls.model_validate(view)


class NewMeeting(Body):
    """A meeting to open."""

    name: Name = Field(examples=["Monday"])
    model_ids: list[str] = Field(default_factory=list, max_length=12)
    lobby: bool = Field(
        default=False, description="Whoever joins waits until the host admits them."
    )
    sealed: bool = Field(
        default=False,
        description="Motion travels end-to-end encrypted, by a key that pages put into the link "
        "and this server never gets: it neither draws nor records the meeting.",
    )


class NewPerformer(Body):
    """A model that is to perform in a meeting."""

    model_id: str
    motion_sequence_id: str | None = Field(
        default=None, description="The sequence whose motion it follows; empty: the model's own."
    )


class Performer(BaseModel):
    """A person's model standing in a meeting."""

    id: str
    name: str
    model_id: str
    motion_sequence_id: str | None = Field(description="Empty: moves as they were filmed.")
    position: tuple[float, float, float] = Field(description="World, m.")
    yaw_rad: float = Field(description="Turn of the model about +y.")
    owner: Owner = Field(
        description="Whose person it is: the caller's own, the demo's, or somebody else's."
    )
    drivable: bool = Field(
        description="Whether the caller may drive them: their own, and whose person consents to "
        "being driven by others."
    )
    viewpoint: Viewpoint = Field(description="In front of them.")

    @classmethod
    def of(cls, row: PerformerRow, caller: Principal, now: datetime) -> Performer:
        return cls(
            id=row.id,
            name=row.name,
            model_id=row.model_id,
            motion_sequence_id=row.motion_sequence_id,
            position=meetings.position(row),
            yaw_rad=meetings.yaw(row),
            owner=_owner(row, caller),
            drivable=may_drive(
                caller.account, row.account, lent=row.person.consents_to(Purpose.DRIVING, now)
            ),
            viewpoint=Viewpoint.of(view_from_the_front([meetings.placed(row)])),
        )


class Meeting(BaseModel):
    """A meeting and the performers who are shown in it."""

    id: str
    name: str
    join_url: str
    environment: str = Field(description="Name of the place it is held in.")
    performers: list[Performer]
    viewpoint: Viewpoint = Field(description="From where the caller looks at first.")
    lobby: bool = Field(description="Whoever joins waits until the host admits them.")
    sealed: bool = Field(description="Motion travels end-to-end encrypted.")
    recording: bool = Field(
        default=False, description="Whoever joins is asked to agree to being recorded."
    )

    @classmethod
    def of(cls, row: MeetingRow, join_url: str, caller: Principal, now: datetime) -> Meeting:
        return cls(
            id=row.id,
            name=row.name,
            join_url=join_url,
            environment=row.environment,
            performers=[Performer.of(one, caller, now) for one in row.shown_at(now)],
            viewpoint=Viewpoint.of(meetings.default_viewpoint(row, caller.account, now)),
            lobby=row.lobby,
            sealed=row.sealed,
        )


class OpenedMeeting(Meeting):
    """A new meeting, as its creator sees it."""

    host_token: str = Field(description="Join with it to be the host; keep it to yourself.")


class Invitation(BaseModel):
    """How others come to a meeting."""

    join_url: str = Field(description="The link to send; it lasts for a week.")


class Visitor(Body):
    """Somebody who wants to join."""

    display_name: Name = Field(default="Guest")


class Seat(BaseModel):
    """A seat in a meeting, and the token that it is used with."""

    token: str = Field(
        description="Opens this meeting's view and control channel, also after a reload."
    )
    participant_id: str
    seat: int
    role: Role
    admission: Admission = Field(
        description="Whether the host has admitted you; there is no view before that."
    )
    ice_servers: list[IceServer] = Field(
        description="For RTCConfiguration; credentials of TURN last as long as the token."
    )
    gateway_url: str = Field(
        description="Address of the gateway that the meeting lives on; empty: whichever you ask. "
        "Your view and your control channel are there, and after a loss may be elsewhere."
    )
    whep_url: str
    control_url: str
    ready: bool = Field(
        description="False while the renderer compiles, on its first start on a machine."
    )
    performers: list[Performer]
    viewpoint: Viewpoint = Field(description="From where you look at first.")


class MeetingHome(BaseModel):
    """Where the voices and pictures of a meeting are."""

    gateway_url: str = Field(description="As in `Seat`.")


class DemoMeeting(BaseModel):
    """The demo's meeting, where the server shows one."""

    meeting_id: str | None = Field(description="Empty: this server runs no demo.")


def _owner(row: PerformerRow, caller: Principal) -> Owner:
    if row.account == caller.account:
        return "own"
    return "demo" if caller.may_use(row.account) else "other"
