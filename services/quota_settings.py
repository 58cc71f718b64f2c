"""Settings of what one account, and one address, may take, and how long things are kept."""

from __future__ import annotations

from pydantic import Field

from services.setting_groups import Group


class QuotaSettings(Group):
    """What one account may keep, and how often it may ask."""

    bytes: int = Field(
        default=20 << 30,
        ge=1,
        validation_alias="METANERF_ACCOUNT_BYTES",
        description="Bytes kept of one account's people: clips, models, recordings.",
    )
    people: int = Field(
        default=100,
        ge=1,
        validation_alias="METANERF_ACCOUNT_PEOPLE",
        description="People of one account.",
    )
    sequences: int = Field(
        default=200,
        ge=1,
        validation_alias="METANERF_ACCOUNT_SEQUENCES",
        description="Clips of one account.",
    )
    models: int = Field(
        default=200,
        ge=1,
        validation_alias="METANERF_ACCOUNT_MODELS",
        description="Models of one account, with trainings under way.",
    )
    requests_per_minute: int = Field(
        default=3000,
        ge=1,
        validation_alias="METANERF_REQUESTS_PER_MINUTE",
        description="Requests of one account that need a token, a minute.",
    )
    requests_per_address: int = Field(
        default=12_000,
        ge=1,
        validation_alias="METANERF_REQUESTS_PER_ADDRESS",
        description="Requests from one address that need a token, good or not, a minute.",
    )


class RetentionSettings(Group):
    """How long things are kept that nobody deletes."""

    recording_days: float | None = Field(
        default=None,
        gt=0.0,
        validation_alias="METANERF_KEEP_RECORDINGS_DAYS",
        description="Days after its end that a recording is kept; unset: until it is deleted.",
    )
    clip_days: float | None = Field(
        default=None,
        gt=0.0,
        validation_alias="METANERF_KEEP_CLIPS_DAYS",
        description="Days that a clip and its frames are kept; unset: until it is deleted.",
    )
    audit_days: float = Field(
        default=365.0,
        gt=0.0,
        validation_alias="METANERF_KEEP_AUDIT_DAYS",
        description="Days that events of the audit log are kept.",
    )
