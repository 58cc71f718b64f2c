"""Everything that can be set, in groups by what it is for.

The variable of each setting is its `validation_alias`; services.settings reads them all.
"""

from __future__ import annotations

import json
import socket
from pathlib import Path
from typing import Annotated, Any, Literal
from urllib.parse import urlsplit

from pydantic import BeforeValidator, Field, SecretStr, field_validator, model_validator
from pydantic_settings import BaseSettings, NoDecode, SettingsConfigDict

from services.logs import LogStyle

_SHORTEST_SECRET = 32
"""Characters; RFC 7518, section 3.2: an HS256 key must have at least 256 bits."""
_PLACEHOLDERS = ("change", "secret", "example", "placeholder", "password", "xxxx", "0000")
_WEB = ("http", "https")
_REPOSITORY = Path(__file__).resolve().parents[1]


def _list_of(value: object) -> object:
    if not isinstance(value, str):
        return value
    try:
        return json.loads(value)
    except ValueError as error:
        raise ValueError(f'must be a JSON list such as ["one", "two"]; got {value}') from error


Kind = Literal["capture", "train", "export"]
Texts = Annotated[list[str], NoDecode, BeforeValidator(_list_of)]


class Group(BaseSettings):
    """Settings that belong together; `validation_alias` is a setting's variable."""

    model_config = SettingsConfigDict(extra="ignore", frozen=True, validate_default=True)


class ServerSettings(Group):
    """Where the gateway listens, and what it serves beside the API."""

    host: str = Field(
        default="127.0.0.1", validation_alias="METANERF_HOST", description="Address to listen on."
    )
    port: int = Field(
        default=8000,
        ge=0,
        le=65535,
        validation_alias="METANERF_PORT",
        description="Port to listen on.",
    )
    public_url: str = Field(
        default="",
        validation_alias="METANERF_PUBLIC_URL",
        description="Address in links sent to others; empty: relative.",
    )
    gateway_url: str = Field(
        default="",
        validation_alias="METANERF_GATEWAY_URL",
        description="Address at which browsers reach this gateway and no other; empty: none.",
    )
    drain_s: float = Field(
        default=20.0,
        ge=0.0,
        validation_alias="METANERF_DRAIN_S",
        description="Longest time in which people go elsewhere when it is told to end, s.",
    )
    client_dir: Path = Field(
        default=_REPOSITORY / "client" / "dist",
        validation_alias="METANERF_CLIENT_DIR",
        description="Folder of the built page.",
    )
    allowed_origins: Texts = Field(
        default_factory=list,
        validation_alias="METANERF_ALLOWED_ORIGINS",
        description="Other origins whose pages may call the API (CORS).",
    )
    log_level: Literal["debug", "info", "warning", "error"] = Field(
        default="info", validation_alias="METANERF_LOG_LEVEL", description="How much is logged."
    )
    log_format: Literal["text", "json"] = Field(
        default="text",
        validation_alias="METANERF_LOG_FORMAT",
        description="Lines of the log for people, or as JSON with ids (services.logs).",
    )
    node_id: str = Field(
        default="",
        validation_alias="METANERF_NODE_ID",
        description="What this process is called in logs and figures; empty: its host's name.",
    )

    @property
    def log_style(self) -> LogStyle:
        """How a process of these settings logs."""
        return LogStyle(self.log_format, self.log_level, self.node_id or socket.gethostname())

    @field_validator("gateway_url")
    @classmethod
    def _scheme_and_host(cls, value: str) -> str:
        url = value.rstrip("/")
        parts = urlsplit(url)
        if url and (f"{parts.scheme}://{parts.netloc}" != url or parts.scheme not in _WEB):
            raise ValueError(
                f"must be scheme and host, such as https://one.meet.example.org; got {value!r}"
            )
        return url


