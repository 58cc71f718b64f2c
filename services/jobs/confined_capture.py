"""The process that captures one clip (services.confinement); see `services.jobs.capture_apart`.

    python -m services.jobs.confined_capture

Its first line of standard input is JSON: what to capture, and where to. Each line that it prints is
JSON, too: `progress`, `draft` (which is the reader's from then on), and at last `done`, `stopped`,
`refused` or `errno`. The line `stop` stops it; the end of its input ends it at once.
"""

from __future__ import annotations

import json
import os
import sys
import threading
from pathlib import Path
from typing import IO, Any

from services.confinement import Limits, confine, outcome

MEMORY_BYTES = 16 << 30
"""Of addresses: threads and libraries take several gigabytes of them that are never used."""
PROCESSOR_S = 4 * 3600
"""Of all cores together."""
_OPEN_FILES = 512
_LEAST_FILE_BYTES = 256 << 20
_UNPACKED = 4
"""How much larger than the clip a file may be that is unpacked from it."""
_GIVES_WAY = 10
"""Niceness that is added once somebody works with the draft: who waits, waits for that."""
DRAFT, RESULT = "draft", "sequence"
"""Names of folders in the one that may be written to."""


def main() -> None:
    """Capture what the first line of standard input names."""
    wanted = json.loads(sys.stdin.buffer.readline())
    source, folder = Path(wanted["source"]), Path(wanted["folder"])
    networks = [Path(one) for one in wanted["networks"] if one is not None]
    largest = max(_LEAST_FILE_BYTES, _UNPACKED * source.stat().st_size)
    confine(
        Limits(MEMORY_BYTES, PROCESSOR_S, largest, _OPEN_FILES),
        [source, *networks, *map(Path, wanted["readable"])],
        [folder],
    )
    conversation = _Conversation()
    conversation.say(**outcome(lambda: _capture(conversation, source, folder, wanted)))


class _Conversation:
    """What is said to the process that waits, and what it says."""

    def __init__(self) -> None:
        # libraries print to the usual descriptor
        self._said: IO[bytes] = os.fdopen(os.dup(1), "wb", buffering=0)
        os.dup2(2, 1)
        self._stop = threading.Event()
        threading.Thread(target=self._listen, daemon=True).start()

    def say(self, **message: Any) -> None:
        """Print one line."""
        self._said.write(json.dumps(message).encode() + b"\n")

    def should_stop(self) -> bool:
        """Whether nobody wants the capture any more."""
        return self._stop.is_set()

    def hand_over(self, draft: Path, folder: Path) -> None:
        """Leave a draft to the other, who works with it while the capture goes on."""
        draft.rename(folder / DRAFT)
        os.nice(_GIVES_WAY)
        self.say(draft=True)

    def _listen(self) -> None:
        for line in sys.stdin.buffer:
            if line == b"stop\n":
                self._stop.set()
        os._exit(os.EX_SOFTWARE)  # nobody is left to capture for


def _capture(
    conversation: _Conversation, source: Path, folder: Path, wanted: dict[str, Any]
) -> dict[str, object]:
    from capture.errors import CaptureStopped
    from capture.pipeline import CaptureOptions, capture_clip

    pose, face, hand = (None if one is None else Path(one) for one in wanted["networks"])
    try:
        capture_clip(
            source,
            folder / RESULT,
            CaptureOptions(
                person=wanted["person"],
                height_m=wanted["height_m"],
                pose_model=pose,
                face_model=face,
                hand_model=hand,
            ),
            on_progress=lambda share, message: conversation.say(progress=[share, message]),
            on_draft=lambda draft: conversation.hand_over(draft, folder),
            should_stop=conversation.should_stop,
        )
    except CaptureStopped:
        return {"stopped": True}
    return {"done": True}


if __name__ == "__main__":
    main()
