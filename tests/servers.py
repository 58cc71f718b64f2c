"""What tests ask of the machine beyond their own process: PostgreSQL, Redis, files of the network.

Whatever asks for one of these fixtures, or for `POSTGRESQL` of `DATABASES`, is marked `server`
(tests/conftest.py), and `make unit` leaves it out.
"""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import time
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from aioice.ice import get_host_addresses
from sqlalchemy import create_engine, text
from sqlalchemy.engine import make_url
from sqlalchemy.exc import OperationalError

from benchmarks.servers import MortalRedis as MortalRedis
from benchmarks.servers import free_port as free_port
from benchmarks.servers import program_path
from capture.detection.network_files import FACE_MODEL, HAND_MODEL, POSE_MODEL
from db.unit_of_work import Database
from tests.landmark_models import landmark_model

_POSTGRES = os.environ.get(
    "METANERF_TEST_POSTGRES", "postgresql+psycopg://root@127.0.0.1:5432/test"
)
_REDIS = os.environ.get("METANERF_TEST_REDIS", "redis://127.0.0.1:6379/15")
POSTGRESQL = pytest.param("postgresql", marks=pytest.mark.server)
DATABASES = ("sqlite", POSTGRESQL)
"""Kinds of databases to test on: SQLite always, PostgreSQL where one answers."""
SERVER_FIXTURES = frozenset(
    {
        "postgres_url",
        "redis_url",
        "mortal_redis",
        "s3_endpoint",
        "turn_server",
        "pose_model",
        "face_model",
        "hand_model",
    }
)


def unavailable(what: str) -> None:
    """Skip for want of a server, unless skips are forbidden."""
    if os.environ.get("METANERF_TEST_NO_SKIPS"):
        pytest.fail(what)
    pytest.skip(what)


@contextmanager
def fresh_database(kind: str, folder: Path) -> Iterator[str]:
    """The URL of an empty database: a file, or a schema of its own on PostgreSQL."""
    if kind == "sqlite":
        yield f"sqlite:///{folder / 'metanerf.db'}"
        return
    engine = create_engine(_POSTGRES, connect_args={"connect_timeout": 2})
    schema = f"test_{uuid.uuid4().hex[:12]}"
    try:
        with engine.begin() as connection:
            connection.execute(text(f"CREATE SCHEMA {schema}"))
    except OperationalError as error:
        unavailable(f"no PostgreSQL at {_POSTGRES} (METANERF_TEST_POSTGRES): {error.orig}")
    url = make_url(_POSTGRES).update_query_dict({"options": f"-csearch_path={schema}"})
    try:
        yield url.render_as_string(hide_password=False)
    finally:
        with engine.begin() as connection:
            connection.execute(text(f"DROP SCHEMA {schema} CASCADE"))
        engine.dispose()


