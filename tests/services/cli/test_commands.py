"""The commands by hand: film, train, render, evaluate; and what mistakes are told."""

from __future__ import annotations

import io
import json
import re
import sys
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
from rich.console import Console
from typer import BadParameter
from typer.testing import CliRunner

from capture.storage import open_sequence
from renderer.model_files import load_model
from services.cli.app import app, main
from services.cli.terminal import progress_bar, seconds, splats_kept
from services.figures import size_words

runner = CliRunner()


@pytest.fixture(scope="module")
def filmed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("film") / "truth.seq"
    made = runner.invoke(
        app, ["studio", "--out", str(out), "--frames", "8", "--size", "64", "--test-cameras", "2"]
    )
    assert made.exit_code == 0, made.output
    return out


@pytest.fixture(scope="module")
def trained(filmed: Path) -> Path:
    out = filmed.parent / "model.safetensors"
    made = runner.invoke(app, ["train", str(filmed), "--out", str(out), "--iterations", "150"])
    assert made.exit_code == 0, made.output
    assert not out.with_suffix(".checkpoint").exists()
    assert out.with_suffix(".poses.png").exists()
    return out


@pytest.mark.parametrize("wrong", [["--budget", "soon"], ["--preset", "nope"]])
def test_training_that_is_refused_leaves_nothing(filmed: Path, tmp_path: Path, wrong: list[str]):
    out = tmp_path / "new" / "model.safetensors"
    refused = runner.invoke(app, ["train", str(filmed), "--out", str(out), *wrong])
    assert refused.exit_code != 0
    assert not out.parent.exists()


@pytest.mark.parametrize(("text", "kept"), [("auto", "auto"), ("full", "full"), ("5000", 5000)])
def test_a_size_is_a_word_or_a_number(text: str, kept: object):
    assert splats_kept(text) == kept


@pytest.mark.parametrize("text", ["", "few", "99", "-500", "1.5"])
def test_other_sizes_are_refused(text: str):
    with pytest.raises(BadParameter, match="auto, full or a number from 100; got"):
        splats_kept(text)


def test_what_was_tried_is_told_in_words():
    tried = [
        {"splats": 5000, "lost_db": {"body": 1.5}, "good": False},
        {"splats": 8000, "lost_db": {"body": 0.1}, "good": True},
        {
            "splats": 7000,
            "lost_db": {"body": 0.2},
            "lpips": {"body": [0.05, 0.0507]},
            "apart": 0.0084,
            "good": True,
        },
    ]
    assert size_words({"asked": "auto", "of": 20_000, "kept": 7000, "tried": tried}) == [
        "7,000 of 20,000 splats kept",
        "  5,000: worse by body +1.50 dB; too few",
        "  8,000: worse by body +0.10 dB; more than needed",
        "  7,000: worse by body +0.20 dB, body +0.0007 LPIPS, 0.008 LPIPS apart from beside; kept",
    ]
    assert size_words(None) == []


def test_a_folder_of_humannerfs_is_trained_on_as_it_is(tmp_path):
    theirs, model = tmp_path / "theirs", tmp_path / "model.safetensors"
    made = runner.invoke(
        app,
        [
            "studio",
            "--out",
            str(tmp_path / "truth.seq"),
            "--performer",
            "dune",
            "--frames",
            "8",
            "--size",
            "64",
            "--test-cameras",
            "1",
            "--humannerf",
            str(theirs),
        ],
    )
    assert made.exit_code == 0, made.output
    assert (theirs / "mesh_infos.pkl").exists()
    done = runner.invoke(app, ["train", str(theirs), "--out", str(model), "--iterations", "150"])
    assert done.exit_code == 0, done.output
    figures = tmp_path / "figures.json"
    done = runner.invoke(
        app, ["evaluate", str(model), str(theirs), "--json", str(figures), "--no-lpips"]
    )
    assert done.exit_code == 0, done.output
    assert json.loads(figures.read_text())["psnr"]["training_view"]["body_crop"] > 18.0


@pytest.mark.parametrize("trust", ["exact", "estimated"])
def test_poses_are_believed_as_far_as_told(filmed, tmp_path, trust):
    out = tmp_path / "model.safetensors"
    words = ["train", str(filmed), "--out", str(out), "--iterations", "150", "--pose-trust", trust]
    done = runner.invoke(app, words)
    assert done.exit_code == 0, done.output
    given, refined = open_sequence(filmed).motion.joint_angles, load_model(out).motion.joint_angles
    assert np.allclose(refined, given, atol=1e-6) == (trust == "exact")


