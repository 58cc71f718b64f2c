"""Which pixels of a whole clip are the person's."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor

from capture.detection.landmarks import Landmarks
from capture.segmentation.background import FRAMES as BACKGROUND_FRAMES
from capture.segmentation.background import learn_background
from capture.segmentation.masks import dilated_person_mask, refine_mask, smooth_masks
from capture.sources.video import evenly_spaced
from scene.arrays import Array, Float, UInt8


def segment_clip(
    images: Sequence[UInt8[Array, "H W 3"]],
    people: Sequence[Landmarks | None],
    on_progress: Callable[[float], None] = lambda _: None,
) -> list[Float[Array, "H W"] | None]:
    """The person's soft mask in each frame, [0, 1]; None where they were lost."""
    found = [(images[i], person) for i, person in enumerate(people) if person]
    some = [found[i] for i in evenly_spaced(len(found), BACKGROUND_FRAMES)]
    background = learn_background(
        [image for image, _ in some], (dilated_person_mask(one) for _, one in some)
    )

    def refined(
        image: UInt8[Array, "H W 3"], person: Landmarks | None
    ) -> Float[Array, "H W"] | None:
        return None if person is None else refine_mask(image, person, background)

    masks: list[Float[Array, "H W"] | None] = []
    with ThreadPoolExecutor(len(os.sched_getaffinity(0)), "segment") as pool:
        for mask in pool.map(refined, images, people):
            masks.append(mask)
            on_progress(len(masks) / len(people))
    return smooth_masks(images, masks)
