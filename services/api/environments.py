"""Environments: the places a meeting can be held in, and their light."""

from __future__ import annotations

import hashlib
from typing import Annotated, Any

from fastapi import APIRouter, Header, Request, Response
from fastapi.concurrency import run_in_threadpool
from pydantic import BaseModel, Field

from db.errors import NotFound
from db.models import PanoramaRow
from scene.lighting import Lighting
from services.api.body_limit import lift_body_limit
from services.api.dependencies import CurrentGateway, Joiner, Provided
from services.api.shapes import Body
from services.auth import Principal
from services.container import Services
from services.environments import STUDIO, Theme, brought_along, find_theme, light_of, themes
from services.errors import TooLarge
from services.problems import PROBLEMS
from services.seats import require_admitted, require_host, require_invited

router = APIRouter(prefix="/v1", tags=["environments"], responses=PROBLEMS)


LARGEST_PICTURE_BYTES = 20 << 20
_OWN_TITLE = "Our own"
PICTURE: dict[int | str, dict[str, Any]] = {
    200: {"content": {"image/jpeg": {}}},
    304: {"description": "Kept."},
}
IfNoneMatch = Annotated[str | None, Header()]


class Light(BaseModel):
    """What falls on performers, linear RGB; 1 is what makes a white surface white."""

    harmonics: list[tuple[float, float, float]] = Field(
        description="Irradiance over pi: coefficients of the 9 real spherical harmonics to order 2."
    )
    key_direction: tuple[float, float, float] = Field(description="Unit, towards the light; world.")
    key_colour: tuple[float, float, float]

    @classmethod
    def of(cls, lighting: Lighting) -> Light:
        return cls(
            harmonics=lighting.harmonics.tolist(),
            key_direction=tuple(lighting.key_direction.tolist()),
            key_colour=tuple(lighting.key_colour.tolist()),
        )


class Environment(BaseModel):
    """A place to meet in."""

    name: str
    title: str = Field(description="For people to read.")
    picture_url: str | None = Field(
        description="Equirectangular JPEG, its middle towards +x; empty: the plain studio."
    )
    light: Light | None = Field(description="Empty: everybody keeps the light they were filmed in.")

    @classmethod
    def of(cls, theme: Theme) -> Environment:
        light = None if theme.lighting is None else Light.of(theme.lighting)
        url = f"/v1/environments/{theme.name}/picture" if theme.picture else None
        return cls(name=theme.name, title=theme.title, picture_url=url, light=light)


class Environments(BaseModel):
    """The library."""

    items: list[Environment]


class Place(Body):
    """Where a meeting is held."""

    name: str = Field(max_length=32, examples=["apartment"])


@router.get("/environments", summary="List environments")
def list_environments(caller: Joiner) -> Environments:
    """Every environment in which a meeting can be held, the plain studio first."""
    return Environments(items=[Environment.of(theme) for theme in themes().values()])


@router.get(
    "/environments/{name}/picture",
    summary="See an environment",
    response_class=Response,
    responses=PICTURE,
)
def read_picture(name: str, if_none_match: IfNoneMatch = None) -> Response:
    """The environment as an equirectangular picture. It is public."""
    theme = find_theme(name)
    if theme.picture is None:
        raise NotFound(f"environment must be one with a picture; got {name!r}, a plain room")
    return picture_answer(theme.picture.read_bytes(), if_none_match, "public, max-age=86400")


@router.get("/meetings/{meeting_id}/environment", summary="Read a meeting's environment")
def read_environment(meeting_id: str, services: Provided, caller: Joiner) -> Environment:
    """The environment and its light; the picture of an uploaded one needs a seat's token."""
    caller.require_meeting(meeting_id)
    with services.reading() as unit:
        meeting = unit.meetings.get(meeting_id)
        require_invited(meeting, caller)
        own = unit.meetings.panorama(meeting_id)
        if own is not None and own.name == meeting.environment:
            return _in_meeting(own)
    known = themes()
    return Environment.of(known.get(meeting.environment, known[STUDIO]))