@pytest.mark.parametrize("camera", ["front", "orbit", "40,10"])
def test_a_picture_is_rendered(trained, tmp_path, camera):
    out = tmp_path / "view.png"
    done = runner.invoke(
        app, ["render", str(trained), "--out", str(out), f"--camera={camera}", "--size", "96"]
    )
    assert done.exit_code == 0, done.output
    picture = cv2.imread(str(out))
    assert picture is not None
    assert picture.shape == (96, 96, 3)
    assert picture.std() > 10


def test_a_video_is_rendered(trained, tmp_path):
    out = tmp_path / "orbit.mp4"
    done = runner.invoke(
        app, ["render", str(trained), "--out", str(out), "--size", "64", "--length", "0.5s"]
    )
    assert done.exit_code == 0, done.output
    with av.open(str(out)) as video:
        assert sum(1 for _ in video.decode(video=0)) == 15
    assert [p.name for p in tmp_path.iterdir()] == ["orbit.mp4"]


def test_figures_are_written_for_both_splits_and_regions(trained, filmed, tmp_path):
    out, sheet = tmp_path / "figures.json", tmp_path / "sheet.png"
    done = runner.invoke(
        app,
        [
            "evaluate",
            str(trained),
            str(filmed),
            "--json",
            str(out),
            "--sheet",
            str(sheet),
            "--no-lpips",
        ],
    )
    assert done.exit_code == 0, done.output
    figures = json.loads(out.read_text())
    for metric in ("psnr", "ssim"):
        for split in ("novel_view", "unseen_pose"):
            assert set(figures[metric][split]) >= {"body_crop", "whole"}
    assert figures["psnr"]["novel_view"]["whole"] > figures["psnr"]["novel_view"]["body_crop"] > 10
    assert re.search(r"novel view \(\d+\) +body crop +\d\d\.\d\d ± ", done.output)
    assert "splats: 150 steps" in done.output
    picture = cv2.imread(str(sheet))
    assert picture is not None
    assert picture.max() > 200  # captions


def test_lpips_is_measured_without_a_network_on_the_backbone_that_is_packaged(trained, filmed):
    done = runner.invoke(app, ["evaluate", str(trained), str(filmed)])
    assert done.exit_code == 0, done.output
    assert "LPIPS 0.1 on squeeze" in done.output


def test_where_vgg_cannot_be_fetched_figures_come_without_lpips(
    trained, filmed, tmp_path, monkeypatch
):
    monkeypatch.setenv("METANERF_LPIPS_BACKBONE_URL", (tmp_path / "absent.pth").as_uri())
    monkeypatch.setenv("METANERF_DATA_DIR", str(tmp_path))
    arguments = ["evaluate", str(trained), str(filmed), "--lpips-backbone", "vgg16"]
    done = runner.invoke(app, arguments)
    assert done.exit_code == 0, done.output
    assert "without LPIPS: LPIPS' backbone must be fetched once" in done.output


