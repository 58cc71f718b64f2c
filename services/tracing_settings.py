"""Settings of traces: where they are sent."""

from __future__ import annotations

from urllib.parse import urlsplit

from pydantic import Field, field_validator

from services.setting_groups import Group


class TracingSettings(Group):
    """Traces of requests, jobs and pictures (services.tracing)."""

    endpoint: str = Field(
        default="",
        validation_alias="METANERF_OTLP_ENDPOINT",
        description="Who takes traces by OTLP over HTTP, such as http://127.0.0.1:4318; "
        "empty: nothing is traced.",
    )

    @field_validator("endpoint")
    @classmethod
    def _address(cls, value: str) -> str:
        parts = urlsplit(value)
        if value and (parts.scheme not in ("http", "https") or not parts.netloc):
            raise ValueError(f"must be an address such as http://127.0.0.1:4318; got {value!r}")
        return value.rstrip("/")
