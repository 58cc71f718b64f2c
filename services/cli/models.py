"""Commands about models: train, render, evaluate, presets."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from scene.errors import InvalidInput, SceneError
from scene.pose_trust import PoseTrust
from services.cli.terminal import (
    Report,
    progress_bar,
    require_writable,
    seconds,
    splats_kept,
    stop_on_interrupt,
)

if TYPE_CHECKING:
    from scene.arrays import Array, UInt8

app = typer.Typer()

_FETCHED = Path("vgg16")
"""In place of a file: the backbone of the paper's figures."""

ModelPath = Annotated[Path, typer.Argument(help="A trained model (.safetensors).")]
SequencePath = Annotated[
    Path,
    typer.Argument(help="A folder made by capture or studio, or one of ZJU-MoCap or HumanNeRF."),
]


@app.command()
def train(
    sequence: SequencePath,
    out: Annotated[Path, typer.Option(help="The model's file (.safetensors).")],
    preset: Annotated[str, typer.Option(help="Kind of model; see `metanerf presets`.")] = "splats",
    budget: Annotated[str, typer.Option(help="Training time, such as 60s or 2m.")] = "60s",
    iterations: Annotated[
        int | None, typer.Option(help="Number of steps, instead of a time; repeatable to the bit.")
    ] = None,
    size: Annotated[
        str,
        typer.Option(
            help="Splats that are kept: `auto`, as few as the clip shows a need for; `full`, all; "
            "or at most so many."
        ),
    ] = "auto",
    seed: Annotated[int, typer.Option(help="Seed of all random numbers.")] = 0,
    lpips_backbone: Annotated[
        Path | None,
        typer.Option(
            help="Weights (.pth) for LPIPS, which `humannerf` and `paper` train on. [VGG-16]"
        ),
    ] = None,
    pose_trust: Annotated[
        PoseTrust | None,
        typer.Option(
            help="How far its poses are believed: `exact` ones stay, `given` ones keep their "
            "skeleton and means. [as the data says]"
        ),
    ] = None,
) -> None:
    """Train a model of a person. Ctrl-C keeps a checkpoint, from which the same command continues.

    Before training, the poses are drawn over a few frames in a .poses.png beside the model. A clip
    whose joints miss the person is refused.
    """
    from capture.pose_check import require_poses_on_mask
    from capture.sources.readers import open_folder
    from renderer.model_files import save_model
    from renderer.presets import find_preset
    from renderer.training import Progress, TrainingStopped
    from renderer.training import train as train_model
    from services.figures import size_words

    require_writable(out)
    budget_s, kept = None if iterations else seconds(budget), splats_kept(size)
    clip = open_folder(sequence)
    if pose_trust is not None:
        clip = replace(clip, pose_trust=pose_trust)
    on_patches = find_preset(preset).trains_on_patches
    out.parent.mkdir(parents=True, exist_ok=True)
    require_poses_on_mask(clip, out.with_suffix(".poses.png"))
    if on_patches:
        lpips_backbone = _backbone(lpips_backbone)
    checkpoint = out.with_suffix(".checkpoint")
    with stop_on_interrupt() as should_stop, progress_bar("training") as report:

        def on_progress(step: Progress) -> None:
            report(step.fraction, step.message)

        try:
            model = train_model(
                clip,
                preset=preset,
                budget_s=budget_s,
                iterations=iterations,
                seed=seed,
                lpips_backbone=lpips_backbone,
                find_light=True,
                size=kept,
                on_progress=on_progress,
                should_stop=should_stop,
                checkpoint=checkpoint,
                clock=time.perf_counter,
            )
        except TrainingStopped as stopped:
            typer.secho(f"stopped: {stopped}; run the same command to continue", err=True)
            raise typer.Exit(130) from stopped
    save_model(model, out)
    checkpoint.unlink(missing_ok=True)
    typer.echo(f"{out}  {out.stat().st_size / 1e6:.2f} MB")
    for line in size_words(model.metrics.get("size")):
        typer.echo(line)


