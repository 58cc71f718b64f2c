"""The landmark models for pages that find their own landmarks, checked as those of captures are."""

from __future__ import annotations

import logging

from fastapi import APIRouter
from fastapi.responses import FileResponse, Response

from capture.detection.network_files import NetworkSource, landmark_network_file
from capture.errors import PoseModelMissing
from capture.live.solver_constants import solver_constants
from services.api.dependencies import Provided
from services.errors import LandmarkModelMissing
from services.problems import problems

log = logging.getLogger(__name__)

router = APIRouter(prefix="/v1", tags=["meetings"], responses=problems(503))

_RETRY_AFTER_S = 60
_KEPT = {"Cache-Control": "public, max-age=86400"}
_BINARY = "application/octet-stream"


@router.get(
    "/landmarks/model",
    summary="Get the pose landmark network",
    response_class=FileResponse,
    responses={200: {"content": {"application/octet-stream": {}}}},
)
def read_landmark_model(services: Provided) -> FileResponse:
    """MediaPipe's Pose Landmarker (`.task`), downloaded once and checked by hash."""
    return _file(services.settings.pose_model_source())


@router.get(
    "/landmarks/face-model",
    summary="Get the face landmark network",
    response_class=FileResponse,
    responses={200: {"content": {"application/octet-stream": {}}}},
)
def read_face_model(services: Provided) -> FileResponse:
    """MediaPipe's Face Landmarker. Without it, performers keep a still face."""
    return _file(services.settings.face_model_source())


@router.get(
    "/landmarks/hand-model",
    summary="Get the hand landmark network",
    response_class=FileResponse,
    responses={200: {"content": {"application/octet-stream": {}}}},
)
def read_hand_model(services: Provided) -> FileResponse:
    """MediaPipe's Hand Landmarker. Without it, performers keep still hands."""
    return _file(services.settings.hand_model_source())


@router.get(
    "/landmarks/solver",
    summary="Get what poses are solved with",
    response_class=Response,
    responses={200: {"content": {"application/octet-stream": {}}}},
)
def read_solver_constants() -> Response:
    """The pose prior and the lifter's weights, by which a page solves its landmarks' poses."""
    return Response(solver_constants(), media_type=_BINARY, headers=_KEPT)


def _file(source: NetworkSource) -> FileResponse:
    try:
        path = landmark_network_file(source)
    except PoseModelMissing as error:
        log.error("%s", error)
        raise LandmarkModelMissing(
            "the landmark model must be on this server; got none that could be had; its keeper "
            "finds the reason in the log",
            _RETRY_AFTER_S,
        ) from error
    return FileResponse(
        path,
        media_type=_BINARY,
        headers=_KEPT,
    )
