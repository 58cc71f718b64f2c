"""What the live video of a meeting page shows."""

from __future__ import annotations

from playwright.sync_api import Page


def frames_shown(page: Page) -> int:
    """Frames that the live video has decoded."""
    return int(page.get_by_test_id("fps").get_attribute("data-frames") or 0)


def picture(page: Page) -> bytes:
    """What the live video shows now, as raw RGBA of a 64 x 64 copy."""
    values = page.evaluate(
        """() => {
            const video = document.querySelector('[data-testid=live-video]');
            const canvas = new OffscreenCanvas(64, 64), context = canvas.getContext('2d');
            context.drawImage(video, 0, 0, 64, 64);
            return Array.from(context.getImageData(0, 0, 64, 64).data);
        }"""
    )
    return bytes(values)