@app.command()
def render(
    model: ModelPath,
    out: Annotated[Path, typer.Option(help="A .png (one view) or an .mp4 (a camera path).")],
    camera: Annotated[
        str, typer.Option(help="orbit, front, left, back, right, or AZIMUTH,ELEVATION in degrees.")
    ] = "orbit",
    size: Annotated[int, typer.Option(help="Width and height, in pixels.", min=16, max=4096)] = 512,
    time_s: Annotated[
        float, typer.Option("--time", help="Time within the motion, in seconds.")
    ] = 0.0,
    length: Annotated[str, typer.Option(help="Length of a video, such as 4s.")] = "4s",
    motion: Annotated[
        Path | None, typer.Option(help="Keypoints (.json) that replace the model's own motion.")
    ] = None,
    distance_m: Annotated[
        float | None,
        typer.Option("--distance", help="Distance of the camera, in metres.", min=0.1, max=100.0),
    ] = None,
) -> None:
    """Render a model from any side: a picture or a video."""
    from renderer.model_files import load_model
    from services.video import FRAMES_PER_SECOND, camera_path, write_mp4, write_png

    require_writable(out)
    person = load_model(model)
    if motion is not None:
        from capture.sources.keypoints import read_keypoints

        path = read_keypoints(motion)
    else:
        path = person.motion
    frames = camera_path(person, path, camera, size, distance_m, time_s, seconds(length))
    if out.suffix == ".png":
        write_png(out, next(frames))
    elif out.suffix == ".mp4":
        total = max(1, round(seconds(length) * FRAMES_PER_SECOND))
        with progress_bar("rendering") as report:
            write_mp4(out, _told(frames, total, report))
    else:
        raise InvalidInput(f"--out must end in .png or .mp4; got {out.name!r}")
    typer.echo(str(out))


def _told(
    frames: Iterator[UInt8[Array, "H W 3"]], total: int, report: Report
) -> Iterator[UInt8[Array, "H W 3"]]:
    for number, frame in enumerate(frames, start=1):
        report(number / total, f"frame {number} of {total}")
        yield frame


@app.command()
def evaluate(
    model: ModelPath,
    sequence: SequencePath,
    json_file: Annotated[
        Path | None, typer.Option("--json", help="Write the figures to this file.")
    ] = None,
    every: Annotated[
        int, typer.Option(help="Evaluate every n-th moment; HumanNeRF's protocol: 30.", min=1)
    ] = 1,
    lpips_backbone: Annotated[
        Path | None,
        typer.Option(
            help="Weights (.pth) for LPIPS, or `vgg16`: the paper's, fetched once. [SqueezeNet 1.1]"
        ),
    ] = None,
    lpips: Annotated[bool, typer.Option(help="Measure LPIPS.")] = True,
    sheet: Annotated[
        Path | None, typer.Option(help="Write a picture (.png): truth, model, error of each view.")
    ] = None,
) -> None:
    """Compare a model with the truth on unseen views and unseen poses: PSNR, SSIM, LPIPS.

    SEQUENCE is the data that the model was trained on, or other data of the same person, whose
    frames are then all new to it and are shown in that data's own poses.
    """
    from capture.sources.readers import open_folder
    from renderer.evaluation.evaluate import EvaluatedView
    from renderer.evaluation.evaluate import evaluate as evaluate_model
    from renderer.evaluation.lpips import PACKAGED_BACKBONE
    from renderer.model_files import load_model
    from services.figures import print_figures, write_sheet
    from services.settings import load_settings

    for out in (json_file, sheet):
        if out is not None:
            require_writable(out)
    clip, person, views = open_folder(sequence), load_model(model), list[EvaluatedView]()
    backbone = lpips_backbone or load_settings().networks.lpips_backbone or PACKAGED_BACKBONE
    if backbone == _FETCHED:
        backbone = _backbone(None)
    if not lpips:
        backbone = None

    def on_view(view: EvaluatedView) -> None:
        if sheet is not None:
            views.append(view)

    figures = evaluate_model(person, clip, backbone, every=every, on_view=on_view)
    if json_file is not None:
        json_file.parent.mkdir(parents=True, exist_ok=True)
        json_file.write_text(json.dumps(figures, indent=2) + "\n")
    if sheet is not None:
        write_sheet(sheet, views)
    print_figures(figures)


def _backbone(given: Path | None) -> Path | None:
    """The weights for a perceptual loss: those named here or in the settings, else VGG-16. None and
    a message where that cannot be downloaded."""
    from services.lpips_backbone import vgg_file
    from services.settings import load_settings

    settings = load_settings()
    named = given or settings.networks.lpips_backbone
    if named is not None:
        return named
    try:
        with progress_bar("fetching") as report:
            return vgg_file(
                settings.folders.cache_dir, report, settings.networks.lpips_backbone_url
            )
    except SceneError as error:
        typer.secho(f"without LPIPS: {error}", err=True)
        return None


@app.command()
def presets(
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """List the presets with their parameters, size and what each switches on."""
    from renderer.catalogue import describe_preset
    from renderer.presets import PRESETS

    listed = {name: describe_preset(preset) for name, preset in PRESETS.items()}
    if as_json:
        typer.echo(json.dumps(listed, indent=2, default=str))
        return
    widest = max(map(len, listed))
    for name, about in listed.items():
        count = sum(about["parameters"].values())
        typer.echo(
            f"{name:{widest}} {count / 1e6:8.2f} M {about['megabytes']:8.2f} MB  "
            f"{PRESETS[name].description}"
        )
