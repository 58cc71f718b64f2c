"""`WS /v1/meetings/{id}/control`: `hello` with a seat's token, then commands and heartbeats.

Every message is a JSON object (services.control.messages). Both sides send a heartbeat once a
second; after five seconds without a message the connection counts as lost. Within 30 s of that,
`hello` with the same token resumes the seat: after a reload, an outage, or on another gateway.
Where the meeting lives elsewhere (services.homes), goodbye says `moved`.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging

from fastapi import APIRouter, WebSocket, WebSocketDisconnect
from fastapi.concurrency import run_in_threadpool
from pydantic import ValidationError
from starlette.websockets import WebSocketDisconnected

from scene.errors import InvalidInput
from services.api.dependencies import CurrentGateway, network_of_caller
from services.control import messages
from services.control.commands import account_of, connect, execute, read_caller
from services.control.hub import ControlConnection
from services.control.messages import (
    TO_SERVER,
    Beat,
    Command,
    Goodbye,
    Hello,
    Reason,
    Refusal,
    Welcome,
)
from services.control.roster import SILENCE_S
from services.errors import (
    Draining,
    HelloExpected,
    HelloRepeated,
    LivesElsewhere,
    SeatReleased,
    TooLarge,
)
from services.gateway import Gateway
from services.jobs.events import meeting_topic
from services.problem_details import Problem
from services.problems import problem_of

log = logging.getLogger(__name__)

router = APIRouter(tags=["meetings"])

_CLOSE_S = 2.0
_ROUTE = "WS /v1/meetings/{meeting_id}/control"
"""As the audit log names it, before a command's type."""
_GONE = (WebSocketDisconnect, WebSocketDisconnected)


@router.websocket("/v1/meetings/{meeting_id}/control")
async def control(socket: WebSocket, meeting_id: str, gateway: CurrentGateway) -> None:
    """The channel of one page, from hello to goodbye."""
    await socket.accept()
    with contextlib.suppress(*_GONE, TimeoutError):
        connection = await _greet(socket, gateway, meeting_id)
        if connection is not None:
            async with gateway.hub.attached(connection):
                await _exchange(socket, gateway, connection)
        async with asyncio.timeout(_CLOSE_S):
            await socket.close()


async def _greet(socket: WebSocket, gateway: Gateway, meeting_id: str) -> ControlConnection | None:
    """Seat the page; None where it was refused."""
    services, network, hello = gateway.services, network_of_caller(socket), None
    try:
        # before a token is read, as by REST
        await run_in_threadpool(services.address_limit.take, network)
        async with asyncio.timeout(SILENCE_S):
            hello = read_message(await _receive(socket))
        if not isinstance(hello, Hello):
            raise HelloExpected(f"the first message must be 'hello'; got {hello.type!r}")
        caller = await run_in_threadpool(read_caller, services, meeting_id, hello)
        await run_in_threadpool(gateway.homes.require_here, meeting_id, socket.url.path)
        me = await run_in_threadpool(connect, services, meeting_id, caller, hello.name)
    except (*_GONE, TimeoutError):
        raise
    except Exception as error:
        goodbye = Goodbye(reason=_why_refused(error), problem=_logged_problem(error))
        await socket.send_text(goodbye.model_dump_json())
        account = account_of(services, hello) if isinstance(hello, Hello) else ""
        await gateway.refusals.note(account or network, account, _ROUTE, error)
        return None
    await run_in_threadpool(services.events.publish, meeting_topic(meeting_id))
    connection = ControlConnection(meeting_id, me.id, caller.account, services.clock(), hello.after)
    connection.send(Welcome(participant_id=me.id, seat=me.seat, silence_s=SILENCE_S))
    return connection


def _why_refused(error: Exception) -> Reason:
    match error:
        case SeatReleased():
            return "given-back"
        case LivesElsewhere() | Draining():
            return "moved"
        case _:
            return "refused"


async def _exchange(socket: WebSocket, gateway: Gateway, connection: ControlConnection) -> None:
    """Listen and send until either way ends."""
    ways = (
        asyncio.create_task(_listen(socket, gateway, connection)),
        asyncio.create_task(_send(socket, connection)),
    )
    try:
        await asyncio.wait(ways, return_when=asyncio.FIRST_COMPLETED)
    finally:
        for way in ways:
            way.cancel()
        ended = await asyncio.gather(*ways, return_exceptions=True)
    for fault in ended:
        if isinstance(fault, Exception) and not isinstance(fault, _GONE):
            raise fault


async def _send(socket: WebSocket, connection: ControlConnection) -> None:
    while (message := await connection.outbox.get()) is not None:
        await socket.send_text(message.model_dump_json())


async def _listen(socket: WebSocket, gateway: Gateway, connection: ControlConnection) -> None:
    while True:
        text = await _receive(socket)
        connection.heard_at = gateway.services.clock()
        message = None
        try:
            message = read_message(text)
            if isinstance(message, Beat):
                connection.send(message)
            elif isinstance(message, Hello):
                raise HelloRepeated(
                    "'hello' must come once; got it again; open a new channel",
                )
            else:
                gateway.command_limit.take(connection.participant_id)
                await _execute(gateway, connection, message)
        except Exception as error:
            connection.send(Refusal(problem=_logged_problem(error)))
            route = f"{_ROUTE} {'' if message is None else message.type}"
            # people who came by an invitation share an account
            gateway.refusals.note_soon(connection.participant_id, connection.account, route, error)


async def _receive(socket: WebSocket) -> str:
    message = await socket.receive()
    if message["type"] == "websocket.disconnect":
        raise WebSocketDisconnect
    # what comes as bytes is no message of ours, and is refused as such
    return message.get("text") or ""


async def _execute(gateway: Gateway, connection: ControlConnection, command: Command) -> None:
    # a seat that its holder releases is not reported as lost
    connection.leaving = isinstance(command, messages.Leave)
    await run_in_threadpool(
        execute, gateway.services, connection.meeting_id, connection.participant_id, command
    )
    if connection.leaving:
        connection.end("left")
    gateway.hub.notify(connection.meeting_id)
    await run_in_threadpool(gateway.services.events.publish, meeting_topic(connection.meeting_id))


def read_message(text: str) -> Hello | Beat | Command:
    """A message that came as `text`. Raises TooLarge, and InvalidInput for what is none."""
    if len(text) > messages.LONGEST_MESSAGE_BYTES:
        raise TooLarge(
            f"a message must have at most {messages.LONGEST_MESSAGE_BYTES} characters; got "
            f"{len(text)}",
        )
    try:
        return TO_SERVER.validate_json(text)
    except ValidationError as error:
        fault = error.errors(include_url=False)[0]
        where = ".".join(str(part) for part in fault["loc"]) or "the message"
        raise InvalidInput(
            f"a message must be one of the control channel's JSON objects; got a fault at {where}: "
            f"{fault['msg']}; see ToServer in /openapi.json",
        ) from error


def _logged_problem(error: Exception) -> Problem:
    problem = problem_of(error)
    if problem.status == 500:
        log.exception("a control channel failed", exc_info=error)
    return problem
