"""Generated parts of hand-written pages."""

from __future__ import annotations

import pytest

from benchmarks.reporting.markdown import replaced
from scene.errors import InvalidInput


def test_only_what_lies_between_the_markers_changes():
    page = "before\n<!-- x:begin -->\nold\n<!-- x:end -->\nafter\n"
    for _ in range(2):
        page = replaced(page, "x", "new")
        assert page == "before\n<!-- x:begin -->\n\nnew\n\n<!-- x:end -->\nafter\n"
    with pytest.raises(InvalidInput, match="must hold <!-- y:begin -->"):
        replaced(page, "y", "new")
