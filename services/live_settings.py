"""Settings of meetings over WebRTC: how many, and how their connections come about."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, SecretStr, model_validator

from services.setting_groups import Group, Texts


class LiveSettings(Group):
    """Pictures and voices of meetings over WebRTC."""

    max_viewers: int = Field(
        default=8,
        ge=1,
        validation_alias="METANERF_MAX_VIEWERS",
        description="Viewers served live at once by this process.",
    )
    max_voices: int = Field(
        default=200,
        ge=1,
        validation_alias="METANERF_MAX_VOICES",
        description="Voice connections served at once by this process.",
    )
    renderers: Literal["here", "processes", "ray"] = Field(
        default="here",
        validation_alias="METANERF_RENDERERS",
        description="What draws for viewers: a thread of the gateway, children of it, or actors "
        "of the cluster of METANERF_RAY_ADDRESS.",
    )
    renderer_count: int = Field(
        default=1,
        ge=1,
        validation_alias="METANERF_RENDERER_COUNT",
        description="Children or actors that draw at once; one more is kept warm.",
    )
    renderer_viewers: int = Field(
        default=4,
        ge=1,
        validation_alias="METANERF_RENDERER_VIEWERS",
        description="Viewers that each of them draws for.",
    )
    renderer_idle_s: float = Field(
        default=60.0,
        ge=0.0,
        validation_alias="METANERF_RENDERER_IDLE_S",
        description="Time without anybody to draw for after which they end, s.",
    )
    ice_servers: Texts = Field(
        default_factory=list,
        validation_alias="METANERF_ICE_SERVERS",
        description="STUN addresses, for browsers and for this process's own connections.",
    )
    turn_urls: Texts = Field(
        default_factory=list,
        validation_alias="METANERF_TURN_URLS",
        description="Addresses of the TURN server, given to browsers with credentials.",
    )
    turn_secret: SecretStr | None = Field(
        default=None,
        validation_alias="METANERF_TURN_SECRET",
        description="What the TURN server calls static-auth-secret; credentials are made of it.",
    )
    stamp_pictures: bool = Field(
        default=False,
        validation_alias="METANERF_STAMP_PICTURES",
        description="Show in each picture's corner when it was captured, to measure latency.",
    )

    @model_validator(mode="after")
    def _relays_come_with_credentials(self) -> LiveSettings:
        for variable, urls, schemes in (
            ("METANERF_ICE_SERVERS", self.ice_servers, ("stun:", "stuns:")),
            ("METANERF_TURN_URLS", self.turn_urls, ("turn:", "turns:")),
        ):
            for url in urls:
                if not url.startswith(schemes):
                    raise ValueError(
                        f"{variable} must hold addresses that begin with {' or '.join(schemes)}; "
                        f"got {url!r}; TURN belongs into METANERF_TURN_URLS, STUN into "
                        "METANERF_ICE_SERVERS"
                    )
        if bool(self.turn_urls) != (self.turn_secret is not None):
            raise ValueError(
                "METANERF_TURN_URLS and METANERF_TURN_SECRET must be set both or neither; got only "
                f"{'the addresses' if self.turn_urls else 'the secret'}"
            )
        return self
