"""Folders and zips of frames: order, sizes, and every trick an archive can play."""

from __future__ import annotations

import stat
import struct
import zipfile
import zlib

import numpy as np
import pytest

import capture.sources.archive
from capture.errors import CaptureStopped, UnreadableClip
from capture.sources.archive import decode_picture, read_frames
from tests.capture.people import encoded


def _grey(value: int, size: tuple[int, int] = (24, 32)) -> bytes:
    return encoded(np.full((*size, 3), value, dtype=np.uint8))


def _zip(path, entries: dict[str, bytes]):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in entries.items():
            archive.writestr(name, data)
    return path


def test_frames_come_in_natural_order(tmp_path):
    for index in (10, 2, 1):
        (tmp_path / f"frame{index}.png").write_bytes(_grey(20 * index))
    (tmp_path / "notes.txt").write_text("not a picture")
    clip = read_frames(tmp_path, frames_per_second=10.0)
    assert [int(image.mean()) for image in clip.images] == [20, 40, 200]
    assert clip.times_s == pytest.approx([0.0, 0.1, 0.2])


def test_a_zip_reads_like_a_folder_without_unpacking(tmp_path):
    path = _zip(
        tmp_path / "f.zip",
        {"a/1.png": _grey(10), "a/2.jpg": _grey(30), "__MACOSX/a/._1.png": b"", "a/.x.png": b""},
    )
    clip = read_frames(path)
    assert len(clip.images) == 2
    assert [p.name for p in tmp_path.iterdir()] == ["f.zip"]


def test_many_frames_are_sampled_evenly(tmp_path):
    path = _zip(tmp_path / "f.zip", {f"{i:03d}.png": _grey(2 * i) for i in range(50)})
    clip = read_frames(path, max_frames=3, frames_per_second=10.0)
    assert [int(image.mean()) for image in clip.images] == [0, 48, 98]
    assert clip.times_s == pytest.approx([0.0, 2.4, 4.9])
    assert clip.source_frames == 50


def test_a_frame_of_no_bytes_is_named(tmp_path):
    path = _zip(tmp_path / "f.zip", {"1.png": _grey(1), "2.png": b""})
    with pytest.raises(UnreadableClip, match=r"2\.png must be a picture; got 0 bytes; remove it"):
        read_frames(path)


def test_a_frame_that_is_no_picture_is_named(tmp_path):
    path = _zip(tmp_path / "f.zip", {"1.png": _grey(1), "2.png": b"hello there"})
    with pytest.raises(UnreadableClip, match=r"2\.png must be a picture.*11 bytes"):
        read_frames(path)


def test_frames_of_other_sizes_are_refused(tmp_path):
    path = _zip(tmp_path / "f.zip", {"1.png": _grey(1), "2.png": _grey(1, (24, 30))})
    with pytest.raises(
        UnreadableClip, match=r"must be 32 x 24 as the first; got 30 x 24 in 2\.png"
    ):
        read_frames(path)


@pytest.mark.parametrize(
    "name", ["../1.png", "a/../../1.png", "/etc/1.png", "C:\\1.png", "..\\1.png"]
)
def test_names_outside_the_archive_are_refused(tmp_path, name):
    path = _zip(tmp_path / "f.zip", {"1.png": _grey(1), name: _grey(1)})
    with pytest.raises(UnreadableClip, match="must stay inside the archive"):
        read_frames(path)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["f.zip"]


def test_links_are_refused(tmp_path):
    path = tmp_path / "f.zip"
    with zipfile.ZipFile(path, "w") as archive:
        entry = zipfile.ZipInfo("1.png")
        entry.external_attr = (stat.S_IFLNK | 0o777) << 16
        archive.writestr(entry, "/etc/passwd")
    with pytest.raises(UnreadableClip, match=r"no links; got the link '1\.png'"):
        read_frames(path)


def test_a_bomb_is_refused_by_what_it_declares(tmp_path):
    path = _zip(tmp_path / "f.zip", {"1.png": bytes(30 * 2**20)})
    with pytest.raises(UnreadableClip, match="must grow at most 200 times"):
        read_frames(path)


def test_a_picture_declared_too_large_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(capture.sources.archive, "MAX_PICTURE_BYTES", 50)
    path = _zip(tmp_path / "f.zip", {"1.png": _grey(1)})
    with pytest.raises(UnreadableClip, match="must have at most 50 bytes"):
        read_frames(path)


def test_a_total_declared_too_large_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(capture.sources.archive, "MAX_TOTAL_BYTES", 100)
    path = _zip(tmp_path / "f.zip", {"1.png": _grey(1), "2.png": _grey(2)})
    with pytest.raises(UnreadableClip, match="must unpack to at most 100 bytes"):
        read_frames(path)


def test_a_bomb_that_lies_about_its_size_is_refused_while_inflating(tmp_path):
    path = _zip(tmp_path / "f.zip", {"1.png": bytes(30 * 2**20)})
    data = bytearray(path.read_bytes())
    for signature, offset in ((b"PK\x01\x02", 24), (b"PK\x03\x04", 22)):
        place = data.index(signature) + offset
        data[place : place + 4] = struct.pack("<I", 1000)
    path.write_bytes(data)
    with pytest.raises(UnreadableClip, match=r"1\.png"):
        read_frames(path)


def test_too_many_entries_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(capture.sources.archive, "MAX_ENTRIES", 3)
    path = _zip(tmp_path / "f.zip", {f"{i}.txt": b"" for i in range(4)})
    with pytest.raises(UnreadableClip, match="at most 3 entries; got 4"):
        read_frames(path)


def test_a_picture_that_claims_billions_of_pixels_is_not_decoded():
    def chunk(kind: bytes, body: bytes) -> bytes:
        return (
            struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))
        )

    header = struct.pack(">IIBBBBB", 60_000, 60_000, 8, 2, 0, 0, 0)
    data = (
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", header)
        + chunk(b"IDAT", zlib.compress(b""))
        + chunk(b"IEND", b"")
    )
    with pytest.raises(UnreadableClip, match=r"big\.png must"):
        decode_picture("big.png", data)


def test_what_is_no_archive_or_holds_no_pictures_is_refused(tmp_path):
    text = tmp_path / "f.zip"
    text.write_text("PK no zip")
    with pytest.raises(UnreadableClip, match="must be a folder or a zip of frames"):
        read_frames(text)
    with pytest.raises(UnreadableClip, match="must hold pictures"):
        read_frames(_zip(tmp_path / "g.zip", {"a.txt": b"x"}))


def test_a_damaged_entry_is_refused(tmp_path):
    path = _zip(tmp_path / "f.zip", {"1.png": _grey(1)})
    data = bytearray(path.read_bytes())
    data[40] ^= 0xFF
    data[45] ^= 0xFF
    path.write_bytes(data)
    with pytest.raises(UnreadableClip):
        read_frames(path)


def test_reading_stops_when_asked(tmp_path):
    path = _zip(tmp_path / "f.zip", {"1.png": _grey(1)})
    with pytest.raises(CaptureStopped):
        read_frames(path, should_stop=lambda: True)
