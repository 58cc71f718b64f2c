"""What tests of captures share."""

from __future__ import annotations

import pytest

from capture.fitting import fit


@pytest.fixture
def fewer_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fits take 270 steps instead of 740: enough for known people, who hold still or nearly so."""
    monkeypatch.setattr(fit, "LANDMARK_STEPS", 150)
    monkeypatch.setattr(fit, "SILHOUETTE_STEPS", 60)
