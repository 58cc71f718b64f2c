"""Errors of the renderer.

RendererError (SceneError)
├── BrokenModel        a model file can't be read
├── UnknownPreset      no preset of that name
├── TrainingError      training failed for good; says why
│   └── ForgotTooMuch  what was learnt made a model worse at what it knew
├── OutdatedCheckpoint training was stopped by a version that begins a clip otherwise
└── TrainingStopped    somebody asked to stop; a checkpoint was written where one was wanted
"""

from __future__ import annotations

from scene.errors import SceneError


class RendererError(SceneError):
    """Root of the errors of the renderer."""


class BrokenModel(RendererError):
    """A model file is no model, is cut short, or comes from another version."""


class UnknownPreset(RendererError):
    """No preset has that name."""


class TrainingError(RendererError):
    """Training failed for good."""


class ForgotTooMuch(TrainingError):
    """A model that went on learning is worse than before at what it knew."""


class OutdatedCheckpoint(RendererError):
    """A checkpoint is of a version that begins this clip with other parts than this one does."""


class TrainingStopped(RendererError):
    """Training was stopped on request."""
