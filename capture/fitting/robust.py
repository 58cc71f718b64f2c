"""Robust loss functions of squared residuals in units of their deviation (Barron 2019 compares)."""

from __future__ import annotations

from scene.arrays import Tensor


def pseudo_huber(squared: Tensor) -> Tensor:
    """Quadratic for small residuals, linear beyond one deviation."""
    return 2.0 * ((1.0 + squared).sqrt() - 1.0)


def geman_mcclure(squared: Tensor, width: float) -> Tensor:
    """Quadratic for small residuals; beyond `width` deviations next to no gradient is left."""
    return squared / (1.0 + squared / width**2)
