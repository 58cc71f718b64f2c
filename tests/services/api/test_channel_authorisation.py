"""Each data channel, and each command of the control channel, answers each caller as it should."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator, Callable
from typing import get_args

import httpx
import pytest
from fastapi import FastAPI

from db.errors import NotFound
from services.app import create_app
from services.container import Services
from services.control.commands import connect, execute, read_caller
from services.control.messages import TO_SERVER, Beat, Command, Hello, ToServer
from services.errors import SeatReleased
from services.gateway import gateway_of
from services.live.packets import ViewPacket, encode_view
from services.live.room import Room
from services.live.sessions.view_session import ViewChannel
from services.live.sessions.view_sessions import ViewSessions
from services.problems import problem_of
from tests.services.api.authorisation_channels import COMMANDS, DATA_CHANNELS, CommandRow
from tests.services.api.authorisation_matrix import OK, Answers
from tests.services.api.authorisation_world import Belongings, Caller, World
from tests.services.live.viewer import Viewer


@pytest.fixture
def services(world_services: Services) -> Services:
    return world_services


@pytest.fixture
async def app(services: Services) -> AsyncIterator[FastAPI]:
    made = create_app(services)
    yield made
    await gateway_of(made).close()


def _cells(world: World, answers: Answers) -> list[tuple[Caller, str, Belongings, int]]:
    """Caller, whose it is, what is theirs, the expected status; those who are refused first."""
    cells = [(one, "own", world.ada, wanted) for one, wanted in answers.own.items()]
    cells += [(one, "foreign", world.cy, wanted) for one, wanted in answers.foreign.items()]
    return sorted(cells, key=lambda cell: cell[3] == OK)


def test_every_command_and_every_data_channel_has_its_row():
    sent = {one.model_fields["type"].default for one in get_args(get_args(ToServer)[0])}
    assert sorted([*(row.type for row in COMMANDS), "hello", "beat"]) == sorted(sent)
    assert set(DATA_CHANNELS) == set(ViewChannel)


def _seat(services: Services, world: World, caller: Caller) -> str:
    seat = services.tokens.read(world.tokens[caller]).participant_id
    assert seat is not None
    return seat


def _command(row: CommandRow, **seats: str) -> Command:
    fields = {
        name: value.format_map(seats) if isinstance(value, str) else value
        for name, value in row.fields.items()
    }
    command = TO_SERVER.validate_python({"type": row.type} | fields)
    assert not isinstance(command, Hello | Beat)
    return command


def _send(services: Services, meeting_id: str, token: str, command: Command | None) -> int:
    """As the channel does: hello, then a command. The status of the refusal, or 200."""
    hello = Hello(token=token, name="Somebody")
    try:
        me = connect(services, meeting_id, read_caller(services, meeting_id, hello), hello.name)
        if command is not None:
            execute(services, meeting_id, me.id, command)
    except Exception as error:
        return problem_of(error).status
    return 200


@pytest.mark.parametrize("row", COMMANDS, ids=lambda row: row.type)
def test_a_command_answers_each_caller_as_it_should(
    services: Services, world: World, row: CommandRow
):
    command = _command(
        row,
        waiting=_seat(services, world, Caller.WAITING),
        speaker=_seat(services, world, Caller.SPEAKER),
    )
    # the host is there: nobody else becomes it by coming
    assert _send(services, world.ada.params["meeting_id"], world.tokens[Caller.HOST], None) == 200
    told, expected = {}, {}
    for caller, name, owner, wanted in _cells(world, row.answers):
        meeting_id = owner.params["meeting_id"]
        told[caller, name] = _send(services, meeting_id, world.tokens[caller], command)
        expected[caller, name] = row.ok if wanted == OK else wanted
    assert told == expected


@pytest.mark.parametrize("row", [one for one in COMMANDS if "participant_id" in one.fields])
def test_a_host_reaches_nobody_of_another_meeting(
    services: Services, world: World, row: CommandRow
):
    elsewhere = _seat(services, world, Caller.ELSEWHERE)
    command = _command(row, waiting=elsewhere, speaker=elsewhere)
    with pytest.raises((NotFound, SeatReleased)):
        execute(
            services,
            world.ada.params["meeting_id"],
            _seat(services, world, Caller.HOST),
            command,
        )


async def _until(fits: Callable[[], bool]) -> None:
    async with asyncio.timeout(20):
        while not fits():
            await asyncio.sleep(0.02)


async def _answer(viewer: Viewer, room: Room, label: ViewChannel, performer_id: str) -> int:
    """What a data channel of the viewer answers: 200 where it does what it is for."""
    channel, heard = viewer.channel, []
    if label is not ViewChannel.VIEW:
        channel = viewer.peer.createDataChannel(label, protocol=performer_id)
        channel.on("message", heard.append)
    # one that is refused may be closed again already
    await _until(lambda: channel.readyState != "connecting")
    match label:
        case ViewChannel.VIEW:
            draws = ViewPacket(0, 0.0, (0, 1, 3), (1, 0, 0, 0), 0.7, 64, 64, draws_itself=True)
            channel.send(encode_view(draws))
        case ViewChannel.POSE:
            # which come only to whoever has said by `view` that they draw
            await _until(lambda: bool(heard))
            assert len(room.performers) == 1
        case ViewChannel.LOOK:
            pass  # pictures come while somebody shows themselves: tests/services/live
        case ViewChannel.MOTION | ViewChannel.KEYPOINTS:
            await _until(lambda: bool(heard) or performer_id in room.live_motions)
            if heard:
                return json.loads(heard[0])["status"]
            channel.close()
            await _until(lambda: performer_id not in room.live_motions)
    return 200


async def test_a_data_channel_answers_each_caller_as_it_should(
    app: FastAPI, services: Services, world: World
):
    views: ViewSessions = gateway_of(app).views
    told, expected = {}, {}
    transport = httpx.ASGITransport(app, raise_app_exceptions=False)
    async with httpx.AsyncClient(transport=transport, base_url="http://test") as nobody:
        for name, owner in (("own", world.ada), ("foreign", world.cy)):
            for caller in Caller:
                viewer = Viewer()
                answer = await viewer.look(
                    nobody, owner.params["meeting_id"], world.headers(caller)
                )
                for label, answers in DATA_CHANNELS.items():
                    wanted = (answers.own if name == "own" else answers.foreign)[caller]
                    expected[caller, name, label] = wanted or 200
                    told[caller, name, label] = answer.status_code
                    if answer.status_code == 201:
                        room = await views.room(owner.params["meeting_id"])
                        told[caller, name, label] = await _answer(
                            viewer, room, label, owner.params["performer_id"]
                        )
                await viewer.peer.close()
    assert told == expected
