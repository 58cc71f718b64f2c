"""Settings by group, variables by name; secrets that are none are refused where it matters."""

from __future__ import annotations

import dataclasses
import os
import stat
from pathlib import Path
from typing import Any

import pytest
from pydantic import SecretStr

from capture.detection.network_files import NetworkSource
from scene.errors import InvalidInput
from services.cluster_settings import TaskResources
from services.settings import Settings, load_settings

REPOSITORY = Path(__file__).resolve().parents[2]


DEFAULTS = {
    "METANERF_HOST": "127.0.0.1",
    "METANERF_PORT": 8000,
    "METANERF_PUBLIC_URL": "",
    "METANERF_GATEWAY_URL": "",
    "METANERF_DRAIN_S": 20.0,
    "METANERF_CLIENT_DIR": REPOSITORY / "client" / "dist",
    "METANERF_ALLOWED_ORIGINS": [],
    "METANERF_LOG_LEVEL": "info",
    "METANERF_LOG_FORMAT": "text",
    "METANERF_NODE_ID": "",
    "METANERF_ENVIRONMENT": "development",
    "METANERF_JWT_SECRET": None,
    "METANERF_JWT_OTHER_SECRETS": None,
    "METANERF_TOKEN_LIFETIME_H": 24.0,
    "METANERF_OPEN_ACCESS": False,
    "METANERF_METRICS_TOKEN": None,
    "METANERF_GUEST_TOKENS_PER_MINUTE": 60,
    "METANERF_OIDC_ISSUER": None,
    "METANERF_OTLP_ENDPOINT": "",
    "METANERF_OIDC_CLIENT_ID": None,
    "METANERF_OIDC_CLIENT_SECRET": None,
    "METANERF_DATA_DIR": Path("metanerf-data"),
    "METANERF_DATABASE_URL": "",
    "METANERF_OBJECT_STORE_URL": "",
    "METANERF_S3_ENDPOINT_URL": None,
    "METANERF_S3_PUBLIC_URL": None,
    "METANERF_S3_REGION": "us-east-1",
    "METANERF_S3_ACCESS_KEY_ID": None,
    "METANERF_S3_SECRET_ACCESS_KEY": None,
    "METANERF_REDIS_URL": None,
    "METANERF_MAX_UPLOAD_BYTES": 536_870_912,
    "METANERF_ACCOUNT_BYTES": 21_474_836_480,
    "METANERF_ACCOUNT_PEOPLE": 100,
    "METANERF_ACCOUNT_SEQUENCES": 200,
    "METANERF_ACCOUNT_MODELS": 200,
    "METANERF_REQUESTS_PER_MINUTE": 3000,
    "METANERF_REQUESTS_PER_ADDRESS": 12_000,
    "METANERF_KEEP_RECORDINGS_DAYS": None,
    "METANERF_KEEP_CLIPS_DAYS": None,
    "METANERF_KEEP_AUDIT_DAYS": 365.0,
    "METANERF_CACHED_MODELS": 8,
    "METANERF_MAX_VIEW_PX": 2048,
    "METANERF_MAX_VIEWERS": 8,
    "METANERF_MAX_VOICES": 200,
    "METANERF_RENDERERS": "here",
    "METANERF_RENDERER_COUNT": 1,
    "METANERF_RENDERER_VIEWERS": 4,
    "METANERF_RENDERER_IDLE_S": 60.0,
    "METANERF_ICE_SERVERS": [],
    "METANERF_TURN_URLS": [],
    "METANERF_TURN_SECRET": None,
    "METANERF_STAMP_PICTURES": False,
    "METANERF_MAX_RECORDING_S": 7200.0,
    "METANERF_MAX_RECORDING_BYTES": 536_870_912,
    "METANERF_EMBEDDED_WORKER": True,
    "METANERF_WORKER_KINDS": ["capture", "train", "export"],
    "METANERF_WORKER_SLOTS": 1,
    "METANERF_JOB_NICENESS": 10,
    "METANERF_JOB_HEARTBEAT_TIMEOUT_S": 30.0,
    "METANERF_JOB_STOP_GRACE_S": 15.0,
    "METANERF_JOB_CRASHES": 3,
    "METANERF_WORKER_METRICS_PORT": 0,
    "METANERF_MAX_BUDGET_S": 3600.0,
    "METANERF_RAY_ADDRESS": "127.0.0.1:6379",
    "METANERF_CAPTURE_RESOURCES": TaskResources(memory=4_294_967_296),
    "METANERF_TRAIN_RESOURCES": TaskResources(memory=2_147_483_648),
    "METANERF_EXPORT_RESOURCES": TaskResources(memory=2_147_483_648),
    "METANERF_RENDERER_RESOURCES": TaskResources(num_cpus=0.5, memory=1_073_741_824),
    "METANERF_POSE_MODEL": None,
    "METANERF_FACE_MODEL": None,
    "METANERF_HAND_MODEL": None,
    "METANERF_LPIPS_BACKBONE": None,
    "METANERF_LPIPS_BACKBONE_URL": None,
}
"""Who runs a server has set these: a name or a default changes with an entry in the changelog."""


