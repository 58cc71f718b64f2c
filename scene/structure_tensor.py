"""Where in a picture, and in which direction, a movement can be seen."""

from __future__ import annotations

from scene.arrays import Array, Float, UInt8


def structure_tensor(
    grey: UInt8[Array, "h w"], blur_px: float
) -> tuple[Float[Array, "h w"], Float[Array, "h w"], Float[Array, "h w"]]:
    """xx, xy and yy of the structure tensor (Foerstner & Guelch 1987), in squares of grey levels a
    pixel: products of the slopes along x and y, smoothed by a Gaussian of `blur_px`."""
    import cv2

    # a Sobel filter's weights come to 8
    x, y = (cv2.Sobel(grey, cv2.CV_32F, 1 - down, down, scale=0.125) for down in (0, 1))
    xx, xy, yy = (cv2.GaussianBlur(product, (0, 0), blur_px) for product in (x * x, x * y, y * y))
    return xx, xy, yy
