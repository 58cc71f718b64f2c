"""What travels as JSON, and how rows become it."""

from __future__ import annotations

from datetime import datetime
from typing import Any

from pydantic import AwareDatetime, BaseModel, ConfigDict, Field

from capture.body.model import HEIGHTS_M
from db.models import (
    USUAL_PURPOSES,
    ConsentState,
    JobKind,
    JobRow,
    JobState,
    ModelRow,
    PersonRow,
    Purpose,
    SequenceKind,
    SequenceRow,
    SequenceState,
)
from services.names import Name
from services.problem_details import Problem


class Body(BaseModel):
    """A request's body: a field that is not known is a mistake, and said so."""

    model_config = ConfigDict(extra="forbid")


class NewConsent(Body):
    """What somebody's model may be used for, and until when."""

    purposes: list[Purpose] = Field(
        max_length=len(Purpose),
        description="`meetings`: it is shown in meetings. `recordings`: recordings hold what they "
        "move, say and write, once they agreed to each. `driving`: others in a meeting may drive "
        "it, not the owner alone. `learning`: it learns from pictures of live look that the owner "
        "kept. Empty: nobody but the owner sees it.",
    )
    until: AwareDatetime | None = Field(
        default=None, description="From then on it holds no longer; empty: no end is set."
    )


class Consent(BaseModel):
    """What somebody's model may be used for, and whether that holds now."""

    purposes: list[Purpose]
    until: datetime | None = Field(description="Empty: no end is set.")
    state: ConsentState = Field(
        description="Only while it is given, the model is shown, recorded or driven by others."
    )
    revoked_at: datetime | None

    @classmethod
    def of(cls, row: PersonRow, now: datetime) -> Consent:
        return cls(
            purposes=[Purpose(one) for one in row.consent_purposes],
            until=row.consent_until,
            state=row.consent_state(now),
            revoked_at=row.consent_revoked_at,
        )


class NewPerson(Body):
    """Somebody to enrol."""

    name: Name = Field(examples=["Ada"])
    height_m: float | None = Field(
        default=None,
        ge=HEIGHTS_M[0],
        le=HEIGHTS_M[1],
        description="Barefoot; empty: guessed from each clip, and with it their size.",
        examples=[1.78],
    )
    consent: NewConsent = Field(
        default=NewConsent(purposes=list(USUAL_PURPOSES)),
        description="What their model may be used for, and until when.",
    )


class Person(BaseModel):
    """A person who is, or will be, modelled."""

    id: str
    name: str
    created_at: datetime
    height_m: float | None = Field(
        description="Barefoot, as it was given when the person was made."
    )
    consent: Consent

    @classmethod
    def of(cls, row: PersonRow, now: datetime) -> Person:
        return cls(
            id=row.id,
            name=row.name,
            created_at=row.created_at,
            height_m=row.height_m,
            consent=Consent.of(row, now),
        )


class Sequence(BaseModel):
    """A clip, and the state of its processing."""

    id: str
    person_id: str
    kind: SequenceKind
    state: SequenceState
    created_at: datetime
    sha256: str = Field(description="Of the file that was uploaded.")
    frames: int | None
    frames_per_second: float | None
    duration_s: float | None
    quality: dict[str, Any] | None = Field(description="What capture says about the clip.")
    thumbnail_url: str | None
    job_id: str | None = Field(description="Its capture.")

    @classmethod
    def of(cls, row: SequenceRow, capture: JobRow | None) -> Sequence:
        return cls(
            id=row.id,
            person_id=row.person_id,
            kind=row.kind,
            state=row.state,
            created_at=row.created_at,
            sha256=row.source_sha256,
            frames=row.frames,
            frames_per_second=row.frames_per_second,
            duration_s=row.duration_s,
            quality=row.quality,
            thumbnail_url=f"/v1/sequences/{row.id}/thumbnail" if row.thumbnail_sha256 else None,
            job_id=capture.id if capture else None,
        )


class ModelFile(BaseModel):
    """One file of a model."""

    name: str
    bytes: int
    url: str


