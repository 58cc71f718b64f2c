"""What travels on the control channel: JSON objects told apart by their `type`.

The page's types are written from these (tools.client_types).
"""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, StringConstraints, TypeAdapter

from db.models import Admission, Connection, Role
from services.names import Name
from services.problems import Problem

LONGEST_MESSAGE_BYTES = 16 * 1024
Text = Annotated[str, StringConstraints(strip_whitespace=True, min_length=1, max_length=2000)]
CaptionText = Annotated[str, StringConstraints(strip_whitespace=True, min_length=1, max_length=500)]
Reaction = Literal["applause", "heart", "laugh", "surprise", "agree", "party"]
Reason = Literal[
    "left", "given-back", "denied", "removed", "ended", "replaced", "silent", "refused"
]


class _Message(BaseModel):
    # defaults are always sent: the page may rely on each `type`
    model_config = ConfigDict(extra="forbid", json_schema_serialization_defaults_required=True)


class Hello(_Message):
    """The first message of a page: whose seat it is. The same again takes the seat up again."""

    type: Literal["hello"] = "hello"
    token: str = Field(max_length=4096, description="That of the seat.")
    name: Name
    after: int = Field(default=0, ge=0, description="Number of the newest message received.")


class Beat(_Message):
    """A sign of life, each way, once a second."""

    type: Literal["beat"] = "beat"


class Say(_Message):
    """Write to all."""

    type: Literal["say"] = "say"
    text: Text


class React(_Message):
    """A passing sign to all."""

    type: Literal["react"] = "react"
    reaction: Reaction


class RaiseHand(_Message):
    """Ask to speak, or no longer."""

    type: Literal["hand"] = "hand"
    raised: bool


class Microphone(_Message):
    """Be heard, or no longer."""

    type: Literal["microphone"] = "microphone"
    on: bool


class Caption(_Message):
    """What one has just spoken, in writing."""

    type: Literal["caption"] = "caption"
    text: CaptionText


class Present(_Message):
    """Share a screen, or no longer. While somebody else does, the host is asked."""

    type: Literal["present"] = "present"
    on: bool


class Network(_Message):
    """How well the network carries the meeting, whenever that changes."""

    type: Literal["network"] = "network"
    connection: Connection


class LetPresent(_Message):
    """The host lets somebody share their screen in place of whoever does, or has them stop."""

    type: Literal["let-present"] = "let-present"
    participant_id: str
    on: bool


class Mute(_Message):
    """The host switches off somebody's microphone; they may switch it on again."""

    type: Literal["mute"] = "mute"
    participant_id: str


class Admit(_Message):
    """The host lets in somebody who waits."""

    type: Literal["admit"] = "admit"
    participant_id: str


class Deny(_Message):
    """The host does not let in somebody who waits."""

    type: Literal["deny"] = "deny"
    participant_id: str


class Remove(_Message):
    """The host sends somebody out; from then on whoever comes has to wait."""

    type: Literal["remove"] = "remove"
    participant_id: str


class SetRole(_Message):
    """The host makes somebody speaker, viewer, or host in their own place."""

    type: Literal["role"] = "role"
    participant_id: str
    role: Role


class SetLobby(_Message):
    """The host has people wait, or lets everybody in."""

    type: Literal["lobby"] = "lobby"
    on: bool


class Leave(_Message):
    """Give the seat back."""

    type: Literal["leave"] = "leave"


class RecordMeeting(_Message):
    """The host asks everybody whether the meeting may be recorded, or ends the recording."""

    type: Literal["record"] = "record"
    on: bool


class Agree(_Message):
    """Somebody agrees to being recorded, or does not, or no longer: that ends the recording."""

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
    silence_s: float = Field(description="Either side silent for so long is gone, s.")


class Member(_Message):
    """Somebody in the meeting, or waiting before it."""

    id: str
    name: str
    role: Role
    admission: Admission
    present: bool = Field(description="False while their connection is lost.")
    hand_at: datetime | None = Field(description="Since when their hand is up.")
    microphone: bool = Field(description="Whether they are to be heard.")
    connection: Connection | None = Field(
        description="How well their network does; empty: unknown."
    )
    performer_id: str | None = Field(
        description="Who stands for them in the room; their voice comes from there."
    )


class RecordingUnderWay(_Message):
    """A recording that is asked for, or runs."""

    id: str
    running: bool = Field(description="Everybody here has agreed, and it is being kept.")
    agreed: list[str] = Field(description="Ids of the participants who have agreed.")


class Roster(_Message):
    """Who is there, whenever that changes; whoever waits sees only themselves."""

    type: Literal["roster"] = "roster"
    lobby: bool = Field(description="Whoever comes waits until the host lets them in.")
    environment: str = Field(description="Name of the place that the meeting is held in.")
    presenter_id: str | None = Field(description="Who may share a screen; empty: nobody does.")
    presenter_asks_id: str | None = Field(
        description="Who asks to share in their place; only the host and they are told."
    )
    recording: RecordingUnderWay | None = Field(description="Empty: nothing is, or is to be, kept.")
    members: list[Member]


class Said(_Message):
    """Somebody wrote to all."""

    type: Literal["said"] = "said"
    number: int
    participant_id: str
    name: str
    text: str
    at: datetime


class Captioned(_Message):
    """Somebody spoke, and their page wrote it down."""

    type: Literal["captioned"] = "captioned"
    number: int
    participant_id: str
    name: str
    text: str


class Reacted(_Message):
    """Somebody gave a sign to all."""

    type: Literal["reacted"] = "reacted"
    number: int
    participant_id: str
    name: str
    reaction: Reaction


class Speaking(_Message):
    """Who speaks now, and in which track each is heard, whenever that changes."""

    type: Literal["speaking"] = "speaking"
    participant_ids: list[str]
    slots: list[str | None] = Field(
        description="Whose voice each track of the voice connection carries, from the first."
    )


class Refusal(_Message):
    """What was asked for was not done."""

    type: Literal["refusal"] = "refusal"
    problem: Problem


class Goodbye(_Message):
    """The last message: why the channel ends."""

    type: Literal["goodbye"] = "goodbye"
    reason: Reason
    problem: Problem | None = Field(default=None, description="Where it was refused.")


Speech = Say | React | RaiseHand | Microphone | Caption | Present | Network
"""What everybody may ask for who is let in."""
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