@pytest.fixture(scope="session")
def empty_database(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A migrated SQLite file to copy: quicker than to migrate for each test."""
    path = tmp_path_factory.mktemp("template") / "metanerf.db"
    database = Database(f"sqlite:///{path}")
    database.migrate()
    database.close()
    return path


def make_schema(database: Database, template: Path) -> None:
    """Have an empty database at the newest schema; `template` is a migrated file."""
    if database.engine.dialect.name == "sqlite":
        path = Path(str(database.engine.url.database))
        path.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(template, path)
    else:
        database.migrate()


@pytest.fixture
def postgres_url(tmp_path: Path) -> Iterator[str]:
    """An empty schema of a PostgreSQL."""
    with fresh_database("postgresql", tmp_path) as url:
        yield url


@pytest.fixture(scope="session")
def redis_url() -> str:
    """A Redis to test on."""
    import redis

    try:
        redis.Redis.from_url(_REDIS, socket_connect_timeout=1).ping()
    except redis.RedisError as error:
        unavailable(f"no Redis at {_REDIS} (METANERF_TEST_REDIS): {error}")
    return _REDIS


@pytest.fixture(scope="session")
def s3_endpoint() -> Iterator[str]:
    """The address of an S3 store with an empty bucket `test`."""
    import httpx

    port = free_port()
    command = [program("moto_server"), "-H", "127.0.0.1", "-p", str(port)]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    endpoint = f"http://127.0.0.1:{port}"
    try:
        for _ in range(600):
            try:
                httpx.put(f"{endpoint}/test").raise_for_status()
                break
            except httpx.TransportError:
                assert process.poll() is None, "the S3 store of these tests ended"
                time.sleep(0.1)
        yield endpoint
    finally:
        process.kill()
        process.wait()


def program(name: str) -> str:
    """The path of a server's program; skips where it is not installed."""
    found = program_path(name)
    if found is None:
        unavailable(f"{name} is not installed")
    assert found is not None
    return found


@pytest.fixture
def mortal_redis() -> Iterator[MortalRedis]:
    """A Redis of the test's own, which runs."""
    program("redis-server")
    made = MortalRedis()
    made.start()
    yield made
    made.kill()


@dataclass(frozen=True)
class SelfSigned:
    """A certificate that nobody vouches for, in PEM."""

    certificate: bytes
    key: bytes


def self_signed(name: str) -> SelfSigned:
    """One for a host of this name, good for a day."""
    from cryptography import x509
    from cryptography.hazmat.primitives import hashes, serialization
    from cryptography.hazmat.primitives.asymmetric import ec
    from cryptography.x509.oid import NameOID

    key, now = ec.generate_private_key(ec.SECP256R1()), datetime.now(UTC)
    whose = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])
    made = (
        x509.CertificateBuilder(whose, whose, key.public_key(), x509.random_serial_number())
        .not_valid_before(now - timedelta(hours=1))
        .not_valid_after(now + timedelta(days=1))
        .add_extension(x509.SubjectAlternativeName([x509.DNSName(name)]), critical=False)
        .sign(key, hashes.SHA256())
    )
    return SelfSigned(
        made.public_bytes(serialization.Encoding.PEM),
        key.private_bytes(
            serialization.Encoding.PEM,
            serialization.PrivateFormat.PKCS8,
            serialization.NoEncryption(),
        ),
    )


@dataclass(frozen=True)
class TurnServer:
    """A coturn on this machine, as deployed."""

    url: str
    """Without a transport: UDP, or TCP."""
    tls_url: str
    """By TLS."""
    secret: str
    certificate: Path
    """What is to be trusted for TLS."""


@pytest.fixture
def turn_server(tmp_path: Path) -> Iterator[TurnServer]:
    """A coturn with the configuration that is deployed; its one peer is this machine."""
    port, tls_port = free_port(), free_port()
    own_address = get_host_addresses(use_ipv4=True, use_ipv6=False)[0]
    certificate, key = tmp_path / "turn.crt", tmp_path / "turn.key"
    vouched = self_signed("localhost")
    certificate.write_bytes(vouched.certificate)
    key.write_bytes(vouched.key)
    tls_url = f"turns:localhost:{tls_port}?transport=tcp"
    made = TurnServer(f"turn:127.0.0.1:{port}", tls_url, uuid.uuid4().hex, certificate)
    options = {
        "listening-ip": "127.0.0.1",
        "listening-port": port,
        "tls-listening-port": tls_port,
        "cert": certificate,
        "pkey": key,
        "relay-ip": own_address,
        "allowed-peer-ip": own_address,
        "static-auth-secret": made.secret,
        "pidfile": tmp_path / "turnserver.pid",
        "userdb": tmp_path / "turndb",
    }
    configuration = Path(__file__).resolve().parents[1] / "deploy" / "turnserver.conf"
    command = [program("turnserver"), "-c", str(configuration)]
    process = subprocess.Popen(
        [*command, *(f"--{name}={value}" for name, value in options.items())],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        for _ in range(200):
            with socket.socket() as probe:
                if probe.connect_ex(("127.0.0.1", port)) == 0:
                    break
            assert process.poll() is None, "coturn ended"
            time.sleep(0.05)
        yield made
    finally:
        process.kill()
        process.wait()


@pytest.fixture(scope="session")
def pose_model() -> Path:
    """MediaPipe's network for landmarks of the body."""
    return landmark_model(POSE_MODEL)


@pytest.fixture(scope="session")
def face_model() -> Path:
    """MediaPipe's network for faces."""
    return landmark_model(FACE_MODEL)


@pytest.fixture(scope="session")
def hand_model() -> Path:
    """MediaPipe's network for hands."""
    return landmark_model(HAND_MODEL)