def test_every_setting_says_what_it_is_for():
    for group in dataclasses.fields(Settings):
        for name, field in getattr(load_settings(), group.name).__class__.model_fields.items():
            assert field.description, name


def test_variables_and_their_defaults_stay_as_they_are(monkeypatch: pytest.MonkeyPatch):
    for name in [name for name in os.environ if name.startswith("METANERF_")]:
        monkeypatch.delenv(name)
    data = Path("metanerf-data").resolve()
    expected = DEFAULTS | {
        "METANERF_DATA_DIR": data,
        "METANERF_DATABASE_URL": f"sqlite:///{data}/metanerf.db",
        "METANERF_OBJECT_STORE_URL": f"file://{data}/objects",
    }
    assert load_settings().by_variable() == expected


def test_environment_sets_by_name(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    monkeypatch.setenv("METANERF_DATA_DIR", str(tmp_path))
    monkeypatch.setenv("METANERF_ICE_SERVERS", '["stun:example.org"]')
    made = load_settings()
    assert made.database.url == f"sqlite:///{tmp_path}/metanerf.db"
    assert made.live.ice_servers == ["stun:example.org"]


@pytest.mark.parametrize("secret", [None, "short", "change-me-" * 5, "this-is-a-placeholder-" * 3])
def test_production_refuses_placeholder_secrets(secret: str | None, tmp_path: Path):
    with pytest.raises(InvalidInput, match=r"jwt_secret must be .* in production.*openssl rand"):
        load_settings(environment="production", jwt_secret=secret, data_dir=tmp_path)


def test_production_refuses_placeholders_among_other_secrets_too(tmp_path: Path):
    good = "0123456789abcdef" * 3
    given = {"environment": "production", "jwt_secret": good, "data_dir": tmp_path}
    made = load_settings(**given, jwt_other_secrets=f"{good[::-1]},\n {good[4:]}\n")
    assert made.security.other_jwt_secrets == [good[::-1], good[4:]]
    for other in ("short", f"{good}\nchange-me-{good}"):
        with pytest.raises(InvalidInput, match=r"jwt_other_secrets must be .*openssl rand"):
            load_settings(**given, jwt_other_secrets=other)


def test_faults_name_the_variable_and_the_rule(monkeypatch: pytest.MonkeyPatch):
    with pytest.raises(InvalidInput, match="METANERF_PORT: Input should be less than or equal to"):
        load_settings(port=99999)
    monkeypatch.setenv("METANERF_PORT", "many")
    monkeypatch.setenv("METANERF_MAX_VIEWERS", "0")
    with pytest.raises(InvalidInput, match=r"METANERF_PORT: .*; METANERF_MAX_VIEWERS: ") as told:
        load_settings()
    assert "got METANERF" in str(told.value)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"ice_servers": ["turn:example.org"]}, "TURN belongs into METANERF_TURN_URLS"),
        ({"turn_urls": ["stun:example.org"], "turn_secret": "s"}, "STUN into METANERF_ICE_SERVERS"),
        ({"turn_urls": ["turn:example.org"]}, "both or neither; got only the addresses"),
        ({"turn_secret": "s"}, "both or neither; got only the secret"),
    ],
)
def test_a_relay_that_could_not_work_is_refused(values: dict[str, Any], words: str):
    with pytest.raises(InvalidInput, match=words):
        load_settings(**values)


def test_a_gateways_address_is_scheme_and_host():
    given = {"https://one.example.org/": "https://one.example.org", "": ""}
    for url, kept in given.items():
        assert load_settings(gateway_url=url).server.gateway_url == kept
    for wrong in ("one.example.org", "https://example.org/one", "ftp://example.org", "https://"):
        with pytest.raises(InvalidInput, match=r"METANERF_GATEWAY_URL.*must be scheme and host"):
            load_settings(gateway_url=wrong)


def test_a_provider_is_given_with_id_and_secret_or_not_at_all():
    whole = {
        "oidc_issuer": "https://login.example.org",
        "oidc_client_id": "meetings",
        "oidc_client_secret": "of the provider",
    }
    made = load_settings(**whole).login
    assert (made.issuer, made.client_id) == ("https://login.example.org", "meetings")
    # deployments leave empty what they do not use
    assert load_settings(**dict.fromkeys(whole, "")).login.issuer is None
    for missing in whole:
        with pytest.raises(InvalidInput, match=r"must be set together; got none for"):
            load_settings(**(whole | {missing: ""}))


