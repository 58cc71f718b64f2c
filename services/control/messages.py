"""What travels on the control channel: JSON objects told apart by their `type`.

The page's types are written from these (services.client_types).
"""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, StringConstraints, TypeAdapter

from db.models import Role, Standing
from services.api.shapes import Name
from services.problems import Problem

LONGEST_MESSAGE_BYTES = 16 * 1024
Text = Annotated[str, StringConstraints(strip_whitespace=True, min_length=1, max_length=2000)]
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
    standing: Standing
    present: bool = Field(description="False while their connection is lost.")
    hand_at: datetime | None = Field(description="Since when their hand is up.")
    microphone: bool = Field(description="Whether they are to be heard.")


class Roster(_Message):
    """Who is there, whenever that changes; whoever waits sees only themselves."""

    type: Literal["roster"] = "roster"
    lobby: bool = Field(description="Whoever comes waits until the host lets them in.")
    members: list[Member]


class Said(_Message):
    """Somebody wrote to all."""

    type: Literal["said"] = "said"
    number: int
    participant_id: str
    name: str
    text: str
    at: datetime


class Reacted(_Message):
    """Somebody gave a sign to all."""

    type: Literal["reacted"] = "reacted"
    number: int
    participant_id: str
    name: str
    reaction: Reaction


class Speaking(_Message):
    """Who speaks now, whenever that changes."""

    type: Literal["speaking"] = "speaking"
    participant_ids: list[str]


class Refusal(_Message):
    """What was asked for was not done."""

    type: Literal["refusal"] = "refusal"
    problem: Problem


class Goodbye(_Message):
    """The last message: why the channel ends."""

    type: Literal["goodbye"] = "goodbye"
    reason: Reason
    problem: Problem | None = Field(default=None, description="Where it was refused.")


Speech = Say | React | RaiseHand | Microphone
"""What everybody may ask for who is let in."""
Hosting = Admit | Deny | Remove | Mute | SetRole | SetLobby | EndMeeting
Wish = Speech | Hosting | Leave
"""What somebody who is greeted may ask for."""
ToServer = Annotated[Hello | Beat | Wish, Field(discriminator="type")]
FromServer = Annotated[
    Welcome | Beat | Roster | Said | Reacted | Speaking | Refusal | Goodbye,
    Field(discriminator="type"),
]
TO_SERVER: TypeAdapter[Hello | Beat | Wish] = TypeAdapter(ToServer)
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
