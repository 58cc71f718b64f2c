"""What live look costs pages: that which draws by itself, and that of its sender (`look_sender`);
and how soon it is gone from others (`look_end`).

Of the former pictures a second with and without, and bytes.

In a browser without a graphics card, which shares its processor between drawing, decoding and
finding the colours; with and without take turns, the former from everybody's second new colours
on. Each person's pictures are of the bitrate that a page sends, 10 a second; poses and viewpoint
are new for each picture. Bytes on the line are those of frames and poses, and of what SCTP, DTLS,
UDP and IP put round each packet.
"""

from __future__ import annotations

import math
import statistics
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from av import CodecContext, VideoFrame
from av.video.codeccontext import VideoCodecContext
from playwright.sync_api import Page

from benchmarks.local_view import encoded_text, measuring_page
from benchmarks.look_end import gone
from benchmarks.look_sender import sender, sending_page
from benchmarks.reporting.figures import FigureWriter
from benchmarks.serve import surface_model
from renderer.live_look.picture import WebcamPicture
from renderer.splats.files.viewer_file import encode
from renderer.splats.model import SplatModel
from renderer.splats.rasteriser.renderer import SplatRenderer
from scene.arrays import Array, UInt8
from scene.camera import Camera
from scene.live_appearance import LiveAppearance
from scene.motion import Pose
from services.joining.look_track import BITRATE
from services.live.cell_code import draw_cells
from services.live.look.keying import lifted
from services.live.look.packets import Whose, encode_aligned_pose, encode_frame
from services.live.look.picture import AlignedPose
from services.live.look.picture_code import SIDE_PX, PictureCode, cells_of
from services.live.look.receiver import FRAME_SIZE, PICTURE_PX
from services.live.packets import performer_check
from services.live.room import MeetingPerformer, Room
from services.live.streaming.pose_feed import POSES_PER_SECOND, pose_packets

PEOPLE = (1, 4)
SPLATS, SIZE = 10_000, 256
PICTURES_PER_SECOND = 10
"""As client/src/look and client/src/transport/whep.ts have it."""
_MOMENTS, _SECONDS, _TURNS = 30, 6.0, 3
_PACKET_BYTES = 1200
"""Of one message as much goes into one packet."""
_AROUND_BYTES = 12 + 16 + 13 + 24 + 8 + 20
"""SCTP's header and chunk, DTLS, UDP and IP."""


@dataclass(frozen=True)
class Moment:
    """What comes of one person at one moment, about the picture and where they were in it."""

    frame: bytes
    pose: bytes
    picture: WebcamPicture
    """Of which the frame is made."""


def run(writer: FigureWriter, clip: Path) -> None:
    """Measure and report; the camera of who sends pictures shows `clip`."""
    model = surface_model(SPLATS)
    with measuring_page() as page:
        rows = [_drawn(page, model, people) for people in PEOPLE]
    with sending_page(clip) as sending:
        costs, ends = sender(sending), gone(sending)
    writer.write({"splats": SPLATS, "size": SIZE, "rows": rows, "sender": costs, "gone": ends})


def _drawn(page: Page, model: SplatModel, people: int) -> dict[str, Any]:
    """Pictures a second, in turns, and bytes a second."""
    cast = (MeetingPerformer.at_place(str(n), str(n), model, n) for n in range(people))
    room = Room("local-look", tuple(cast))
    moments = [pose_packets(room, n / POSES_PER_SECOND, n + 1) for n in range(_MOMENTS)]
    looks = [sent_by(model, Whose(n, people, performer_check(str(n)))) for n in range(people)]
    asked = {
        "file": encoded_text(encode(model)),
        "moments": [[encoded_text(one) for one in moment] for moment in moments],
        "size": SIZE,
        "seconds": _SECONDS,
    }
    told = [[encoded_text(m.frame), encoded_text(m.pose)] for look in looks for m in look]
    per_second: dict[bool, list[float]] = {False: [], True: []}
    changes = []
    for _ in range(_TURNS):
        for on in per_second:
            what = {**asked, "looks": told if on else [], "looksPerSecond": PICTURES_PER_SECOND}
            pictures, changed = page.evaluate("asked => window.measureLook(asked)", what)
            per_second[on].append(pictures / _SECONDS)
            if on:
                changes.append(changed / _SECONDS / people)
    row = {
        "people": people,
        "pictures_per_second": round(statistics.median(per_second[False]), 1),
        "with_live_look": round(statistics.median(per_second[True]), 1),
        "changes_per_second": round(statistics.median(changes), 1),
        "kbit_per_second": round(_kbit_per_second(looks, moments)),
    }
    print(row, flush=True)
    return row


