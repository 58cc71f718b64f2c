"""What benchmarks need beside the checkout; who lacks it is told before anything is measured."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

from scene.errors import InvalidInput

_DATA = Path("../shared/data")
"""Beside the checkout; no part of this package."""
MOTION = _DATA / "mocap"
HUMAN_ASSETS = _DATA / "human-assets"
TWO_CAMERAS = _DATA / "real-two-cameras"
WEBCAM = _DATA / "real-monocular/webcam_upperbody_woman_asl.mp4"
PANORAMAS = _DATA / "environments"
FOOTAGE = _DATA
"""Folders of real footage, `real-*`."""
LPIPS_BACKBONE = _DATA / "models/alexnet_features.pth"


def require_browser() -> None:
    """Raises InvalidInput where no browser can be driven, which only tests and benchmarks need."""
    if find_spec("playwright") is None:
        raise InvalidInput(
            "a browser must be at hand to show what is measured; got no package playwright; "
            "run `make setup-test`"
        )


def require_cuda() -> None:
    """Raises InvalidInput where no CUDA device can run our kernels."""
    from renderer.devices import best_device

    missing = None
    if best_device().type != "cuda":
        missing = "no CUDA device"
    elif find_spec("triton") is None:
        missing = "no package triton"
    if missing is not None:
        raise InvalidInput(
            f"a CUDA device and Triton must be at hand; got {missing}; docs/gpu.md says how to "
            "set a machine up"
        )


def require_motion(folder: Path = MOTION) -> None:
    """Raises InvalidInput where there is no recorded motion."""
    if not any(folder.glob("*.bvh")):
        raise InvalidInput(
            f"motion must be a folder with .bvh files; got {folder}; see docs/data.md for clips"
        )


def require_human_assets(folder: Path = HUMAN_ASSETS) -> None:
    """Raises InvalidInput where there is nothing to make lifelike performers of."""
    if not (folder / "base").is_dir():
        raise InvalidInput(
            f"assets must be a folder that holds MakeHuman's base; got {folder}; docs/data.md says "
            "which"
        )


def require_panoramas(folder: Path = PANORAMAS) -> None:
    """Raises InvalidInput where there are no rooms."""
    if not any(folder.glob("*.hdr")):
        raise InvalidInput(
            f"panoramas must be a folder with Radiance .hdr files; got {folder}; docs/room.md says "
            "which"
        )


def require_webcam_clip(clip: Path = WEBCAM) -> None:
    """Raises InvalidInput where there is no clip for a page's camera to show."""
    if not clip.is_file():
        raise InvalidInput(f"clip must be a video of one person; got {clip}; name one by --clip")


def require_footage(folder: Path = TWO_CAMERAS) -> None:
    """Raises InvalidInput where there is no footage of two cameras."""
    if not (folder / "cam02.mp4").exists():
        raise InvalidInput(
            f"footage must hold cam01.mp4, cam02.mp4 and Calib.qca.txt; got {folder}; they are "
            "Demo_SinglePerson of Pose2Sim"
        )


def require_real_footage(folder: Path = FOOTAGE) -> None:
    """Raises InvalidInput where the real clips are not."""
    if not (folder / "real-webcam-people").is_dir():
        raise InvalidInput(
            f"footage must hold real-webcam-people and the other folders of docs/data.md; "
            f"got {folder}; name their folder by --footage"
        )
