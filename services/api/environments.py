"""Environments: the places a meeting can be held in, and their light."""

from __future__ import annotations

import hashlib
from typing import Annotated

from fastapi import APIRouter, Header, Response
from pydantic import BaseModel, Field

from services.auth import Joiner
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