def test_presets_are_listed():
    listed = json.loads(runner.invoke(app, ["presets", "--json"]).output)
    assert listed["splats"]["settings"]["count"] == 10_000
    assert "fast" in listed


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["train", "nowhere", "--out", "m.safetensors"], "must be a sequence folder"),
        (["render", "nowhere", "--out", "x.png"], "must be a model file"),
        (["capture", "--out", "x.seq"], "must be given a clip or --webcam; got neither"),
        (
            ["capture", "--webcam", "0", "--out", "x.seq", "--height", "178"],
            "height_m must be metres between 0.5 and 2.5; got 178",
        ),
        (
            ["upload", ".", "--to", "http://127.0.0.1:9", "--height", "0.1"],
            "height_m must be metres between 0.5 and 2.5; got 0.1",
        ),
        (
            ["capture", "gone.mp4", "--out", "x.seq"],
            "the clip must be a file; got none at gone.mp4",
        ),
        (["studio", "--out", "x.seq", "--look", "moonlit"], "look must be one of"),
        (["studio", "--out", f"{__file__}/x.seq"], "test_commands.py: a file, no folder"),
        (["train", "nowhere", "--out", f"{__file__}/m.safetensors"], "must be where it can be"),
        (["studio", "--out", "x.seq", "--noise", "2"], "must come with --footage"),
    ],
)
def test_mistakes_are_told_in_one_line(arguments, words, monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.argv", ["metanerf", *arguments])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 1
    told = capsys.readouterr().err
    assert words in told
    assert "Traceback" not in told
    assert list(tmp_path.iterdir()) == []


def test_a_folder_of_no_server_has_no_recordings(monkeypatch, capsys, tmp_path):
    arguments = ["export-recording", "nope", "--out", "a.mp4", "--data-dir", str(tmp_path)]
    monkeypatch.setattr("sys.argv", ["metanerf", *arguments])
    with pytest.raises(SystemExit):
        main()
    assert "must be that of a recording; got 'nope'" in capsys.readouterr().err


def test_keypoints_alone_make_no_sequence(monkeypatch, capsys, tmp_path):
    frames = [{"joint_angles": [[0, 0, 0]] * 24}] * 2
    keypoints = tmp_path / "wave.json"
    keypoints.write_text(
        json.dumps(
            {
                "format": "metanerf-keypoints",
                "version": 1,
                "layout": "smpl24",
                "frames_per_second": 30,
                "frames": frames,
            }
        )
    )
    monkeypatch.setattr(
        "sys.argv", ["metanerf", "capture", str(keypoints), "--out", str(tmp_path / "x.seq")]
    )
    with pytest.raises(SystemExit):
        main()
    told = capsys.readouterr().err
    assert "must be made from pictures of the person; got wave.json, keypoints alone" in told
    assert "drive a model" in told
    assert list(tmp_path.iterdir()) == [keypoints]


def test_what_the_system_refuses_is_told_in_one_line(trained, monkeypatch, capsys, tmp_path):
    (tmp_path / "taken.png").mkdir()
    (tmp_path / "taken.png" / "inside").touch()
    arguments = ["render", str(trained), "--camera", "front", "--size", "32"]
    monkeypatch.setattr("sys.argv", ["metanerf", *arguments, "--out", str(tmp_path / "taken.png")])
    with pytest.raises(SystemExit):
        main()
    told = capsys.readouterr().err
    assert "taken.png.part must be a place that can be read or written; got: Is a directory" in told
    assert [entry.name for entry in tmp_path.iterdir()] == ["taken.png"]


@pytest.mark.parametrize("columns", [60, 80, 120])
def test_a_narrow_terminal_keeps_the_bar_the_share_and_the_time(columns):
    out = io.StringIO()
    with progress_bar("training", Console(file=out, width=columns, force_terminal=True)) as report:
        report(0.5, "learning the looks (step 12345, loss 0.0039)")
    last = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", out.getvalue()).strip().splitlines()[-1]
    assert re.search(r"training ━+.* 50 % learning the.*\d:\d\d:\d\d", last)
    assert ("loss 0.0039)" in last) is (columns == 120)


def test_a_measurement_says_what_it_lacks_before_it_starts(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "playwright", None)
    monkeypatch.setattr("sys.argv", ["metanerf", "bench", "serve"])
    with pytest.raises(SystemExit):
        main()
    assert "got no package playwright; run `make setup-test`" in capsys.readouterr().err


def test_a_meeting_is_not_measured_without_a_film_for_its_camera(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["metanerf", "bench", "meeting", "--clip", str(tmp_path / "x")])
    with pytest.raises(SystemExit):
        main()
    assert "clip must be a video of one person; got" in capsys.readouterr().err


@pytest.mark.parametrize("port", ["0", "-1", "65536"])
def test_a_webcams_port_that_is_none_is_refused(port: str, monkeypatch, capsys):
    link = "http://localhost/?meeting=m"
    monkeypatch.setattr("sys.argv", ["metanerf", "join", link, "--whip", port])
    with pytest.raises(SystemExit):
        main()
    assert f"--whip must be a port from 1 to 65535; got {port}; choose" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "value"), [("20s", 20.0), ("1.5m", 90.0), ("2h", 7200.0), ("7", 7.0)]
)
def test_durations_are_read_as_people_write_them(text, value):
    assert seconds(text) == value


@pytest.mark.parametrize("text", ["soon", "-3s", "0s", "3 days"])
def test_other_durations_are_refused(text):
    with pytest.raises(Exception, match=r"must look like 20s, 1.5m or 2h; got"):
        seconds(text)