def sent_by(model: SplatModel, whose: Whose) -> list[Moment]:
    """Two seconds of somebody who moves before their webcam, in colours that flicker."""
    focal = 1.1 * PICTURE_PX
    k = np.array([[focal, 0.0, PICTURE_PX / 2], [0.0, focal, PICTURE_PX / 2], [0.0, 0.0, 1.0]])
    before = np.concatenate([np.diag([1.0, -1.0, -1.0]), np.zeros((3, 1))], axis=1)
    camera = Camera(k, before, PICTURE_PX, PICTURE_PX)
    rng, encoder = np.random.default_rng(whose.index), _encoder()
    renderer, moments = SplatRenderer((model,)), []
    for number in range(2 * PICTURES_PER_SECOND):
        angles = Pose.rest().joint_angles.copy()
        angles[[16, 17], 2] = -1.0 + 0.02 * number, 1.0 - 0.02 * number
        root = np.array([0.0, -0.35, -1.2]) - model.skeleton.rest_joints[0]
        pose = Pose(angles, root, number / PICTURES_PER_SECOND)
        transforms = model.skeleton.skinning_transforms(angles, root)
        change = rng.normal(0.0, 0.1, (len(model), 3)).astype(np.float32)
        seen = renderer.render(camera, [transforms], appearances=[LiveAppearance(change)])
        frame = VideoFrame.from_ndarray(_frame(seen, number), format="rgb24").reformat(
            format="yuv420p"
        )
        frame.pts, frame.time_base = number, Fraction(1, PICTURES_PER_SECOND)
        (packet,) = encoder.encode(frame)
        pelvis = model.skeleton.rest_joints[0] + root
        aligned = AlignedPose(pose, pelvis, camera, number / PICTURES_PER_SECOND)
        moments.append(
            Moment(
                encode_frame(whose, number, bytes(packet)),
                encode_aligned_pose(whose, number, aligned),
                _picture(seen, camera, pose),
            )
        )
    return moments


def _picture(seen: Array, camera: Camera, pose: Pose) -> WebcamPicture:
    levels = np.clip(255.0 * seen, 0.0, 255.0).astype(np.uint8)
    return WebcamPicture(levels[..., :3].copy(), levels[..., 3].copy(), camera, pose)


def _frame(seen: Array, number: int) -> UInt8[Array, "528 384 3"]:
    """The person above, the code below."""
    width, height = FRAME_SIZE
    pixels = np.zeros((height, width, 3), np.uint8)
    levels, kept = np.clip(255.0 * seen[..., :3], 0.0, 255.0), np.clip(seen[..., 3], 0.0, 1.0)
    pixels[:PICTURE_PX] = lifted(levels.astype(np.uint8), kept)
    code = PictureCode(1000 * number // PICTURES_PER_SECOND, 0, 0, PICTURE_PX)
    pixels[PICTURE_PX:, :SIDE_PX] = draw_cells(cells_of(code))[..., None]
    return pixels


def _encoder() -> VideoCodecContext:
    """VP8 as a browser encodes live."""
    context: VideoCodecContext = CodecContext.create("libvpx", "w")
    (context.width, context.height), context.pix_fmt = FRAME_SIZE, "yuv420p"
    context.bit_rate, context.gop_size = BITRATE, 1000
    context.framerate = Fraction(PICTURES_PER_SECOND)
    context.time_base = Fraction(1, PICTURES_PER_SECOND)
    context.options = {
        "deadline": "realtime",
        "cpu-used": "8",
        "lag-in-frames": "0",
        "minrate": str(BITRATE),
        "maxrate": str(BITRATE),
        "bufsize": str(BITRATE),
    }
    return context


def _kbit_per_second(looks: list[list[Moment]], moments: list[list[bytes]]) -> float:
    """Of everybody's pictures, their poses, and the poses that are drawn."""
    pictures = [on_line_bytes(part) for look in looks for m in look for part in (m.frame, m.pose)]
    seconds = len(looks[0]) / PICTURES_PER_SECOND
    poses = [on_line_bytes(one) for moment in moments for one in moment]
    per_second = sum(pictures) / seconds + sum(poses) / (_MOMENTS / POSES_PER_SECOND)
    return 8e-3 * per_second


def on_line_bytes(message: bytes) -> int:
    """What a message of a data channel takes on the line."""
    return len(message) + _AROUND_BYTES * max(1, math.ceil(len(message) / _PACKET_BYTES))