class Model(BaseModel):
    """A trained model."""

    id: str
    person_id: str
    sequence_id: str | None
    preset: str
    created_at: datetime
    bytes: int = Field(description="Of the weights.")
    sha256: str = Field(description="Of the weights.")
    metrics: dict[str, Any]
    files: list[ModelFile]

    @classmethod
    def of(cls, row: ModelRow) -> Model:
        weights = next(file for file in row.files if file.name == "model.safetensors")
        return cls(
            id=row.id,
            person_id=row.person_id,
            sequence_id=row.sequence_id,
            preset=row.preset,
            created_at=row.created_at,
            bytes=weights.bytes,
            sha256=weights.sha256,
            metrics=row.metrics,
            files=[
                ModelFile(
                    name=file.name, bytes=file.bytes, url=f"/v1/models/{row.id}/files/{file.name}"
                )
                for file in row.files
            ],
        )


class PersonInFull(Person):
    """A person with all that was made of theirs."""

    sequences: list[Sequence]
    models: list[Model]


class ListedPerson(Person):
    """A person of the token's account, or one of the demo that every guest may use."""

    mine: bool = Field(
        description="Whether the token's account owns them, and may change and erase them."
    )


class People(BaseModel):
    """A list of persons."""

    items: list[ListedPerson]


class Models(BaseModel):
    """A list of models."""

    items: list[Model]


class Erased(BaseModel):
    """The proof that a person is gone."""

    deleted_rows: dict[str, int] = Field(description="By table.")
    deleted_objects: int
    remaining: int = Field(description="Rows and objects counted afterwards: 0.")


class NewUpload(Body):
    """A file that will be sent in pieces."""

    filename: str = Field(min_length=1, max_length=255, examples=["clip.mp4"])
    size: int = Field(ge=1, description="Bytes.")
    sha256: str = Field(pattern="^[0-9a-f]{64}$", description="Of the whole file, hex.")


class Upload(BaseModel):
    """An upload that is under way."""

    id: str
    offset: int = Field(description="Bytes received so far; the next piece begins here.")


class ExistingSequence(BaseModel):
    """The same bytes were uploaded before: the sequence that was made of them."""

    sequence: Sequence


class NewModel(Body):
    """What to train."""

    preset: str = Field(default="splats", examples=["splats", "fast"])
    budget_s: float = Field(
        default=60.0, gt=0.0, allow_inf_nan=False, description="Training time, s."
    )
    seed: int = Field(default=0, ge=0, le=2**31 - 1)
    improves: str | None = Field(
        default=None,
        description="A model of the same person to go on from (splats); the new one takes its "
        "place, in meetings too.",
    )
    model_only: bool = Field(
        default=False,
        description="Delete the clip, its frames and its pictures once the model is trained.",
    )


class Job(BaseModel):
    """A capture, training or export, and its progress."""

    id: str
    kind: JobKind
    state: JobState
    progress: float = Field(description="0 to 1.")
    message: str
    has_preview: bool
    sequence_id: str | None
    model_id: str | None = Field(
        description="What was trained; until the job ends, the best there is so far: while its "
        "clip is being captured, a first likeness."
    )
    error: Problem | None = Field(
        description="Why it failed; of a queued job, why it waits for room on a full disk."
    )
    retry_at: datetime | None = Field(
        description="When a job that waits for room is tried again, if nobody resumes it before."
    )

    @classmethod
    def of(cls, row: JobRow) -> Job:
        return cls(
            id=row.id,
            kind=row.kind,
            state=row.state,
            progress=row.progress,
            message=row.message,
            has_preview=row.preview_version > 0,
            sequence_id=row.sequence_id,
            model_id=row.model_id,
            error=Problem(**row.error) if row.error else None,
            retry_at=row.not_before,
        )


class KeepFrames(Body):
    """Whether pictures of live look are to be kept."""

    on: bool


class KeptFrame(BaseModel):
    """One picture that is kept."""

    picture: str = Field(description="A small PNG, as a data URL.")
    sides: list[str] = Field(description="That the model had not seen, in words.")


class KeptFrames(BaseModel):
    """Pictures of live look that are kept until their owner says what becomes of them."""

    on: bool
    frames: list[KeptFrame]


class Access(BaseModel):
    """How this server lets people in who were not invited."""

    guests: bool
    """Anybody may come as a guest."""
    login: bool
    """Whom its provider knows may log in."""


class LoggedIn(BaseModel):
    """A token for the page of somebody who has logged in."""

    token: str
    expires_at: datetime
    name: str
    """As the provider calls them; empty where it does not say."""


class Guest(BaseModel):
    """A token for the page."""

    token: str
    expires_at: datetime
