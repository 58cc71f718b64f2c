"""Errors of the words every block speaks.

    SceneError (ValueError)
    └── InvalidInput     a value breaks a rule of scene/: the rule, the value, how to mend it

Other packages derive their own trees from SceneError.
"""

from __future__ import annotations


class SceneError(ValueError):
    """Root of every error that MetaNeRF raises on purpose."""


class InvalidInput(SceneError):
    """A value breaks a rule of this package."""