def test_a_provider_is_asked_over_encrypted_lines_alone():
    rest = {"oidc_client_id": "meetings", "oidc_client_secret": "of the provider"}
    for right in ("https://login.example.org/realms/one", "http://127.0.0.1:9000", "http://[::1]"):
        assert load_settings(oidc_issuer=right, **rest).login.issuer == right
    for wrong in ("http://login.example.org", "login.example.org", "https://", "https://x/?a=b"):
        with pytest.raises(InvalidInput, match=r"METANERF_OIDC_ISSUER: .*provider's issuer"):
            load_settings(oidc_issuer=wrong, **rest)


def test_a_secret_may_stand_in_a_file(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    secret = tmp_path / "turn_secret"
    secret.write_text("of a file\n")
    monkeypatch.setenv("METANERF_TURN_SECRET_FILE", str(secret))
    monkeypatch.setenv("METANERF_TURN_URLS", '["turn:example.org"]')
    made = load_settings()
    assert made.live.turn_secret is not None
    assert made.live.turn_secret.get_secret_value() == "of a file"
    child = made.child_environment()
    assert (child["METANERF_TURN_SECRET"], "METANERF_TURN_SECRET_FILE" in child) == (
        "of a file",
        False,
    )
    assert load_settings(turn_secret="given").live.turn_secret == SecretStr("given")
    monkeypatch.setenv("METANERF_TURN_SECRET", "of the environment")
    with pytest.raises(InvalidInput, match="METANERF_TURN_SECRET_FILE must not be set both"):
        load_settings()
    monkeypatch.delenv("METANERF_TURN_SECRET")
    secret.unlink()
    with pytest.raises(InvalidInput, match=r"METANERF_TURN_SECRET_FILE must name a file.*No such"):
        load_settings()


def test_secrets_are_not_shown():
    secrets = {"jwt_secret": "j" * 40, "turn_secret": "t" * 40, "metrics_token": "m" * 40}
    shown = repr(load_settings(turn_urls=["turn:example.org"], **secrets))
    assert not [secret for secret in secrets.values() if secret in shown]


def test_a_list_that_is_no_json_is_told_by_its_variable(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("METANERF_ICE_SERVERS", "stun:example.org")
    with pytest.raises(InvalidInput, match="METANERF_ICE_SERVERS"):
        load_settings()


def test_what_is_given_goes_before_the_environment(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("METANERF_PORT", "1234")
    assert load_settings().server.port == 1234
    assert load_settings(port=4321).server.port == 4321
    with pytest.raises(InvalidInput, match="METANERF_PROT: no setting has this name"):
        load_settings(prot=1)


def test_the_embedded_default_keeps_its_own_secret(tmp_path: Path):
    signed = load_settings(data_dir=tmp_path).signing_keys().sign({"sub": "ada"})
    assert load_settings(data_dir=tmp_path).signing_keys().read(signed) == {"sub": "ada"}
    assert len((tmp_path / "jwt_secret").read_text()) >= 32
    assert stat.S_IMODE((tmp_path / "jwt_secret").stat().st_mode) == 0o600


def test_a_child_reads_the_same_settings(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    monkeypatch.setenv("METANERF_PORT", "1234")
    made = load_settings(
        data_dir=tmp_path,
        jwt_secret="x" * 40,
        port=4321,
        worker_kinds=["train"],
        train_resources='{"num_cpus": 2, "num_gpus": 0.5}',
        pose_model=tmp_path / "a.task",
    )
    environment = made.child_environment()
    for name in list(environment):
        monkeypatch.setenv(name, environment[name])
    assert load_settings() == made
    assert made.cluster.resources("train") == TaskResources(num_cpus=2.0, num_gpus=0.5)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ("2 cores", "must be a JSON object"),
        ('{"cpus": 2}', "Extra inputs are not permitted"),
        ('{"num_gpus": 1.5}', "must be whole above 1"),
    ],
)
def test_what_a_job_takes_of_a_cluster_is_checked(given: str, said: str):
    with pytest.raises(InvalidInput, match=said) as refused:
        load_settings(train_resources=given)
    assert "METANERF_TRAIN_RESOURCES" in str(refused.value)


@pytest.mark.parametrize("name", ["pose", "face", "hand"])
def test_a_models_source_follows_the_settings(
    tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.delenv(f"METANERF_{name.upper()}_MODEL", raising=False)
    given = {f"{name}_model": tmp_path / "a.task"}
    for path, settings in (
        (None, load_settings(data_dir=tmp_path)),
        (tmp_path / "a.task", load_settings(data_dir=tmp_path, **given)),
    ):
        source: NetworkSource = getattr(settings, f"{name}_model_source")()
        assert source.path == path
        assert source.model.name == name
        assert source.folder.is_relative_to(tmp_path)
