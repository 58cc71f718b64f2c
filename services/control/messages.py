"""What travels on the control channel: JSON objects told apart by their `type`.

The page's types are written from these (tools.client_types).
"""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, StringConstraints, TypeAdapter

from db.models import Admission, Connection, Role
from services.names import Name
from services.problem_details import Problem

LONGEST_MESSAGE_BYTES = 16 * 1024
Text = Annotated[str, StringConstraints(strip_whitespace=True, min_length=1, max_length=2000)]
CaptionText = Annotated[str, StringConstraints(strip_whitespace=True, min_length=1, max_length=500)]
Reaction = Literal["applause", "heart", "laugh", "surprise", "agree", "party"]
Reason = Literal[
    "left", "given-back", "denied", "removed", "ended", "replaced", "silent", "refused", "moved"
]


class _Message(BaseModel):
    # defaults are always sent: the page may rely on each `type`
    model_config = ConfigDict(extra="forbid", json_schema_serialization_defaults_required=True)


class Hello(_Message):
    """The first message of a page: which seat it uses. A later connection sends it again."""

    type: Literal["hello"] = "hello"
    token: str = Field(max_length=4096, description="The token of the seat, as joining gave it.")
    name: Name
    after: int = Field(
        default=0,
        ge=0,
        le=2**53 - 1,
        description="Number of the newest message received; newer ones are sent.",
    )


class Beat(_Message):
    """A heartbeat, sent by both sides once a second."""

    type: Literal["beat"] = "beat"


class Say(_Message):
    """Send a chat message to all participants."""

    type: Literal["say"] = "say"
    text: Text


class React(_Message):
    """Send a reaction to all participants; it is shown for a moment."""

    type: Literal["react"] = "react"
    reaction: Reaction


class RaiseHand(_Message):
    """Raise or lower one's hand."""

    type: Literal["hand"] = "hand"
    raised: bool


class Microphone(_Message):
    """Switch one's microphone on or off."""

    type: Literal["microphone"] = "microphone"
    on: bool


class Caption(_Message):
    """A caption of what one has just said."""

    type: Literal["caption"] = "caption"
    text: CaptionText


class Present(_Message):
    """Start or stop sharing a screen. While somebody else shares, the host is asked."""

    type: Literal["present"] = "present"
    on: bool


class Network(_Message):
    """The quality of one's network connection, whenever it changes."""

    type: Literal["network"] = "network"
    connection: Connection


class LetPresent(_Message):
    """The host lets a participant share their screen in place of the presenter, or stops it."""

    type: Literal["let-present"] = "let-present"
    participant_id: str
    on: bool


class Mute(_Message):
    """The host switches off a participant's microphone; they may switch it on again."""

    type: Literal["mute"] = "mute"
    participant_id: str


class Admit(_Message):
    """The host admits a participant who waits in the lobby."""

    type: Literal["admit"] = "admit"
    participant_id: str


class Deny(_Message):
    """The host denies admission to a participant who waits in the lobby."""

    type: Literal["deny"] = "deny"
    participant_id: str


class Remove(_Message):
    """The host removes a participant; from then on the lobby is on."""

    type: Literal["remove"] = "remove"
    participant_id: str


class SetRole(_Message):
    """The host gives a participant a role; a new host takes the place of the old one."""

    type: Literal["role"] = "role"
    participant_id: str
    role: Role


class SetLobby(_Message):
    """The host switches the lobby on or off; off admits everybody who waits."""

    type: Literal["lobby"] = "lobby"
    on: bool


class Leave(_Message):
    """Leave the meeting and release the seat."""

    type: Literal["leave"] = "leave"


class RecordMeeting(_Message):
    """The host asks everybody whether the meeting may be recorded, or ends the recording."""

    type: Literal["record"] = "record"
    on: bool


class Agree(_Message):
    """Agree to being recorded, refuse, or withdraw; the last two end the recording."""

    type: Literal["agree"] = "agree"
    on: bool


class EndMeeting(_Message):
    """The host ends the meeting for everybody."""

    type: Literal["end"] = "end"


