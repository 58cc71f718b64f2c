"""The settings of a process, read from variables METANERF_NAME (services.setting_groups,
services.live_settings, services.login_settings, services.cluster_settings,
services.tracing_settings).

Built once at the entry point and passed down; nothing else reads the environment.
"""

from __future__ import annotations

import json
import os
import secrets
from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_type_hints

from pydantic import BaseModel, SecretStr, ValidationError

from scene.errors import InvalidInput
from services.cluster_settings import ClusterSettings
from services.live_settings import LiveSettings
from services.login_settings import LoginSettings
from services.network_settings import NetworkSettings
from services.quota_settings import QuotaSettings, RetentionSettings
from services.setting_groups import (
    DatabaseSettings,
    EventSettings,
    FolderSettings,
    Group,
    JobSettings,
    ModelSettings,
    ObjectSettings,
    RecordingSettings,
    SecuritySettings,
    ServerSettings,
    UploadSettings,
)
from services.signing_keys import SigningKeys
from services.tracing_settings import TracingSettings

if TYPE_CHECKING:
    from capture.detection.network_files import NetworkSource

_PREFIX = "METANERF_"


@dataclass(frozen=True)
class Settings:
    """Settings of every process: gateway, worker and command line."""

    server: ServerSettings
    security: SecuritySettings
    login: LoginSettings
    folders: FolderSettings
    database: DatabaseSettings
    objects: ObjectSettings
    events: EventSettings
    uploads: UploadSettings
    quotas: QuotaSettings
    retention: RetentionSettings
    models: ModelSettings
    live: LiveSettings
    recording: RecordingSettings
    jobs: JobSettings
    cluster: ClusterSettings
    networks: NetworkSettings
    tracing: TracingSettings

    def pose_model_source(self) -> NetworkSource:
        """Where captures and pages find the landmark model."""
        from capture.detection.network_files import POSE_MODEL

        return self.networks.source(POSE_MODEL, self.folders.cache_dir)

    def face_model_source(self) -> NetworkSource:
        """Where the face landmarker is found."""
        from capture.detection.network_files import FACE_MODEL

        return self.networks.source(FACE_MODEL, self.folders.cache_dir)

    def hand_model_source(self) -> NetworkSource:
        """Where the hand landmarker is found."""
        from capture.detection.network_files import HAND_MODEL

        return self.networks.source(HAND_MODEL, self.folders.cache_dir)

    def signing_keys(self) -> SigningKeys:
        """The secrets of tokens; the one that signs is made once where it is not set."""
        given = self.security.jwt_secret
        kept = self.folders.data_dir / "jwt_secret"
        current = given.get_secret_value() if given is not None else _kept_secret(kept)
        return SigningKeys(current, self.security.other_jwt_secrets)

    def by_variable(self) -> dict[str, Any]:
        """Every setting by its variable, such as METANERF_PORT."""
        groups: Iterator[Group] = (getattr(self, one.name) for one in fields(self))
        return {
            variable: getattr(group, name)
            for group in groups
            for name, variable in _variables(type(group)).items()
        }

    def child_environment(self) -> dict[str, str]:
        """These settings as a child process reads them."""
        values = {}
        for variable, value in self.by_variable().items():
            if value is None:
                continue
            if isinstance(value, SecretStr):
                value = value.get_secret_value()
            elif isinstance(value, BaseModel):
                value = value.model_dump_json()
            values[variable] = json.dumps(value) if isinstance(value, list) else str(value)
        ours = {name for name in os.environ if name.upper().startswith(_PREFIX)}
        return {k: v for k, v in os.environ.items() if k not in ours} | values


_GROUPS: dict[str, type[Group]] = get_type_hints(Settings)


def load_settings(**values: Any) -> Settings:
    """Settings from the environment, `values` first; `port` is METANERF_PORT.

    METANERF_PORT_FILE may name a file that holds the value, as secrets of containers are given.
    Raises InvalidInput, which names the variable and the rule of every fault.
    """
    given = {_PREFIX + name.upper(): value for name, value in values.items()}
    read: dict[str, Any] = {}
    faults: list[str] = []
    for name, group in _GROUPS.items():
        known = set(_variables(group).values())
        try:
            in_files = _values_in_files(known - set(given), faults)
            read[name] = group(**in_files, **{key: given.pop(key) for key in known & set(given)})
        except ValidationError as error:
            faults += [
                ": ".join([*map(str, fault["loc"]), fault["msg"]])
                for fault in error.errors(include_url=False)
            ]
    faults += [f"{name}: no setting has this name" for name in given]
    if faults:
        raise InvalidInput("settings must be valid; got " + "; ".join(faults))
    return _with_default_places(Settings(**read))


def _values_in_files(variables: set[str], faults: list[str]) -> dict[str, str]:
    """What stands in the files that the environment names for some of `variables`."""
    values: dict[str, str] = {}
    for variable in sorted(variables):
        path = os.environ.get(f"{variable}_FILE")
        if not path:
            continue
        if variable in os.environ:
            faults.append(f"{variable} and {variable}_FILE must not be set both; unset one")
            continue
        try:
            values[variable] = Path(path).read_text().rstrip("\n")
        except (OSError, UnicodeDecodeError) as error:
            faults.append(f"{variable}_FILE must name a file that can be read; got {error}")
    return values


def _with_default_places(settings: Settings) -> Settings:
    folder = settings.folders.data_dir
    database, objects = settings.database, settings.objects
    url = database.url or f"sqlite:///{folder}/metanerf.db"
    store_url = objects.store_url or f"file://{folder}/objects"
    return replace(
        settings,
        database=database.model_copy(update={"url": url}),
        objects=objects.model_copy(update={"store_url": store_url}),
    )


def _variables(group: type[Group]) -> dict[str, str]:
    """The variable of each setting of a group, by its name."""
    return {name: str(field.validation_alias) for name, field in group.model_fields.items()}


def _kept_secret(path: Path) -> str:
    path.parent.mkdir(parents=True, exist_ok=True)
    made = path.with_name(f"{path.name}.{secrets.token_hex(8)}")
    try:
        return path.read_text()
    except FileNotFoundError:
        descriptor = os.open(made, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with os.fdopen(descriptor, "w") as file:
            file.write(secrets.token_urlsafe(48))
        try:
            os.link(made, path)  # of two processes that start together, one wins
        except FileExistsError:
            pass
        finally:
            made.unlink()
        return path.read_text()
