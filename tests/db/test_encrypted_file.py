"""What is encrypted comes back from anywhere; whatever was done to it meanwhile is found."""

from __future__ import annotations

import io
import os
from collections.abc import Callable
from pathlib import Path

import pytest

from db.encrypted_file import (
    MAGIC,
    PIECE_BYTES,
    DecryptingReader,
    EncryptingWriter,
    is_encrypted,
    read_secret,
)
from db.errors import BrokenArchive
from scene.errors import InvalidInput

SECRET = b"a secret for tests only, long enough"
HEADER_BYTES, STORED = len(MAGIC) + 32 + 16, PIECE_BYTES + 16
CONTENT = os.urandom(3 * PIECE_BYTES + 1000)


def encrypted(content: bytes, secret: bytes = SECRET) -> bytes:
    file = io.BytesIO()
    with EncryptingWriter(file, secret) as writer:
        for start in range(0, len(content), 10_000):
            writer.write(content[start : start + 10_000])
        assert writer.tell() == len(content)
    return file.getvalue()


def decrypted(data: bytes, secret: bytes = SECRET) -> bytes:
    return DecryptingReader(io.BytesIO(data), secret, "all.tar").read()


@pytest.mark.parametrize(
    "size", [0, 1, PIECE_BYTES - 1, PIECE_BYTES, PIECE_BYTES + 1, 2 * PIECE_BYTES, len(CONTENT)]
)
def test_it_comes_back(size: int):
    data = encrypted(CONTENT[:size])
    assert decrypted(data) == CONTENT[:size]
    assert CONTENT[:16] not in data


def test_it_is_read_from_anywhere():
    reader = DecryptingReader(io.BytesIO(encrypted(CONTENT)), SECRET, "all.tar")
    for start, size in ((150_000, 50), (0, 10), (PIECE_BYTES - 5, 10), (3 * PIECE_BYTES, 5000)):
        assert reader.seek(start) == start
        assert reader.read(size) == CONTENT[start : start + size]
        assert reader.tell() == min(start + size, len(CONTENT))
    assert reader.seek(-4, io.SEEK_END) == len(CONTENT) - 4
    assert reader.read() == CONTENT[-4:]
    assert reader.read() == b""
    assert reader.seek(len(CONTENT) + 99) == len(CONTENT) + 99
    assert reader.read(1) == b""


def test_no_two_files_of_the_same_are_alike():
    one, two = encrypted(CONTENT), encrypted(CONTENT)
    assert one[HEADER_BYTES : HEADER_BYTES + 32] != two[HEADER_BYTES : HEADER_BYTES + 32]


def _piece(data: bytes, number: int) -> bytes:
    start = HEADER_BYTES + number * STORED
    return data[start : start + STORED]


def _joined(data: bytes, *numbers: int) -> bytes:
    return data[:HEADER_BYTES] + b"".join(_piece(data, number) for number in numbers)


def _flipped(data: bytes, at: int) -> bytes:
    changed = bytearray(data)
    changed[at] ^= 1
    return bytes(changed)


@pytest.mark.parametrize(
    "change",
    [
        lambda data: _flipped(data, HEADER_BYTES + 5),
        lambda data: _flipped(data, HEADER_BYTES + STORED - 1),
        lambda data: _flipped(data, -1),
        lambda data: data[:-1],
        lambda data: data[:-999],
        lambda data: data[: HEADER_BYTES + 3 * STORED],  # between two pieces
        lambda data: data[: HEADER_BYTES + STORED],
        lambda data: data[:HEADER_BYTES],
        lambda data: data[: HEADER_BYTES - 1],
        lambda data: b"",
        lambda data: data + b"more",
        lambda data: data + _piece(data, 3),
        lambda data: _joined(data, 1, 0, 2, 3),
        lambda data: _joined(data, 0, 0, 2, 3),
        lambda data: _joined(data, 0, 2, 3),
        lambda data: data[:HEADER_BYTES] + encrypted(CONTENT)[HEADER_BYTES:],
        lambda data: _joined(data, 0) + _piece(encrypted(CONTENT), 1) + _joined(data, 2, 3)[89:],
    ],
)
def test_whatever_was_done_to_it_is_found(change: Callable[[bytes], bytes]):
    with pytest.raises(BrokenArchive, match=r"all\.tar must be whole and as it was written"):
        decrypted(change(encrypted(CONTENT)))


def test_a_missing_end_is_found_before_anything_is_read():
    cut = encrypted(CONTENT)[: HEADER_BYTES + 2 * STORED]
    with pytest.raises(BrokenArchive):
        DecryptingReader(io.BytesIO(cut), SECRET, "all.tar")


def test_a_wrong_secret_is_told_from_damage():
    data = encrypted(CONTENT)
    with pytest.raises(
        InvalidInput, match=r"the one that all\.tar was encrypted with; got another"
    ):
        decrypted(data, b"another secret for tests, long enough")


def test_what_was_not_closed_is_refused():
    file = io.BytesIO()
    writer = EncryptingWriter(file, SECRET)
    writer.write(CONTENT)
    with pytest.raises(BrokenArchive):
        decrypted(file.getvalue())
    writer.close()
    writer.close()
    assert decrypted(file.getvalue()) == CONTENT


def test_a_key_is_read_from_a_file_and_must_be_long(tmp_path: Path):
    path = tmp_path / "key"
    path.write_bytes(SECRET + b"\r\n")
    assert read_secret(path) == SECRET
    path.write_bytes(b"short\n")
    with pytest.raises(InvalidInput, match="at least 32 bytes; got 5 in key"):
        read_secret(path)
    with pytest.raises(InvalidInput, match="a file that can be read"):
        read_secret(tmp_path / "none")


def test_it_is_known_by_its_beginning(tmp_path: Path):
    path = tmp_path / "file"
    for data, known in ((encrypted(b"a"), True), (b"a tar", False), (b"", False)):
        path.write_bytes(data)
        assert is_encrypted(path) is known