class SecuritySettings(Group):
    """Who is let in."""

    environment: Literal["development", "production"] = Field(
        default="development",
        validation_alias="METANERF_ENVIRONMENT",
        description="In production, secrets must be given and not be placeholders.",
    )
    jwt_secret: SecretStr | None = Field(
        default=None,
        validation_alias="METANERF_JWT_SECRET",
        description="Signs tokens; made and kept in the data folder where it is not given.",
    )
    jwt_other_secrets: SecretStr | None = Field(
        default=None,
        validation_alias="METANERF_JWT_OTHER_SECRETS",
        description="Taken beside it: previous secrets, and the next; one a line, or by commas.",
    )
    token_lifetime_h: float = Field(
        default=24.0,
        gt=0.0,
        validation_alias="METANERF_TOKEN_LIFETIME_H",
        description="Life of a guest's token, h.",
    )
    open_access: bool = Field(
        default=False,
        validation_alias="METANERF_OPEN_ACCESS",
        description="Anybody may get a guest's token (the demo).",
    )
    metrics_token: SecretStr | None = Field(
        default=None,
        min_length=16,
        validation_alias="METANERF_METRICS_TOKEN",
        description="Bearer token of /metrics; without, only private addresses may read it.",
    )
    guest_tokens_per_minute: int = Field(
        default=60,
        ge=1,
        validation_alias="METANERF_GUEST_TOKENS_PER_MINUTE",
        description="Guests' tokens given to one address, and logins from it, a minute.",
    )

    @model_validator(mode="after")
    def _no_placeholder_secrets(self) -> SecuritySettings:
        if self.environment != "production":
            return self
        secret = self.jwt_secret.get_secret_value() if self.jwt_secret else ""
        for name, one in (
            ("jwt_secret", secret),
            *(("jwt_other_secrets", other) for other in self.other_jwt_secrets),
        ):
            if len(one) < _SHORTEST_SECRET or any(p in one.lower() for p in _PLACEHOLDERS):
                raise ValueError(
                    f"{name} must be {_SHORTEST_SECRET} or more random characters in production; "
                    f"got {len(one)} characters{' of a placeholder' if one else ''}; set "
                    f"METANERF_{name.upper()} to the output of `openssl rand -base64 48`"
                )
        return self

    @property
    def other_jwt_secrets(self) -> list[str]:
        """Each of `jwt_other_secrets`."""
        given = self.jwt_other_secrets.get_secret_value() if self.jwt_other_secrets else ""
        return [one.strip() for one in given.replace(",", "\n").splitlines() if one.strip()]


class FolderSettings(Group):
    """What is kept on this machine's disk."""

    data_dir: Path = Field(
        default=Path("metanerf-data"),
        validation_alias="METANERF_DATA_DIR",
        description="Folder of the database, objects, secret and scratch.",
    )

    @field_validator("data_dir", mode="before")
    @classmethod
    def _absolute(cls, value: Any) -> Path:
        return Path(value or "metanerf-data").expanduser().resolve()

    @property
    def scratch_dir(self) -> Path:
        """Where jobs and uploads keep what is under way."""
        return self.data_dir / "scratch"

    @property
    def cache_dir(self) -> Path:
        """Where networks that were fetched are kept."""
        return self.data_dir / "cache"


class DatabaseSettings(Group):
    """Rows."""

    url: str = Field(
        default="",
        validation_alias="METANERF_DATABASE_URL",
        description="SQLAlchemy URL; empty: an SQLite file in the data folder.",
    )


class ObjectSettings(Group):
    """Bytes: clips, sequences, models."""

    store_url: str = Field(
        default="",
        validation_alias="METANERF_OBJECT_STORE_URL",
        description="file:///folder or s3://bucket/prefix; empty: a folder in the data folder.",
    )
    s3_endpoint_url: str | None = Field(
        default=None,
        validation_alias="METANERF_S3_ENDPOINT_URL",
        description="Address of an S3 store not Amazon's.",
    )
    s3_public_url: str | None = Field(
        default=None,
        validation_alias="METANERF_S3_PUBLIC_URL",
        description="Address of the S3 store as clients reach it: models are then read from there.",
    )
    s3_region: str = Field(
        default="us-east-1",
        validation_alias="METANERF_S3_REGION",
        description="Region of the S3 store.",
    )
    s3_access_key_id: str | None = Field(
        default=None,
        validation_alias="METANERF_S3_ACCESS_KEY_ID",
        description="Key id of the S3 store.",
    )
    s3_secret_access_key: SecretStr | None = Field(
        default=None,
        validation_alias="METANERF_S3_SECRET_ACCESS_KEY",
        description="Secret of the S3 store.",
    )


