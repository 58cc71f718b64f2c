"""The landmark model for pages that find their own landmarks: the checked file of capture."""

from __future__ import annotations

import logging

from fastapi import APIRouter
from fastapi.responses import FileResponse

from capture.errors import PoseModelMissing
from capture.pose_model import pose_model_file
from services.container import Provided
from services.problems import ProblemError, problems

log = logging.getLogger(__name__)

router = APIRouter(prefix="/v1", tags=["meetings"], responses=problems(503))

_RETRY_AFTER_S = 60
_KEPT_S = 86_400


@router.get(
    "/landmarks/model",
    summary="Get the landmark model",
    response_class=FileResponse,
    responses={200: {"content": {"application/octet-stream": {}}}},
)
def read_landmark_model(services: Provided) -> FileResponse:
    """MediaPipe's Pose Landmarker (`.task`), fetched once and checked; the same for everybody."""
    try:
        path = pose_model_file(services.settings.pose_model_source())
    except PoseModelMissing as error:
        log.error("%s", error)
        raise ProblemError(
            503,
            "landmark-model-missing",
            "the landmark model must be on this server; got none that could be had; its keeper "
            "finds the reason in the log",
            headers={"Retry-After": str(_RETRY_AFTER_S)},
        ) from error
    return FileResponse(
        path,
        media_type="application/octet-stream",
        headers={"Cache-Control": f"public, max-age={_KEPT_S}"},
    )
