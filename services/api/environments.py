"""Environments: the places a meeting can be held in, and their light."""

from __future__ import annotations

import hashlib
from typing import Annotated

from fastapi import APIRouter, Header, Request, Response
from fastapi.concurrency import run_in_threadpool
from pydantic import BaseModel, Field

from db.models import MeetingRow, Role, Standing
from services.api.cast import tell_cast_changed
from services.api.shapes import Body
from services.auth import Joiner, Principal
from services.container import Provided, Services
from services.environments import Theme, find_theme, themes
from services.problems import PROBLEMS, ProblemError

router = APIRouter(prefix="/v1", tags=["environments"], responses=PROBLEMS)


class Light(BaseModel):
    """What falls on performers, linear RGB; 1 is what makes a white surface white."""

    harmonics: list[tuple[float, float, float]] = Field(
        description="Irradiance over pi: coefficients of the 9 real spherical harmonics to order 2."
    )
    key_direction: tuple[float, float, float] = Field(description="Unit, towards the light; world.")
    key_colour: tuple[float, float, float]


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
        light = None
        if theme.lighting is not None:
            light = Light(
                harmonics=theme.lighting.harmonics.tolist(),
                key_direction=tuple(theme.lighting.key_direction.tolist()),
                key_colour=tuple(theme.lighting.key_colour.tolist()),
            )
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
    """Every place that a meeting can be held in, the plain studio first."""
    return Environments(items=[Environment.of(theme) for theme in themes().values()])


@router.get(
    "/environments/{name}/picture",
    summary="See an environment",
    response_class=Response,
    responses={200: {"content": {"image/jpeg": {}}}, 304: {"description": "Kept."}},
)
def read_picture(name: str, if_none_match: Annotated[str | None, Header()] = None) -> Response:
    """The place all round: an equirectangular picture. It is public."""
    theme = find_theme(name)
    if theme.picture is None:
        raise ProblemError(
            404, "not-found", f"environment must be one with a picture; got {name!r}, a plain room"
        )
    data = theme.picture.read_bytes()
    tag = hashlib.sha256(data).hexdigest()
    headers = {"ETag": f'"{tag}"', "Cache-Control": "public, max-age=86400"}
    if if_none_match is not None and tag in if_none_match:
        return Response(status_code=304, headers=headers)
    return Response(data, media_type="image/jpeg", headers=headers)


@router.put("/meetings/{meeting_id}/environment", summary="Choose where a meeting is held")
async def choose_environment(
    meeting_id: str, body: Place, request: Request, services: Provided, caller: Joiner
) -> Environment:
    """Move a meeting to another place, at once for everybody who looks. The host may."""
    caller.require_meeting(meeting_id)
    theme = find_theme(body.name)
    await run_in_threadpool(_choose, services, caller, meeting_id, theme)
    await tell_cast_changed(request, meeting_id)
    return Environment.of(theme)


def _choose(services: Services, caller: Principal, meeting_id: str, theme: Theme) -> None:
    with services.unit_of_work() as unit:
        meeting = unit.meetings.get_for_change(meeting_id)
        _require_host(meeting, caller)
        meeting.environment = theme.name
        unit.commit()


def _require_host(meeting: MeetingRow, caller: Principal) -> None:
    """Raise a 403 problem unless the caller sits as its host, or opened the meeting."""
    if caller.participant_id is None:
        caller.require_account(meeting.account)
        may = "write" in caller.scopes
    else:
        may = any(
            one.id == caller.participant_id
            and one.role is Role.HOST
            and one.standing is Standing.ADMITTED
            for one in meeting.participants
        )
    if not may:
        raise ProblemError(
            403,
            "not-host",
            "the token must be of the meeting's host; got one of somebody else; ask the host",
        )
