"""LPIPS' backbone is fetched once, whole, and only if it is the file it should be."""

from __future__ import annotations

import hashlib
from pathlib import Path

import pytest

from scene.errors import InvalidInput
from services.lpips_backbone import vgg_file


def published(folder: Path) -> tuple[str, str]:
    """Address and hash of a small file."""
    folder.mkdir()
    (folder / "vgg.pth").write_bytes(b"weights")
    return (folder / "vgg.pth").as_uri(), hashlib.sha256(b"weights").hexdigest()


def test_it_is_fetched_once(tmp_path):
    address, sha256 = published(tmp_path / "theirs")
    told: list[float] = []
    kept = vgg_file(tmp_path / "ours", lambda share, _: told.append(share), address, sha256)
    assert kept.read_bytes() == b"weights"
    assert len(told) == 1
    (tmp_path / "theirs" / "vgg.pth").unlink()
    assert vgg_file(tmp_path / "ours", lambda *_: None, address, sha256) == kept


def test_another_file_is_refused_and_nothing_stays(tmp_path):
    address, _ = published(tmp_path / "theirs")
    with pytest.raises(InvalidInput, match=r"fetched once from .*; got sha256 .*--lpips-backbone"):
        vgg_file(tmp_path / "ours", lambda *_: None, address, "0" * 64)
    assert list((tmp_path / "ours").iterdir()) == []


def test_no_network_is_told(tmp_path):
    with pytest.raises(InvalidInput, match="check the network"):
        vgg_file(tmp_path, lambda *_: None, (tmp_path / "absent.pth").as_uri())
