"""Marks pictures and videos of models as synthetic, for programs that show or collect them.

The mark is IPTC's digital source type (IPTC Photo Metadata Standard 2023.1, section "Digital Source
Type"), in XMP (ISO 16684-1) where pictures have it: an iTXt chunk in a PNG, an APP1 segment in a
JPEG, an `XMP ` chunk in a WebP. In an MP4 it is the comment and the description. Metadata is easily
taken off, so that it helps honest programs alone.
"""

from __future__ import annotations

import struct
import zlib

NOTE = "Synthetic: drawn from a learnt model of a person, not filmed"
SOURCE_TYPE = "http://cv.iptc.org/newscodes/digitalsourcetype/trainedAlgorithmicMedia"
VIDEO_METADATA = {"comment": NOTE, "description": SOURCE_TYPE}
"""Of an MP4's container."""
_XMP = (
    '<?xpacket begin="\ufeff" id="W5M0MpCehiHzreSzNTczkc9d"?>'
    '<x:xmpmeta xmlns:x="adobe:ns:meta/">'
    '<rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">'
    '<rdf:Description rdf:about="" xmlns:dc="http://purl.org/dc/elements/1.1/"'
    ' xmlns:Iptc4xmpExt="http://iptc.org/std/Iptc4xmpExt/2008-02-29/"'
    f' Iptc4xmpExt:DigitalSourceType="{SOURCE_TYPE}">'
    f'<dc:description><rdf:Alt><rdf:li xml:lang="x-default">{NOTE}</rdf:li></rdf:Alt>'
    "</dc:description></rdf:Description></rdf:RDF></x:xmpmeta>"
    '<?xpacket end="r"?>'
).encode()
_HAS_XMP = 0x04
"""Of a WebP's VP8X chunk."""


def mark_picture(data: bytes, width: int, height: int) -> bytes:
    """An encoded PNG, JPEG or WebP of that size (px), with the mark."""
    if data.startswith(b"\x89PNG"):
        return _mark_png(data)
    return _mark_jpeg(data) if data.startswith(b"\xff\xd8") else _mark_webp(data, width, height)


def _mark_png(data: bytes) -> bytes:
    body = b"XML:com.adobe.xmp\0\0\0\0\0" + _XMP
    kind = b"iTXt"
    chunk = struct.pack(">I", len(body)) + kind + body
    chunk += struct.pack(">I", zlib.crc32(kind + body))
    after_head = 8 + 12 + 13  # signature, then IHDR, which must come first
    return data[:after_head] + chunk + data[after_head:]


def _mark_jpeg(data: bytes) -> bytes:
    body = b"http://ns.adobe.com/xap/1.0/\0" + _XMP
    segment = b"\xff\xe1" + struct.pack(">H", len(body) + 2) + body
    at = 2
    if data[2:4] == b"\xff\xe0":  # JFIF's own segment comes first
        at += 2 + struct.unpack_from(">H", data, 4)[0]
    return data[:at] + segment + data[at:]


def _mark_webp(data: bytes, width: int, height: int) -> bytes:
    chunks = bytearray(data[12:])
    if not chunks.startswith(b"VP8X"):
        sizes = (width - 1).to_bytes(3, "little") + (height - 1).to_bytes(3, "little")
        chunks[:0] = b"VP8X" + struct.pack("<II", 10, 0) + sizes
    chunks[8] |= _HAS_XMP
    chunks += b"XMP " + struct.pack("<I", len(_XMP)) + _XMP + b"\0" * (len(_XMP) % 2)
    return b"RIFF" + struct.pack("<I", len(chunks) + 4) + b"WEBP" + bytes(chunks)
