"""Settings of a Ray cluster: where it is, and what a job or a renderer takes of it."""

from __future__ import annotations

import json
from typing import Annotated

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, field_validator
from pydantic_settings import NoDecode

from services.setting_groups import Group

_GIB = 1024**3


class TaskResources(BaseModel):
    """What Ray keeps for one job or renderer while it runs, by Ray's own names."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    num_cpus: float = Field(default=1.0, gt=0.0)
    num_gpus: float = Field(default=0.0, ge=0.0)
    memory: int = Field(default=2 * _GIB, ge=0)
    """Bytes."""

    @field_validator("num_gpus")
    @classmethod
    def _shared_or_whole(cls, value: float) -> float:
        if value > 1.0 and not value.is_integer():
            raise ValueError(f"num_gpus must be whole above 1; got {value:g}; round it up")
        return value


def _object_of(value: object) -> object:
    if not isinstance(value, str):
        return value
    try:
        return json.loads(value)
    except ValueError as error:
        raise ValueError(
            f'must be a JSON object such as {{"num_cpus": 2, "num_gpus": 0.5}}; got {value}'
        ) from error


Resources = Annotated[TaskResources, NoDecode, BeforeValidator(_object_of)]


class ClusterSettings(Group):
    """A Ray cluster that jobs run on, or renderers."""

    ray_address: str = Field(
        default="127.0.0.1:6379",
        pattern=r"^[^:/]+:\d+$",
        validation_alias="METANERF_RAY_ADDRESS",
        description="HOST:PORT of the head of the Ray cluster; this machine must be a node of it.",
    )
    capture_resources: Resources = Field(
        default_factory=lambda: TaskResources(memory=4 * _GIB),
        validation_alias="METANERF_CAPTURE_RESOURCES",
        description="What a capture takes of the cluster: num_cpus, num_gpus, memory in bytes.",
    )
    train_resources: Resources = Field(
        default_factory=TaskResources,
        validation_alias="METANERF_TRAIN_RESOURCES",
        description="What a training takes of it.",
    )
    export_resources: Resources = Field(
        default_factory=TaskResources,
        validation_alias="METANERF_EXPORT_RESOURCES",
        description="What the export of a video takes of it.",
    )
    renderer_resources: Resources = Field(
        default_factory=lambda: TaskResources(num_cpus=0.5, memory=_GIB),
        validation_alias="METANERF_RENDERER_RESOURCES",
        description="What a renderer takes of it; see METANERF_RENDERERS.",
    )

    def resources(self, kind: str) -> TaskResources:
        """What a job of this kind takes."""
        return getattr(self, f"{kind}_resources")
