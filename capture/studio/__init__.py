"""The studio: synthetic performers with exact truth, one training camera, a ring for tests."""

from capture.studio.footage import Footage
from capture.studio.sequence import make_sequence

__all__ = ["Footage", "make_sequence"]
