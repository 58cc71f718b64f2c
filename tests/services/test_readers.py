"""Whatever bytes come, readers of packets and files take them or say why not, and leave nothing."""

from __future__ import annotations

import io
import json
import tarfile
import tempfile
import tracemalloc
import zipfile
import zlib
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from obstore.store import MemoryStore

from capture.body.expressions import ALL_GROUPS, ObservedExpression
from db.objects import ObstoreObjects
from scene.errors import InvalidInput, SceneError
from scene.expression import EXPRESSION_COUNT
from scene.motion import Motion
from services.api.control_channel import read_message
from services.jobs.packing import pack, unpack
from services.live.keypoints_packet import (
    KeypointsPacket,
    decode_keypoints,
    encode_keypoints,
)
from services.live.motion.expression_filter import AT_REST
from services.live.motion.motion_packet import MotionPacket, decode_motion, encode_motion
from services.live.motion.receivers import SealedReceiver
from services.live.motion.solved_motion import LocalPose, SolvedMotion
from services.live.packets import (
    Kind,
    PacketError,
    PosePacket,
    ViewPacket,
    decode_pose,
    decode_view,
    encode_pose,
    encode_view,
)
from services.live.sealed_packet import SEALED_BYTES
from services.motions import motion_bytes, motion_from_bytes
from services.recording import chunks
from services.recording.ogg import ogg_opus, samples_of, with_silence
from services.uploads.check import check_upload
from services.uploads.confined import read_panorama
from tests import few_examples
from tests.few_examples import damaged
from tests.services import seeds

FEW = settings(
    few_examples.FEW,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.filter_too_much],
)


def takes_or_refuses(read: Callable[[bytes], object], data: bytes) -> None:
    """Read, where only an error of ours may be raised."""
    with suppress(SceneError):
        read(data)


_VIEW = encode_view(ViewPacket(1, 5.0, (0.0, 1.0, 3.0), (0.0, 1.0, 0.0, 0.0), 0.7, 128, 128))
_KEYPOINTS = KeypointsPacket(
    1, 5.0, 640, 480, np.full((33, 2), 0.5), np.full((33, 3), 0.1), np.ones(33)
)
_EXPRESSION = ObservedExpression(np.full(EXPRESSION_COUNT, 0.5), ALL_GROUPS)
_MOTION = SolvedMotion(
    5.0,
    LocalPose(np.tile(np.eye(3), (24, 1, 1)), np.zeros(3)),
    np.zeros((24, 3)),
    np.zeros(3),
    (True, False),
    AT_REST,
    1,
    None,
)
_POSE = PosePacket(1, 5.0, 0, 1, 0, np.zeros(3), np.tile([1.0, 0.0, 0.0, 0.0], (24, 1)))


@pytest.mark.parametrize(
    ("decode", "whole"),
    [
        (decode_view, _VIEW),
        (decode_keypoints, encode_keypoints(_KEYPOINTS)),
        (decode_keypoints, encode_keypoints(replace(_KEYPOINTS, expression=_EXPRESSION))),
        (decode_motion, encode_motion(MotionPacket(1, _MOTION))),
        (decode_pose, encode_pose(_POSE)),
        (decode_pose, encode_pose(replace(_POSE, expression=_EXPRESSION.values))),
    ],
)
def test_packets(decode: Callable[[bytes], Any], whole: bytes):
    taken, length = 0, len(whole)

    @FEW
    @given(
        data=st.one_of(
            damaged(whole), st.binary(max_size=450), st.binary(min_size=length, max_size=length)
        )
    )
    def attack(data: bytes) -> None:
        nonlocal taken
        # a head that is let through leads to what is behind it
        for packet in (data, whole[:2] + data[2:]):
            try:
                read = decode(packet)
            except PacketError:
                continue
            taken += 1
            numbers = [value for value in vars(read).values() if isinstance(value, float)]
            assert np.isfinite(numbers).all()

    attack()
    assert taken > 0