class EventSettings(Group):
    """Wake-ups between processes."""

    redis_url: str | None = Field(
        default=None,
        validation_alias="METANERF_REDIS_URL",
        description="Redis for wake-ups, progress and shared counts of requests; without, the "
        "database is polled, and each gateway counts for itself.",
    )


class UploadSettings(Group):
    """Clips that are sent."""

    max_bytes: int = Field(
        default=512 * 1024 * 1024,
        ge=1,
        validation_alias="METANERF_MAX_UPLOAD_BYTES",
        description="Largest clip or archive taken, bytes.",
    )


class ModelSettings(Group):
    """Models of people, and views of them by REST."""

    max_cached: int = Field(
        default=8,
        ge=1,
        validation_alias="METANERF_CACHED_MODELS",
        description="Models kept in memory.",
    )
    max_view_px: int = Field(
        default=2048,
        ge=16,
        validation_alias="METANERF_MAX_VIEW_PX",
        description="Longest side of a rendered view, px.",
    )


class RecordingSettings(Group):
    """Recordings of meetings."""

    max_duration_s: float = Field(
        default=7200.0,
        gt=0.0,
        validation_alias="METANERF_MAX_RECORDING_S",
        description="Longest recording of a meeting, s.",
    )
    max_bytes: int = Field(
        default=512 * 1024 * 1024,
        ge=1,
        validation_alias="METANERF_MAX_RECORDING_BYTES",
        description="Largest recording of a meeting, bytes.",
    )


class JobSettings(Group):
    """Captures, trainings and exports, and the workers that run them."""

    embedded_worker: bool = Field(
        default=True,
        validation_alias="METANERF_EMBEDDED_WORKER",
        description="The gateway runs jobs itself, as children.",
    )
    worker_kinds: Annotated[list[Kind], NoDecode, BeforeValidator(_list_of)] = Field(
        default_factory=lambda: ["capture", "train", "export"],
        validation_alias="METANERF_WORKER_KINDS",
        description="Kinds of jobs a worker takes.",
    )
    worker_slots: int = Field(
        default=1,
        ge=1,
        validation_alias="METANERF_WORKER_SLOTS",
        description="Jobs a worker runs at once.",
    )
    niceness: int = Field(
        default=10,
        ge=0,
        le=19,
        validation_alias="METANERF_JOB_NICENESS",
        description="Niceness of job processes, so that meetings come first.",
    )
    heartbeat_timeout_s: float = Field(
        default=30.0,
        gt=0.0,
        validation_alias="METANERF_JOB_HEARTBEAT_TIMEOUT_S",
        description="A job silent for so long is taken from its worker, s.",
    )
    stop_grace_s: float = Field(
        default=15.0,
        gt=0.0,
        validation_alias="METANERF_JOB_STOP_GRACE_S",
        description="Time a stopped job has to leave its checkpoint, s.",
    )
    max_crashes: int = Field(
        default=3,
        ge=1,
        validation_alias="METANERF_JOB_CRASHES",
        description="Crashes after which a job fails.",
    )
    metrics_port: int = Field(
        default=0,
        ge=0,
        le=65535,
        validation_alias="METANERF_WORKER_METRICS_PORT",
        description="Port of a worker's own /metrics, at METANERF_HOST; 0: none.",
    )
    max_budget_s: float = Field(
        default=3600.0,
        gt=0.0,
        validation_alias="METANERF_MAX_BUDGET_S",
        description="Longest training on request, s.",
    )
