"""Everything that can be set, in one flat place: `METANERF_NAME` in the environment sets `name`.

Built once at the entry point and passed down; nothing else reads the environment.
"""

from __future__ import annotations

import json
import os
import secrets
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from pydantic import Field, SecretStr, ValidationError, model_validator
from pydantic_settings import BaseSettings, SettingsConfigDict

from scene.errors import InvalidInput

if TYPE_CHECKING:
    from capture.detection.network_files import LandmarkNetwork, NetworkSource

_PREFIX = "METANERF_"
_SHORTEST_SECRET = 32
"""Characters; RFC 7518, section 3.2: an HS256 key must have at least 256 bits."""
_PLACEHOLDERS = ("change", "secret", "example", "placeholder", "password", "xxxx", "0000")
_REPOSITORY = Path(__file__).resolve().parents[1]


class Settings(BaseSettings):
    """Settings of every process: gateway, worker and command line."""

    model_config = SettingsConfigDict(env_prefix=_PREFIX, extra="ignore", frozen=True)

    environment: Literal["development", "production"] = Field(
        default="development",
        description="In production, secrets must be given and not be placeholders.",
    )
    data_dir: Path = Field(
        default=Path("metanerf-data"),
        description="Folder of the database, objects, secret and scratch.",
    )
    database_url: str = Field(
        default="", description="SQLAlchemy URL; empty: an SQLite file in data_dir."
    )
    object_store_url: str = Field(
        default="", description="file:///folder or s3://bucket/prefix; empty: a folder in data_dir."
    )
    s3_endpoint_url: str | None = Field(
        default=None, description="Address of an S3 store not Amazon's."
    )
    s3_region: str = Field(default="us-east-1", description="Region of the S3 store.")
    s3_access_key_id: str | None = Field(default=None, description="Key id of the S3 store.")
    s3_secret_access_key: SecretStr | None = Field(
        default=None, description="Secret of the S3 store."
    )
    redis_url: str | None = Field(
        default=None,
        description="Redis for wake-ups and progress; without, the database is polled.",
    )

    host: str = Field(default="127.0.0.1", description="Address to listen on.")
    port: int = Field(default=8000, ge=0, le=65535, description="Port to listen on.")
    public_url: str = Field(
        default="", description="Address in links sent to others; empty: relative."
    )
    client_dir: Path = Field(
        default=_REPOSITORY / "client" / "dist", description="Folder of the built page."
    )
    allowed_origins: list[str] = Field(
        default_factory=list, description="Other origins whose pages may call the API (CORS)."
    )

    jwt_secret: SecretStr | None = Field(
        default=None, description="Signs tokens; made and kept in data_dir where it is not given."
    )
    token_lifetime_h: float = Field(default=24.0, gt=0.0, description="Life of a guest's token, h.")
    open_access: bool = Field(
        default=False, description="Anybody may get a guest's token (the demo)."
    )
    guest_tokens_per_minute: int = Field(
        default=60, ge=1, description="Guests' tokens given to one address, a minute."
    )

    max_upload_bytes: int = Field(
        default=512 * 1024 * 1024, ge=1, description="Largest clip or archive taken, bytes."
    )
    max_view_px: int = Field(
        default=2048, ge=16, description="Longest side of a rendered view, px."
    )
    cached_models: int = Field(default=8, ge=1, description="Models kept in memory.")
    max_viewers: int = Field(
        default=8, ge=1, description="Viewers served live at once by this process."
    )
    stamp_pictures: bool = Field(
        default=False,
        description="Show in each picture's corner when it was captured, to measure latency.",
    )
    max_voices: int = Field(
        default=200, ge=1, description="Voice connections served at once by this process."
    )
    max_recording_s: float = Field(
        default=7200.0, gt=0.0, description="Longest recording of a meeting, s."
    )
    max_recording_bytes: int = Field(
        default=512 * 1024 * 1024, ge=1, description="Largest recording of a meeting, bytes."
    )
    ice_servers: list[str] = Field(
        default_factory=list, description="STUN and TURN addresses given to browsers."
    )

    embedded_worker: bool = Field(
        default=True, description="The gateway runs jobs itself, as children."
    )
    worker_kinds: list[Literal["capture", "train", "export"]] = Field(
        default_factory=lambda: ["capture", "train", "export"],
        description="Kinds of jobs a worker takes.",
    )
    worker_slots: int = Field(default=1, ge=1, description="Jobs a worker runs at once.")
    job_niceness: int = Field(
        default=10,
        ge=0,
        le=19,
        description="Niceness of job processes, so that meetings come first.",
    )
    job_heartbeat_timeout_s: float = Field(
        default=30.0, gt=0.0, description="A job silent for so long is taken from its worker, s."
    )
    job_stop_grace_s: float = Field(
        default=15.0, gt=0.0, description="Time a stopped job has to leave its checkpoint, s."
    )
    job_crashes: int = Field(default=3, ge=1, description="Crashes after which a job fails.")
    max_budget_s: float = Field(
        default=3600.0, gt=0.0, description="Longest training on request, s."
    )
    sweep_interval_s: float = Field(default=3600.0, gt=0.0, description="Time between sweeps, s.")

    pose_model: Path | None = Field(default=None, description="The landmark model's file.")
    pose_model_url: str | None = Field(
        default=None, description="Where to fetch the landmark model."
    )
    pose_model_sha256: str | None = Field(default=None, description="Its sha256.")
    face_model: Path | None = Field(
        default=None, description="The face landmarker's file, for expressions."
    )
    face_model_url: str | None = Field(default=None, description="Where to fetch that.")
    face_model_sha256: str | None = Field(default=None, description="Its sha256.")
    hand_model: Path | None = Field(
        default=None, description="The hand landmarker's file, for expressions."
    )
    hand_model_url: str | None = Field(default=None, description="Where to fetch that.")
    hand_model_sha256: str | None = Field(default=None, description="Its sha256.")
    lpips_backbone: Path | None = Field(
        default=None,
        description="Weights (.pth) behind LPIPS; VGG-16 is fetched once where none are named.",
    )
    lpips_backbone_url: str | None = Field(default=None, description="Where to fetch VGG-16.")

    log_level: Literal["debug", "info", "warning", "error"] = Field(
        default="info", description="How much is logged."
    )

    @model_validator(mode="before")
    @classmethod
    def _default_places(cls, values: dict[str, Any]) -> dict[str, Any]:
        folder = Path(values.get("data_dir") or "metanerf-data").expanduser().resolve()
        values["data_dir"] = folder
        values["database_url"] = values.get("database_url") or f"sqlite:///{folder}/metanerf.db"
        values["object_store_url"] = values.get("object_store_url") or f"file://{folder}/objects"
        return values

    @model_validator(mode="after")
    def _no_placeholder_secrets(self) -> Settings:
        if self.environment != "production":
            return self
        secret = self.jwt_secret.get_secret_value() if self.jwt_secret else ""
        if len(secret) < _SHORTEST_SECRET or any(p in secret.lower() for p in _PLACEHOLDERS):
            raise ValueError(
                f"jwt_secret must be {_SHORTEST_SECRET} or more random characters in production; "
                f"got {len(secret)} characters{' of a placeholder' if secret else ''}; set "
                f"{_PREFIX}JWT_SECRET to the output of `openssl rand -base64 48`"
            )
        return self

    @property
    def scratch_dir(self) -> Path:
        """Where jobs and uploads keep what is under way."""
        return self.data_dir / "scratch"

    def pose_model_source(self) -> NetworkSource:
        """Where captures and pages find the landmark model."""
        from capture.detection.network_files import POSE_MODEL

        return self._model_source(POSE_MODEL)

    def face_model_source(self) -> NetworkSource:
        """Where the face landmarker is found."""
        from capture.detection.network_files import FACE_MODEL

        return self._model_source(FACE_MODEL)

    def hand_model_source(self) -> NetworkSource:
        """Where the hand landmarker is found."""
        from capture.detection.network_files import HAND_MODEL

        return self._model_source(HAND_MODEL)

    def _model_source(self, model: LandmarkNetwork) -> NetworkSource:
        from capture.detection.network_files import NetworkSource

        path, url, sha256 = (
            getattr(self, f"{model.name}_model{part}") for part in ("", "_url", "_sha256")
        )
        return NetworkSource(path, url, sha256, self.data_dir / "cache", model)

    def signing_key(self) -> str:
        """The secret that signs tokens, made once where it is not set."""
        if self.jwt_secret is not None:
            return self.jwt_secret.get_secret_value()
        return _kept_secret(self.data_dir / "jwt_secret")

    def child_environment(self) -> dict[str, str]:
        """These settings as a child process reads them."""
        values = {}
        for name in type(self).model_fields:
            value = getattr(self, name)
            if value is None:
                continue
            if isinstance(value, SecretStr):
                value = value.get_secret_value()
            text = json.dumps(value) if isinstance(value, list) else str(value)
            values[f"{_PREFIX}{name.upper()}"] = text
        ours = {name for name in os.environ if name.upper().startswith(_PREFIX)}
        return {k: v for k, v in os.environ.items() if k not in ours} | values


def load_settings(**values: Any) -> Settings:
    """Settings from the environment, `values` first. Raises InvalidInput, one line a fault."""
    try:
        return Settings(**values)
    except ValidationError as error:
        faults = [
            f"{'.'.join(map(str, fault['loc'])) or 'settings'}: {fault['msg']}"
            for fault in error.errors(include_url=False)
        ]
        raise InvalidInput("settings must be valid; got " + "; ".join(faults)) from error


def _kept_secret(path: Path) -> str:
    path.parent.mkdir(parents=True, exist_ok=True)
    made = path.with_name(f"{path.name}.{secrets.token_hex(8)}")
    try:
        return path.read_text()
    except FileNotFoundError:
        descriptor = os.open(made, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with os.fdopen(descriptor, "w") as file:
            file.write(secrets.token_urlsafe(48))
        try:
            os.link(made, path)  # of two processes that start together, one wins
        except FileExistsError:
            pass
        finally:
            made.unlink()
        return path.read_text()