def _checked(name: str) -> Callable[[bytes], object]:
    def read(data: bytes) -> object:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / name
            path.write_bytes(data)
            try:
                return check_upload(path, name)
            finally:
                assert [one.name for one in Path(folder).iterdir()] == [name]

    return read


@FEW
@given(data=damaged(seeds.frames_archive(2)))
def test_archives_of_frames(data: bytes):
    takes_or_refuses(_checked("frames.zip"), data)


@FEW
@given(data=damaged(seeds.video(3, 32)))
def test_videos(data: bytes):
    takes_or_refuses(_checked("clip.mp4"), data)


@FEW
@given(data=damaged(json.dumps(seeds.keypoints(1)).encode()))
def test_keypoints(data: bytes):
    takes_or_refuses(_checked("motion.json"), data)


_COMMANDS = [
    '{"type":"hello","token":"a.b.c","name":"Ada","after":3}',
    '{"type":"say","text":"Hello"}',
    '{"type":"role","participant_id":"p","role":"speaker"}',
    '{"type":"network","connection":"poor"}',
]


def _as_text(data: bytes) -> str:
    return data.decode(errors="surrogateescape")


_VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner),
    max_leaves=6,
)


@FEW
@given(
    field=st.sampled_from([*seeds.keypoints(1), "time_s", "joint_angles", "root_translation"]),
    value=_VALUES | st.sampled_from([10**400, -(10**400), 1e308, [[1e308] * 3] * 24, [1e308] * 3]),
)
def test_keypoints_with_a_field_that_is_anything(field: str, value: object):
    told = seeds.keypoints(2)
    (told if field in told else told["frames"][0])[field] = value
    takes_or_refuses(_checked("motion.json"), json.dumps(told).encode())


@pytest.mark.parametrize(
    "data",
    [b"[" * 200_000, b'{"a":' * 100_000, b"[" * 90_000 + b"]" * 90_000],
    ids=["open", "objects", "whole"],
)
def test_keypoints_nested_without_end(data: bytes):
    with pytest.raises(SceneError):
        _checked("motion.json")(data)


@FEW
@given(
    names=st.lists(
        st.text(st.characters(exclude_characters="/\0"), min_size=1, max_size=12)
        | st.sampled_from(["²1", "٣", "a" * 300, "é" * 200, "..", "C:x", "a/../b", "/etc/x"]),
        min_size=1,
        max_size=3,
        unique=True,
    ),
    suffix=st.sampled_from([".png", ".mp4", ".MOV", ""]),
)
def test_archives_with_any_names(names: list[str], suffix: str):
    content = seeds.picture() if suffix == ".png" else seeds.video(1, 32)
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as made:
        for name in names:
            try:
                made.writestr(name + suffix, content)
            except UnicodeEncodeError:
                return
    takes_or_refuses(_checked("frames.zip"), file.getvalue())


def _panorama() -> bytes:
    pixels = np.random.default_rng(0).integers(0, 255, (32, 64, 3), dtype=np.uint8)
    return cv2.imencode(".png", pixels)[1].tobytes()


@FEW
@given(data=damaged(_panorama()))
def test_panoramas(data: bytes):
    takes_or_refuses(lambda picture: read_panorama(picture, 2048), data)


def _sequence_tar(folder: Path) -> bytes:
    (folder / "sequence").mkdir()
    (folder / "sequence" / "sequence.json").write_text("{}")
    objects = ObstoreObjects(MemoryStore())
    stored = pack(objects, "a" * 32, folder / "sequence")
    return b"".join(objects.stream("a" * 32, stored.sha256))


def test_packed_sequences(tmp_path: Path):
    whole = _sequence_tar(tmp_path)
    objects = ObstoreObjects(MemoryStore())

    @FEW
    @given(data=damaged(whole) | damaged(_gzipped_tar()))
    def attack(data: bytes) -> None:
        stored = objects.put("a" * 32, [data])
        with tempfile.TemporaryDirectory() as folder:
            takes_or_refuses(
                lambda _: unpack(objects, "a" * 32, stored.sha256, Path(folder) / "out"), data
            )
            assert {one.name for one in Path(folder).iterdir()} <= {"out"}

    attack()


