"""An error as it is told: RFC 9457's problem details, over HTTP and on the control channel."""

from __future__ import annotations

from pydantic import BaseModel, Field


class Problem(BaseModel):
    """What went wrong, for people and programs."""

    type: str = Field(description="What kind of problem.", examples=["urn:metanerf:not-found"])
    title: str = Field(description="The kind in words.", examples=["Not found"])
    status: int = Field(description="The HTTP status.", examples=[404])
    detail: str = Field(
        description="The rule, the value received, how to mend it.",
        examples=["id must be that of a person; got 'x'; list them to see what exists"],
    )
