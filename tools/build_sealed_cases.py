"""Writes sealed packets of motion, which the page's sealing is held to.

    python -m tools.build_sealed_cases

By `cryptography`, that is by OpenSSL and not by the browser's WebCrypto: a key, the code that
people compare, packets that a page must both make and open, and how they are followed.
"""

from __future__ import annotations

import base64
import hashlib
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
from cryptography.hazmat.primitives.ciphers.aead import AESGCM
from cryptography.hazmat.primitives.hashes import SHA256
from cryptography.hazmat.primitives.kdf.hkdf import HKDF

from scene.skeleton import Skeleton
from services.live.motion.live_motion import LiveMotion
from services.live.motion.motion_packet import decode_motion
from services.live.packets import VERSION, Kind

SEALED_CASES = Path(__file__).resolve().parents[1] / "tests" / "services" / "live" / "sealed.json"
_MEETING, _PERFORMER = "5e" * 16, "ad" * 16
_MOTIONS = SEALED_CASES.with_name("motion.json")
_MOTION_BYTES = 278


def main() -> None:
    """Write the cases anew."""
    SEALED_CASES.write_text(json.dumps(cases(), separators=(",", ":")) + "\n")


def cases() -> dict[str, Any]:
    """A meeting's key and code, and packets of one connection, as JSON."""
    key = hashlib.sha256(b"a meeting's key").digest()[:16]
    salt = hashlib.sha256(b"a connection's salt").digest()[:16]
    packets = [
        {
            "counter": counter,
            "motion": motion.hex(),
            "sealed": seal(key, salt, counter, motion, _MEETING, _PERFORMER).hex(),
        }
        for counter, motion in zip((1, 2, 0xFFFFFFFF), _motions(), strict=False)
    ]
    return {
        "key": base64.urlsafe_b64encode(key).rstrip(b"=").decode(),
        "meeting": _MEETING,
        "performer": _PERFORMER,
        "salt": salt.hex(),
        "code": code(key, _MEETING),
        "packets": packets,
        "followed": _followed(),
    }


def seal(
    key: bytes, salt: bytes, counter: int, motion: bytes, meeting_id: str, performer_id: str
) -> bytes:
    """A sealed packet, as `services.live.sealed_packet` describes it."""
    head = struct.pack("<BBHI", VERSION, Kind.SEALED_MOTION, 0, counter) + salt
    cipher = AESGCM(_stream_key(key, salt, meeting_id, performer_id))
    return head + cipher.encrypt(counter.to_bytes(12, "little"), motion, head)


def unseal(key: bytes, packet: bytes, meeting_id: str, performer_id: str) -> bytes:
    """The motion packet in a sealed one. Raises InvalidTag for what does not open."""
    head, salt = packet[:24], packet[8:24]
    cipher = AESGCM(_stream_key(key, salt, meeting_id, performer_id))
    return cipher.decrypt(packet[4:8] + bytes(8), packet[24:], head)


def code(key: bytes, meeting_id: str) -> str:
    """What people compare to know that they have the same key."""
    digest = hashlib.sha256(f"metanerf code 1 {meeting_id} ".encode() + key).digest()
    number = int.from_bytes(digest[:8], "big") % 10**12
    digits = f"{number:012d}"
    return " ".join(digits[at : at + 3] for at in range(0, 12, 3))


def _stream_key(key: bytes, salt: bytes, meeting_id: str, performer_id: str) -> bytes:
    info = f"metanerf motion 1 {meeting_id} {performer_id}".encode()
    return HKDF(SHA256(), 16, salt, info).derive(key)


def _followed() -> dict[str, Any]:
    """How the server follows packets of somebody whose feet are free, and lets them come to rest.

    Each packet with when it came, and poses at some moments from then on. They come as of a webcam,
    with a gap after half of them.
    """
    case = json.loads(_MOTIONS.read_text())["cases"][0]
    skeleton = Skeleton(np.array(case["body"]["rest"]).reshape(-1, 3))
    yaw_rad = case["body"]["yaw"]
    motion, told = LiveMotion(skeleton, yaw_rad), []
    packets = _motions()
    for number, packet in enumerate(packets):
        captured_ms = 1000.0 + 33.0 * number + (700.0 if 2 * number > len(packets) else 0.0)
        packet = packet[:8] + struct.pack("<d", captured_ms) + packet[16:]
        read = decode_motion(packet).motion
        arrived_s = read.time_s + 50.0 + 0.01 * (number % 3)
        motion.follow(read, arrived_s)
        later_s = (0.0, 0.02) if number < len(packets) - 1 else (0.0, 0.1, 0.3, 0.8, 2.0)
        poses = [_pose(motion, arrived_s + more) for more in later_s]
        told.append({"packet": packet.hex(), "arrived_s": arrived_s, "poses": poses})
    return {"yaw_rad": yaw_rad, "packets": told}


def _pose(motion: LiveMotion, now_s: float) -> dict[str, Any]:
    pose = motion.pose_at(now_s)
    assert pose is not None
    return {
        "now_s": now_s,
        "angles": pose.joint_angles.ravel().round(7).tolist(),
        "root": pose.root_translation.round(7).tolist(),
        "expression": pose.expression.round(5).tolist(),
    }


def _motions() -> list[bytes]:
    """Packets without live look or a locked foot, of motion that real landmarks came to."""
    frames = json.loads(_MOTIONS.read_text())["cases"][0]["frames"]
    told = [frame["motion"]["more"] for frame in frames if frame["motion"]]
    packets = [bytes.fromhex(more["packet"]) for more in told if more]
    return [one[:2] + bytes(2) + one[4 : _MOTION_BYTES - 1] + b"\0" for one in packets]


if __name__ == "__main__":
    main()