def _gzipped_tar() -> bytes:
    file = io.BytesIO()
    with tarfile.open(fileobj=file, mode="w:gz") as made:
        made.addfile(tarfile.TarInfo("x"))
    return file.getvalue()


def test_a_packed_sequence_writes_nothing_beside_its_folder(tmp_path: Path):
    file = io.BytesIO()
    with tarfile.open(fileobj=file, mode="w") as made:
        entry = tarfile.TarInfo("../beside")
        entry.size = 2
        made.addfile(entry, io.BytesIO(b"no"))
    objects = ObstoreObjects(MemoryStore())
    stored = objects.put("a" * 32, [file.getvalue()])
    with pytest.raises(InvalidInput):
        unpack(objects, "a" * 32, stored.sha256, tmp_path / "out")
    assert not (tmp_path / "beside").exists()


def _motion() -> bytes:
    return motion_bytes(
        Motion(np.arange(3) / 30.0, np.zeros((3, 24, 3)), np.zeros((3, 3)), np.ones((3, 24)))
    )


@FEW
@given(data=damaged(_motion()))
def test_motions(data: bytes):
    takes_or_refuses(motion_from_bytes, data)


@FEW
@given(data=damaged(chunks.pack([chunks.Record(0, b"hello"), chunks.Record(20, b"you")])))
def test_chunks_of_recordings(data: bytes):
    takes_or_refuses(lambda one: list(chunks.records_of(chunks.unpack(one))), data)


def test_a_chunk_unpacks_to_no_more_than_a_chunk_may_hold():
    bomb = zlib.compress(b"\0" * (80 << 20), 9)
    assert len(bomb) < 100_000
    tracemalloc.start()
    with pytest.raises(InvalidInput, match="at most 64 MiB; got"):
        chunks.unpack(bomb)
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most < 150 << 20
    with pytest.raises(InvalidInput, match="no end"):
        chunks.unpack(zlib.compress(b"records" * 9)[:-2])


_SEALED = bytes([1, Kind.SEALED_MOTION, 0, 0]) + bytes(314)


@FEW
@given(data=st.one_of(damaged(_SEALED), st.binary(max_size=400), st.text(max_size=9)))
def test_sealed_motion(data: object):
    kept: list[bytes] = []
    receiver = SealedReceiver(kept.append, lambda: 0.0, lambda: None)
    for message in (data, _SEALED, data):
        receiver.receive(message)
    # newest wins: one packet of one size, whatever it holds, and nothing else
    assert {len(one) for one in kept} == {SEALED_BYTES}
    assert kept.count(_SEALED) >= 1


_SAID = st.sampled_from(sorted(json.loads(one)["type"] for one in _COMMANDS))


@FEW
@given(
    text=st.one_of(
        st.sampled_from(_COMMANDS).flatmap(lambda one: damaged(one.encode())).map(_as_text),
        st.builds(
            lambda kind, fields: json.dumps(fields | {"type": kind}),
            _SAID,
            st.dictionaries(
                st.sampled_from(["on", "text", "participant_id", "role", "token", "after", "x"]),
                _VALUES,
                max_size=3,
            ),
        ),
        st.text(max_size=40),
    )
)
def test_messages_of_the_control_channel(text: str):
    takes_or_refuses(lambda _: read_message(text), b"")


@pytest.mark.parametrize(
    "text",
    ["[" * 9_000, '{"type":' * 2_000, '{"type":"say","text":' + "[" * 8_000, "x" * 20_000],
    ids=["open", "objects", "within", "long"],
)
def test_messages_of_the_control_channel_nested_without_end(text: str):
    with pytest.raises(SceneError):
        read_message(text)


@FEW
@given(packets=st.lists(st.binary(max_size=40), max_size=4))
def test_voices(packets: list[bytes]):
    assert all(samples_of(packet) >= 0 for packet in packets)
    said = [chunks.Record(20 * at, packet) for at, packet in enumerate(packets)]
    assert b"".join(ogg_opus(with_silence(said))).startswith(b"OggS")
