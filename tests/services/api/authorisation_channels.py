"""What each data channel and each command of the control channel answers to each caller.

As in `authorisation_matrix`: about what is Ada's, and about what is Cy's; `OK` stands for what it
answers when it does what it was asked.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from services.live.sessions.view_session import ViewChannel
from tests.services.api.authorisation_matrix import ADMITTED, CONTROL_ANSWERS, Answers, answers


@dataclass(frozen=True)
class CommandRow:
    """A command, and what a seat that sends it is answered."""

    type: str
    answers: Answers
    fields: dict[str, Any] = field(default_factory=dict)
    """The rest of the command, with ids by the names of what they are ids of."""
    ok: int = 200
    """The status that `OK` stands for."""


#               none guest other viewer speaker host former waiting removed expired elsewhere
_OUTSIDE = "     401 403   403   403    403     403  403    403     403     401     403"
DRIVES = answers(
    "            401 403   403   403    403     403  ok     403     403     401     403", _OUTSIDE
)
"""Ada's lobby is on, so that her own account drives from its seat alone."""
EVERYBODY = answers(
    "            401 403   403   ok     ok      ok   ok     403     403     401     403", _OUTSIDE
)
SPEAKERS = answers(
    "            401 403   403   403    ok      ok   ok     403     403     401     403", _OUTSIDE
)
HOSTS = answers(
    "            401 403   403   403    403     ok   403    403     403     401     403", _OUTSIDE
)
SEATS = CONTROL_ANSWERS
"""Whoever has a seat, whether it was let in or not."""

DATA_CHANNELS = {
    ViewChannel.VIEW: ADMITTED,
    ViewChannel.POSE: ADMITTED,
    ViewChannel.LOOK: ADMITTED,
    ViewChannel.MOTION: DRIVES,
    ViewChannel.KEYPOINTS: DRIVES,
}
"""Of a connection by `POST /whep`; where that is refused, as it refuses."""

_WAITS = {"participant_id": "{waiting}"}
_SPEAKS = {"participant_id": "{speaker}"}
COMMANDS = (
    CommandRow("say", SPEAKERS, {"text": "Hello"}),
    CommandRow("caption", SPEAKERS, {"text": "Hello"}),
    CommandRow("microphone", SPEAKERS, {"on": True}),
    CommandRow("present", SPEAKERS, {"on": True}),
    CommandRow("react", EVERYBODY, {"reaction": "heart"}),
    CommandRow("hand", EVERYBODY, {"raised": True}),
    CommandRow("network", EVERYBODY, {"connection": "good"}),
    # nobody has asked: see tests/services/recording
    CommandRow("agree", EVERYBODY, {"on": True}, ok=409),
    CommandRow("leave", SEATS),
    CommandRow("admit", HOSTS, _WAITS),
    CommandRow("deny", HOSTS, _WAITS),
    CommandRow("remove", HOSTS, _SPEAKS),
    CommandRow("mute", HOSTS, _SPEAKS),
    CommandRow("role", HOSTS, _SPEAKS | {"role": "viewer"}),
    CommandRow("let-present", HOSTS, _SPEAKS | {"on": True}),
    CommandRow("lobby", HOSTS, {"on": False}),
    CommandRow("record", HOSTS, {"on": True}),
    CommandRow("end", HOSTS),
)
"""Every command; `hello` and `beat` are the channel's own."""
