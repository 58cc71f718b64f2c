"""Panoramas are read as linear radiance, or refused in words."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from capture.errors import CaptureError
from capture.sources.panorama import read_panorama
from scene import InvalidInput


def test_radiance_is_read_as_it_was_written(tmp_path):
    light = np.random.default_rng(0).uniform(0.1, 1.0, (8, 16, 3)).astype(np.float32)
    light[2, 5] = [900.0, 700.0, 500.0]
    cv2.imwrite(str(tmp_path / "place.hdr"), light[..., ::-1])
    read = read_panorama(tmp_path / "place.hdr")
    # one exponent a pixel, eight bits a channel
    np.testing.assert_allclose(read, light, atol=0.005 * light.max(axis=2).max(), rtol=0.01)
    np.testing.assert_allclose(read[2, 5], light[2, 5], rtol=0.01)


def test_what_is_none_is_said(tmp_path):
    (tmp_path / "place.hdr").write_bytes(b"#?RADIANCE\n")
    with pytest.raises(CaptureError, match=r"readable Radiance .hdr file; got .*place.hdr"):
        read_panorama(tmp_path / "place.hdr")
    with pytest.raises(CaptureError, match=r"Radiance .hdr file; got place.png"):
        read_panorama(tmp_path / "place.png")
    cv2.imwrite(str(tmp_path / "square.hdr"), np.ones((8, 8, 3), np.float32))
    with pytest.raises(InvalidInput, match="twice as wide as high"):
        read_panorama(tmp_path / "square.hdr")