@router.put("/meetings/{meeting_id}/environment", summary="Choose a meeting's environment")
async def choose_environment(
    meeting_id: str, body: Place, gateway: CurrentGateway, services: Provided, caller: Joiner
) -> Environment:
    """Move a meeting to another environment, at once for every viewer. Only the host may."""
    caller.require_meeting(meeting_id)
    chosen = await run_in_threadpool(_choose, services, caller, meeting_id, body.name)
    await gateway.show_anew(meeting_id)
    return chosen


@router.put(
    "/meetings/{meeting_id}/panorama",
    summary="Upload an environment",
    openapi_extra={"requestBody": {"content": {kind: {} for kind in ("image/jpeg", "image/png")}}},
)
async def bring_place(
    meeting_id: str,
    request: Request,
    gateway: CurrentGateway,
    services: Provided,
    caller: Joiner,
) -> Environment:
    """Hold a meeting in the host's own environment: an equirectangular picture of up to 20 MB.

    Its light is found in it. The meeting keeps the newest such place.
    """
    caller.require_meeting(meeting_id)
    await run_in_threadpool(_check_host, services, caller, meeting_id)
    picture = await _read_picture(request)
    own = await gateway.turns.run(caller.counted_as, brought_along, meeting_id, picture)
    place = _in_meeting(own)
    await run_in_threadpool(_bring, services, caller, own)
    await gateway.show_anew(meeting_id)
    return place


@router.get(
    "/meetings/{meeting_id}/panorama",
    summary="Download the uploaded environment",
    response_class=Response,
    responses=PICTURE,
)
def read_own_picture(
    meeting_id: str, services: Provided, caller: Joiner, if_none_match: IfNoneMatch = None
) -> Response:
    """The host's equirectangular picture, for every admitted participant."""
    caller.require_meeting(meeting_id)
    with services.reading() as unit:
        require_admitted(unit.meetings.get(meeting_id), caller)
        picture = unit.meetings.panorama_picture(meeting_id)
    if picture is None:
        raise NotFound("the meeting must have a place of its own; got one without; bring one")
    return picture_answer(picture, if_none_match, "private, no-cache")


def picture_answer(data: bytes, if_none_match: str | None, kept: str) -> Response:
    """A JPEG that a browser may keep, as `kept` says; nothing where it has it."""
    tag = hashlib.sha256(data).hexdigest()
    headers = {"ETag": f'"{tag}"', "Cache-Control": kept}
    if if_none_match is not None and tag in if_none_match:
        return Response(status_code=304, headers=headers)
    return Response(data, media_type="image/jpeg", headers=headers)


def own_environment(own: PanoramaRow, picture_url: str) -> Environment:
    """What a host brought along."""
    light = Light.of(light_of(own))
    return Environment(name=own.name, title=_OWN_TITLE, picture_url=picture_url, light=light)


def _in_meeting(own: PanoramaRow) -> Environment:
    return own_environment(own, f"/v1/meetings/{own.meeting_id}/panorama")


async def _read_picture(request: Request) -> bytes:
    lift_body_limit(request)
    body = bytearray()
    async for chunk in request.stream():
        body += chunk
        if len(body) > LARGEST_PICTURE_BYTES:
            raise TooLarge(
                f"a panorama must have at most {LARGEST_PICTURE_BYTES} bytes; got more; shrink it",
            )
    return bytes(body)


def _choose(services: Services, caller: Principal, meeting_id: str, name: str) -> Environment:
    with services.unit_of_work() as unit:
        meeting = unit.meetings.get_for_change(meeting_id)
        require_host(meeting, caller)
        own = unit.meetings.panorama(meeting_id)
        back = own is not None and own.name == name
        place = _in_meeting(own) if own is not None and back else Environment.of(find_theme(name))
        meeting.environment = place.name
        unit.commit()
    return place


def _check_host(services: Services, caller: Principal, meeting_id: str) -> None:
    with services.reading() as unit:
        require_host(unit.meetings.get(meeting_id), caller)


def _bring(services: Services, caller: Principal, own: PanoramaRow) -> None:
    with services.unit_of_work() as unit:
        meeting = unit.meetings.get_for_change(own.meeting_id)
        require_host(meeting, caller)
        meeting.environment = own.name
        unit.meetings.set_panorama(own)
        unit.commit()