class Welcome(_Message):
    """The answer to `hello`."""

    type: Literal["welcome"] = "welcome"
    participant_id: str
    seat: int
    silence_s: float = Field(
        description="After so long without a message the connection counts as lost, s."
    )


class Member(_Message):
    """A participant in the meeting or in its lobby."""

    id: str
    name: str
    role: Role
    admission: Admission
    present: bool = Field(description="False while their connection is lost.")
    hand_at: datetime | None = Field(
        description="Since when their hand is raised; empty: it is not."
    )
    microphone: bool = Field(description="Whether their microphone is on.")
    connection: Connection | None = Field(
        description="Quality of their network connection; empty: unknown."
    )
    performer_id: str | None = Field(
        description="The performer that represents them, from whose position their voice is heard."
    )


class RecordingUnderWay(_Message):
    """A recording that was asked for or is running."""

    id: str
    running: bool = Field(
        description="Everybody present has agreed, and the meeting is being recorded."
    )
    agreed: list[str] = Field(description="Ids of the participants who have agreed.")


class Roster(_Message):
    """The participants, whenever they change; one in the lobby sees only themselves."""

    type: Literal["roster"] = "roster"
    lobby: bool = Field(description="Whoever joins waits until the host admits them.")
    environment: str = Field(description="Name of the environment that the meeting is held in.")
    presenter_id: str | None = Field(
        description="The participant who may share a screen; empty: nobody."
    )
    presenter_asks_id: str | None = Field(
        description="The participant who asks to present instead; only the host and they see it."
    )
    recording: RecordingUnderWay | None = Field(
        description="Empty: the meeting is not recorded, and nobody has asked to."
    )
    members: list[Member]
    performer_ids: list[str] = Field(
        description="Of the performers who are shown, in the order of their poses: whoever is "
        "drawn and is not among them is to be drawn no longer."
    )


class Said(_Message):
    """A chat message of a participant."""

    type: Literal["said"] = "said"
    number: int
    participant_id: str
    name: str
    text: str
    at: datetime


class Captioned(_Message):
    """A caption of what a participant said, from their own page."""

    type: Literal["captioned"] = "captioned"
    number: int
    participant_id: str
    name: str
    text: str


class Reacted(_Message):
    """A reaction of a participant."""

    type: Literal["reacted"] = "reacted"
    number: int
    participant_id: str
    name: str
    reaction: Reaction


class Speaking(_Message):
    """Who is speaking and in which track each is heard, whenever that changes."""

    type: Literal["speaking"] = "speaking"
    participant_ids: list[str]
    slots: list[str | None] = Field(
        description="By track of the voice connection: the participant whose voice it carries."
    )


class Refusal(_Message):
    """A command that was refused."""

    type: Literal["refusal"] = "refusal"
    problem: Problem


class Goodbye(_Message):
    """The last message: why the channel is closed."""

    type: Literal["goodbye"] = "goodbye"
    reason: Reason
    problem: Problem | None = Field(
        default=None, description="Why `hello` was refused; empty for other reasons."
    )


Speech = Say | React | RaiseHand | Microphone | Caption | Present | Network
"""Commands of every admitted participant."""
Hosting = Admit | Deny | Remove | Mute | SetRole | SetLobby | LetPresent | EndMeeting
Command = Speech | Hosting | RecordMeeting | Agree | Leave
"""What a participant may send once greeted."""
ToServer = Annotated[Hello | Beat | Command, Field(discriminator="type")]
FromServer = Annotated[
    Welcome | Beat | Roster | Said | Reacted | Captioned | Speaking | Refusal | Goodbye,
    Field(discriminator="type"),
]
TO_SERVER: TypeAdapter[Hello | Beat | Command] = TypeAdapter(ToServer)
FROM_SERVER: TypeAdapter[Any] = TypeAdapter(FromServer)


def schemas() -> dict[str, Any]:
    """JSON Schemas of both ways, by name, as an OpenAPI document holds them."""
    place = "#/components/schemas/{model}"
    found: dict[str, Any] = {}
    for name, ways in (("ToServer", TO_SERVER), ("FromServer", FROM_SERVER)):
        schema = ways.json_schema(mode="serialization", ref_template=place)
        found |= schema.pop("$defs")
        found[name] = schema
    return found
