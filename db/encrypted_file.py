"""A file in pieces of AES-256-GCM, written once from its beginning and read anywhere.

The STREAM construction (Hoang, Reyhanitabar, Rogaway, Vizár 2015), as the file format of age has
it: a piece's nonce is its number and whether it is the last, so that none can be changed, left out,
repeated or put elsewhere, and the end cannot be cut off. A file has a key of its own, derived from
the secret by HKDF-SHA256 with a random salt, so that no nonce is used twice under a key.

| bytes | what |
| --- | --- |
| 25 | `metanerf encrypted file 1` |
| 32 | salt |
| 16 | check: derived beside the key, by which a wrong secret is known from a damaged file |
| pieces | 64 KiB of content, the last of 0 bytes to that, each with a tag of 16 bytes |
"""

from __future__ import annotations

import hmac
import io
import os
from pathlib import Path
from typing import IO, TYPE_CHECKING

from cryptography.exceptions import InvalidTag
from cryptography.hazmat.primitives.ciphers.aead import AESGCM
from cryptography.hazmat.primitives.hashes import SHA256
from cryptography.hazmat.primitives.kdf.hkdf import HKDF

from db.errors import BrokenArchive
from scene.errors import InvalidInput

if TYPE_CHECKING:
    from typing_extensions import Buffer

MAGIC = b"metanerf encrypted file 1"
_SALT_BYTES, _CHECK_BYTES, _KEY_BYTES, _TAG_BYTES = 32, 16, 32, 16
_HEADER_BYTES = len(MAGIC) + _SALT_BYTES + _CHECK_BYTES
PIECE_BYTES = 1 << 16
SHORTEST_SECRET_BYTES = 32


def read_secret(path: Path) -> bytes:
    """The secret in a file; a line's end after it does not count. Raises InvalidInput."""
    try:
        secret = path.read_bytes().rstrip(b"\r\n")
    except OSError as error:
        raise InvalidInput(f"the key must be a file that can be read; got {error}") from error
    if len(secret) < SHORTEST_SECRET_BYTES:
        raise InvalidInput(
            f"the key must have at least {SHORTEST_SECRET_BYTES} bytes; got {len(secret)} in "
            f"{path.name}; make one with `openssl rand -base64 48`"
        )
    return secret


def is_encrypted(path: Path) -> bool:
    """Whether a file begins as those of this module."""
    with path.open("rb") as file:
        return file.read(len(MAGIC)) == MAGIC


class EncryptingWriter(io.RawIOBase):
    """Writes to `file`, which it leaves open; what is not closed has no end, and is refused."""

    def __init__(self, file: IO[bytes], secret: bytes) -> None:
        salt = os.urandom(_SALT_BYTES)
        key, check = _derived(secret, salt)
        self._header = MAGIC + salt + check
        self._file, self._cipher = file, AESGCM(key)
        self._waiting, self._pieces, self._at = bytearray(), 0, 0
        file.write(self._header)

    def writable(self) -> bool:
        """It is."""
        return True

    def tell(self) -> int:
        """How many bytes were written."""
        return self._at

    def write(self, data: Buffer, /) -> int:
        """Take all of `data`."""
        taken = memoryview(data).cast("B")
        self._waiting += taken
        self._at += len(taken)
        # the last piece is known as such only at the end, so one is always kept back
        while len(self._waiting) > PIECE_BYTES:
            self._put(bytes(self._waiting[:PIECE_BYTES]), is_last=False)
            del self._waiting[:PIECE_BYTES]
        return len(taken)

    def close(self) -> None:
        """Write the last piece."""
        if not self.closed:
            self._put(bytes(self._waiting), is_last=True)
        super().close()

    def _put(self, piece: bytes, *, is_last: bool) -> None:
        nonce = _nonce(self._pieces, is_last)
        self._file.write(self._cipher.encrypt(nonce, piece, self._header))
        self._pieces += 1


class DecryptingReader(io.RawIOBase):
    """Reads `file`, which it leaves open, from anywhere; `name` is for messages.

    Raises InvalidInput for another secret's, and BrokenArchive, also while it is read, where a
    byte is not as it was written or the end is missing.
    """

    def __init__(self, file: IO[bytes], secret: bytes, name: str) -> None:
        self._file, self._name = file, name
        header = file.read(_HEADER_BYTES)
        if len(header) < _HEADER_BYTES or not header.startswith(MAGIC):
            raise self._broken("its beginning")
        salt, check = header[len(MAGIC) : -_CHECK_BYTES], header[-_CHECK_BYTES:]
        key, expected = _derived(secret, salt)
        if not hmac.compare_digest(check, expected):
            raise InvalidInput(
                f"the key must be the one that {name} was encrypted with; got another; name that"
            )
        self._header, self._cipher = header, AESGCM(key)
        stored = PIECE_BYTES + _TAG_BYTES
        body = file.seek(0, io.SEEK_END) - _HEADER_BYTES
        self._last = max(0, -(-body // stored) - 1)
        self._at, self._held = 0, (-1, b"")
        self._size = PIECE_BYTES * self._last + len(self._piece(self._last))

    def readable(self) -> bool:
        """It is."""
        return True

    def seekable(self) -> bool:
        """It is."""
        return True

    def tell(self) -> int:
        """Where the next byte is read."""
        return self._at

    def seek(self, offset: int, whence: int = io.SEEK_SET, /) -> int:
        """Go there."""
        start = {io.SEEK_SET: 0, io.SEEK_CUR: self._at, io.SEEK_END: self._size}[whence]
        self._at = max(0, start + offset)
        return self._at

    def read(self, size: int | None = -1, /) -> bytes:
        """As many bytes as there are, up to `size`."""
        end = self._size if size is None or size < 0 else min(self._size, self._at + size)
        found = bytearray()
        while self._at < end:
            number, within = divmod(self._at, PIECE_BYTES)
            part = self._piece(number)[within : within + end - self._at]
            found += part
            self._at += len(part)
        return bytes(found)

    def _piece(self, number: int) -> bytes:
        if self._held[0] != number:
            self._file.seek(_HEADER_BYTES + number * (PIECE_BYTES + _TAG_BYTES))
            stored = self._file.read(PIECE_BYTES + _TAG_BYTES)
            nonce = _nonce(number, number == self._last)
            try:
                self._held = number, self._cipher.decrypt(nonce, stored, self._header)
            except InvalidTag as error:
                raise self._broken(f"piece {number + 1} of {self._last + 1}") from error
        return self._held[1]

    def _broken(self, what: str) -> BrokenArchive:
        return BrokenArchive(
            f"{self._name} must be whole and as it was written; got one whose end is missing, or "
            f"with other bytes, in {what}; make another, or take an older one"
        )


def _derived(secret: bytes, salt: bytes) -> tuple[bytes, bytes]:
    """Key and check."""
    length = _KEY_BYTES + _CHECK_BYTES
    made = HKDF(SHA256(), length, salt, MAGIC).derive(secret)
    return made[:_KEY_BYTES], made[_KEY_BYTES:]


def _nonce(number: int, is_last: bool) -> bytes:
    return number.to_bytes(11, "big") + bytes([is_last])
