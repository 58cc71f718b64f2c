"""The server of a load test where it may be several gateways: processes over one PostgreSQL."""

from __future__ import annotations

import secrets
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from datetime import timedelta
from pathlib import Path

from benchmarks.load.host import Host, host_at, own_host, warm_up
from benchmarks.servers import MortalPostgres, MortalRedis, free_port, gateway_at

_ACCOUNT = "crowd"


@contextmanager
def at_hand(
    address: str | None, token: str | None, model_id: str | None, most_people: int, gateways: int
) -> Iterator[Host]:
    """The server at `address`, or one of its own that is warm, of so many gateways."""
    if address is not None:
        yield host_at(address, token, model_id)
        return
    own = own_host(most_people) if gateways == 1 else several_gateways(gateways, most_people)
    with own as host:
        yield host


@contextmanager
def several_gateways(count: int, most_people: int) -> Iterator[Host]:
    """`count` gateways that take so many people each, warm, and a model that may move.

    Raises InvalidInput where PostgreSQL or Redis is not installed.
    """
    from services.auth import ALL_SCOPES
    from services.bootstrap import DEMO_MODEL, import_model
    from services.composition import build_services
    from services.settings import load_settings

    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        folder.chmod(0o755)  # PostgreSQL's own user must reach its rows
        postgres, redis = MortalPostgres(folder / "postgres"), MortalRedis()
        for server in (postgres, redis):
            stack.callback(server.kill)
            server.start()
        settings = load_settings(
            data_dir=folder / "data",
            jwt_secret=secrets.token_hex(32),
            database_url=postgres.url,
            redis_url=redis.url,
            open_access=False,
            embedded_worker=False,
            max_viewers=most_people,
            client_dir=folder / "no-page",
        )
        services = build_services(settings)
        stack.callback(services.close)
        services.database.migrate()
        model = import_model(services, DEMO_MODEL, _ACCOUNT, "Ada")
        token, _ = services.tokens.issue(_ACCOUNT, ALL_SCOPES, timedelta(hours=4))
        addresses = [f"http://127.0.0.1:{free_port()}" for _ in range(count)]
        for address in addresses:
            gateway = gateway_at(address, settings.child_environment())
            stack.callback(gateway.kill)
            gateway.start()
        host = Host(addresses[0], token, model.id, tuple(addresses[1:]))
        warm_up(host)
        yield host
