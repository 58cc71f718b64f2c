"""One vocabulary: retired names stay away, and no two things share a name.

`docs/glossary.md` says what the names in use mean and whose they are.
"""

from __future__ import annotations

import re
import subprocess
from collections import defaultdict
from pathlib import Path

ROOT = Path(__file__).parents[1]
BLOCKS = ("scene", "db", "capture", "renderer", "services", "benchmarks", "tools")

RETIRED = {
    # services, database and control channel
    r"Standing(?=[.(])": "Admission, FootLocking or FootContacts",
    "stir": "notify",
    "_look_calmly": "_poll",
    "_bury": "_reap",
    "rows_of": "plane_rows",
    "wishes": "commands",
    "tell_cast_changed": "ViewSessions.refresh",
    "cast_listeners": "ViewSessions.refresh",
    "services_of": "CurrentGateway or Provided",
    r"services[./]client_types": "tools.client_types",
    "ProblemError": "a class of services.errors",
    "hand_in": "Results.commit",
    "hand_out": "Results.commit_interim",
    r"give_back(?=\()": "requeue or release_seats",
    "keep_seats": "renew_seats",
    "take_in": "ingest",
    "Arrival": "ReceivedFile",
    r"Known(?=[ \[(]*[({:])": "ExistingSequence",
    "known_sequence": "existing_sequence",
    "has_own_limit": "lift_body_limit",
    "relieve": "flush",
    "said_since": "messages_after",
    # the page
    "stageView": "meetingView",
    "placeChoice": "environmentPicker",
    "choosePlace": "setEnvironment",
    "Attendance": "MeetingSession",
    "comesHeard": "joinsUnmuted",
    "beingSeen": "motionCapture",
    "BeingSeen": "MotionCapture",
    "beSeenView": "motionCaptureView",
    "improveMeView": "improveModelView",
    "LeftBehind": "PendingDeletions",
    "Hearing": "SpatialAudio",
    "WayChooser": "RenderModeSelector",
    "LocalDrawing": "LocalRendering",
    "SizeLadder": "ResolutionLadder",
    "PictureFlow": "VideoAdaptation",
    "Footing": "ViewerRig",
    "castOf": "packSplats",
    "WhepLink": "WhepConnection",
    "VoiceLink": "VoiceConnection",
    "steerWith": "attachControls",
    "prefersStillness": "prefersReducedMotion",
    "NOBODY_YET": "INITIAL_STATE",
    # training and rendering
    "slow_down": "halve_learning_rate",
    "SceneStage": "SceneRenderer",
    "PersonModel": "PerformerModel",
    # the clip-wide fit
    "fit_problem": "capture.fitting.state, observations and terms",
    "doubted": "outlier_frames",
    "let_go": "reinitialise",
    "unsteadiness": "acceleration",
    "very_robust": "geman_mcclure",
    "TO_Y_UP": "OPENCV_TO_OPENGL",
    "SEEN_TO_CAMERA": "OPENGL_TO_OPENCV",
    "marks_on": "landmarks_on",
    "mark_points": "landmark_positions",
    # capture
    "LandmarkModel": "BodyLandmarks or LandmarkNetwork",
    "ModelSource": "NetworkSource",
    "SeenExpression": "ObservedExpression",
    "ExpressionFinder": "FaceAndHandDetector",
    "Likeness": "Appearance",
    "Backdrop": "BackgroundModel",
    "capture_video": "capture_clip",
    "capture_frames": "capture_clip",
    # the studio
    "acted": "with_random_expressions",
    "SurroundingLight": "EnvironmentLight",
    "seed_of": "seed_of_performer",
    "clip_of": "motion_file_of",
    "framed_head": "frame_head",
    r"studio\.(cast|acting|moves|wardrobe)": "named_performers, expressions, motions, outfit",
    # renderer
    r"unseen import presence": "capture_weight",
    "NOBODYS": "NO_LIGHT",
    "FIRST_SPREADS": "INITIAL_DEVIATIONS",
    "mean_of_alike": "same_side_mean",
    "_as_filmed": "_as_captured",
    "_Answers": "_Candidates",
    r"passes\.due": "should_run",
    "unseen_shots": "unseen_views",
    "(filmedOnly|filmed_only|showFilmedOnly)": "hideUnseen, hide_unseen, setHideUnseen",
    r"presence(?=[:\[])": "captureWeights",
    # the splat pass
    "(screenHalves|unshaded|normalOf)": "the terms of client/src/splats/shaders.ts",
    "_?(TAKEN_AT_M|DOME_M)": "PANORAMA_HEIGHT_M, DOME_RADIUS_M",
    "Only what was filmed": "Hide unseen parts",
    # readers, live capture
    "our_intrinsics": "to_half_pixel_centres",
    r"(?<!def )(?<!\.)their_intrinsics": "to_integer_pixel_centres",
    "moved_camera": "camera_in_world",
    r"(?<=\.)habits": "lifter_bias",
    r"\b_begun|_without_room": "_initial_flow, _extend_person",
    "local_turns": "local_rotations",
    "film_missing": "render_missing",
    "moved_pose": "apply_pose_step",
    "depth_trust": "depth_weights",
    r"live\.kernels": "energy_kernels, gauss_newton_kernels or filter_kernels",
    # kinematics
    "place_joints": "forward_kinematics",
    "write_turn": "write_rotation",
    "turns_of": "axis_angles_to_matrices",
    "angles_of": "matrices_to_axis_angles",
}
"""Names of before, and what took their place."""

_HISTORY = ("CHANGELOG.md", "docs/experiments/", "db/migrations/", "tests/stored/")
"""What tells of before may use its names."""
_KINDS = {".py", ".ts", ".md", ".toml", ".sh", ".css", ".html", ".yml"}


def _texts() -> list[tuple[str, str]]:
    listed = subprocess.run(
        ["git", "ls-files", "-co", "--exclude-standard"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    names = [name for name in listed.stdout.splitlines() if Path(name).suffix in _KINDS]
    kept = [name for name in names if not name.startswith(_HISTORY) and (ROOT / name).exists()]
    return [(name, (ROOT / name).read_text()) for name in kept if ROOT / name != Path(__file__)]


def test_no_retired_name_is_in_use():
    retired = {re.compile(rf"(?<!\w){name}(?!\w)"): now for name, now in RETIRED.items()}
    # all at once over a whole file: line by line and name by name would take half a minute
    any_of_them = re.compile(rf"(?<!\w)(?:{'|'.join(RETIRED)})(?!\w)")
    found = [
        f"{file}:{number}: {name.pattern} is {now} now"
        for file, text in _texts()
        if any_of_them.search(text)
        for number, line in enumerate(text.splitlines(), 1)
        for name, now in retired.items()
        if name.search(line)
    ]
    assert not found, "\n".join(found)


def test_no_two_public_classes_share_a_name():
    """But for REST's shapes, which may be called what they show of a thing."""
    classes: dict[str, list[str]] = defaultdict(list)
    for block in BLOCKS:
        for path in sorted((ROOT / block).rglob("*.py")):
            shapes = path.parent == ROOT / "services" / "api"
            if not shapes:
                for name in re.findall(r"^class ([A-Za-z]\w*)", path.read_text(), re.MULTILINE):
                    classes[name].append(str(path.relative_to(ROOT)))
    shared = {name: paths for name, paths in classes.items() if len(paths) > 1}
    assert not shared
