"""The row of a person, to whom everything else belongs, and what their likeness may be used for."""

from __future__ import annotations

from datetime import datetime
from enum import StrEnum

from sqlalchemy import JSON, String
from sqlalchemy.orm import Mapped, mapped_column

from db.base import Base, Id, new_id


class Purpose(StrEnum):
    """What a person's model may be used for, beside its owner's own pictures of it."""

    MEETINGS = "meetings"
    """It is shown in meetings."""
    RECORDINGS = "recordings"
    """Recordings hold what they move, say and write, once they agreed to each."""
    DRIVING = "driving"
    """Whoever is in a meeting with it may drive it; without, its owner alone."""
    LEARNING = "learning"
    """It learns from pictures of live look that its owner has chosen to keep."""


class ConsentState(StrEnum):
    """Whether a consent holds."""

    GIVEN = "given"
    ENDED = "ended"
    """Its last moment has passed."""
    REVOKED = "revoked"


USUAL_PURPOSES = (Purpose.MEETINGS, Purpose.RECORDINGS)
"""Of whoever says nothing else."""


class PersonRow(Base):
    """Somebody who is, or will be, met."""

    __tablename__ = "person"

    id: Mapped[str] = mapped_column(Id, primary_key=True, default=new_id)
    account: Mapped[str] = mapped_column(String(120), index=True)
    """Whose person this is: the subject of the token that made it."""
    name: Mapped[str] = mapped_column(String(120))
    created_at: Mapped[datetime]
    height_m: Mapped[float | None]
    """Barefoot, as they told it; None is guessed from each clip."""
    consent_purposes: Mapped[list[str]] = mapped_column(JSON, default=lambda: list(USUAL_PURPOSES))
    """Values of `Purpose` to which they have consented; see `consents_to`."""
    consent_until: Mapped[datetime | None]
    """From then on the consent holds no longer; None: no end is set."""
    consent_revoked_at: Mapped[datetime | None]
    """Since when it is revoked; None: it is not."""

    def consents_to(self, purpose: Purpose, now: datetime) -> bool:
        """Whether this person's consent covers `purpose` at `now`."""
        return self.consent_state(now) is ConsentState.GIVEN and purpose in self.consent_purposes

    def consent_state(self, now: datetime) -> ConsentState:
        """Whether their consent holds at `now`."""
        if self.consent_revoked_at is not None:
            return ConsentState.REVOKED
        if self.consent_until is not None and now >= self.consent_until:
            return ConsentState.ENDED
        return ConsentState.GIVEN
