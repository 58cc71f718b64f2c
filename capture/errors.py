"""Errors of capture, each saying the rule, the value received and how to mend it.

CaptureError (SceneError)
├── UnreadableClip       not a video, no frames, a broken or dangerous archive
├── NoPersonFound        nobody, or hardly ever, seen in the clip
├── PoseModelMissing     the landmark model's file is absent or not the one expected
├── BrokenSequence       a sequence folder that breaks the format
├── BrokenDataset        a folder of a public data set that breaks its layout, or hides code
├── BrokenKeypoints      a keypoints file that breaks the format
├── BrokenMotionCapture  a BVH file that can't be read
├── UploadFailed         the service refused an upload or went away
└── CaptureStopped       somebody asked to stop
"""

from __future__ import annotations

from scene.errors import SceneError


class CaptureError(SceneError):
    """Root of the errors of capture."""


class UnreadableClip(CaptureError):
    """The clip can't be decoded, holds no frames, or its archive is broken or dangerous."""


class NoPersonFound(CaptureError):
    """Nobody was found in (enough of) the clip."""


class PoseModelMissing(CaptureError):
    """The landmark model's file is absent, can't be fetched or is not the one expected."""


class BrokenSequence(CaptureError):
    """A sequence folder breaks the format."""


class BrokenDataset(CaptureError):
    """A folder of a public data set breaks its layout, or hides code in its pickles."""


class BrokenKeypoints(CaptureError):
    """A keypoints file breaks the format."""


class BrokenMotionCapture(CaptureError):
    """A BVH file can't be read."""


class UploadFailed(CaptureError):
    """The service refused an upload, or could not be reached."""


class CaptureStopped(CaptureError):
    """Somebody asked to stop; nothing was written."""
