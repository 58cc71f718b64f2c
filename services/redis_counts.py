"""How often callers asked all gateways together, by Redis; see `services.limits`."""

from __future__ import annotations

import hashlib

import redis
from redis.backoff import NoBackoff
from redis.retry import Retry

from services.limits import WINDOW_S
from services.redis_outage import Outage

_ANSWER_S = 0.2
"""It answers in milliseconds or is away: every request waits for it."""
_PREFIX = "metanerf:rate:"
_TAKE = """
local now, step, window = tonumber(ARGV[1]), tonumber(ARGV[2]), tonumber(ARGV[3])
local before = math.min(tonumber(redis.call('GET', KEYS[1]) or '0'), now + window)
local free = math.max(now, before) + step
local wait = free - now - window
if wait > 1e-6 then return string.format('%.6f', wait) end
redis.call('SET', KEYS[1], string.format('%.6f', free), 'PX', math.ceil((free - now) * 1000))
return '0'
"""
"""`RateLimit`'s own rule, in one step. A caller who has waited long enough is forgotten, and a
gateway whose clock is ahead costs nobody more than a minute."""


class RedisCounts:
    """Counts that gateways share. While Redis is away there are none."""

    def __init__(self, url: str) -> None:
        self._client = redis.Redis.from_url(
            url,
            socket_connect_timeout=_ANSWER_S,
            socket_timeout=_ANSWER_S,
            retry=Retry(NoBackoff(), 0),
        )
        self._take = self._client.register_script(_TAKE)
        self._outage = Outage("counting requests in each gateway")

    def take(self, what: str, caller: str, now_s: float, step_s: float) -> float | None:
        """As `services.limits.SharedCounts.take`."""
        if self._outage.pauses():
            return None
        # an address is nobody's business there
        who = hashlib.sha256(f"{what}\n{caller}".encode()).hexdigest()[:32]
        try:
            wait_s = float(self._take(keys=[_PREFIX + who], args=[now_s, step_s, WINDOW_S]))
        except redis.RedisError as error:
            self._outage.begin(error)
            return None
        self._outage.end()
        return wait_s

    def close(self) -> None:
        """Let go of connections."""
        self._client.close()
