"""Settings of login by OpenID Connect: which provider knows the people who are let in."""

from __future__ import annotations

import ipaddress
from typing import Annotated
from urllib.parse import urlsplit

from pydantic import BeforeValidator, Field, SecretStr, field_validator, model_validator

from services.setting_groups import Group


def _given(value: object) -> object:
    """What is set; what a deployment leaves empty is not."""
    text = value.get_secret_value() if isinstance(value, SecretStr) else value
    return None if text == "" else value


class LoginSettings(Group):
    """The provider of OpenID Connect, and what this server is known by there: all or nothing."""

    issuer: Annotated[str | None, BeforeValidator(_given)] = Field(
        default=None,
        validation_alias="METANERF_OIDC_ISSUER",
        description="Issuer of the OpenID provider by which people log in; empty: none.",
    )
    client_id: Annotated[str | None, BeforeValidator(_given)] = Field(
        default=None,
        validation_alias="METANERF_OIDC_CLIENT_ID",
        description="What the provider calls this server.",
    )
    client_secret: Annotated[SecretStr | None, BeforeValidator(_given)] = Field(
        default=None,
        validation_alias="METANERF_OIDC_CLIENT_SECRET",
        description="The secret by which the provider knows this server.",
    )

    @field_validator("issuer")
    @classmethod
    def _encrypted(cls, value: str | None) -> str | None:
        if value is None:
            return None
        parts = urlsplit(value)
        plain = parts.scheme == "http" and _is_this_machine(parts.hostname or "")
        if not parts.netloc or not (parts.scheme == "https" or plain) or parts.query:
            raise ValueError(
                "must be the provider's issuer, such as https://login.example.org (http only on "
                f"this machine); got {value!r}"
            )
        return value

    @model_validator(mode="after")
    def _all_or_nothing(self) -> LoginSettings:
        given = [one is not None for one in (self.issuer, self.client_id, self.client_secret)]
        if any(given) and not all(given):
            names = ("METANERF_OIDC_ISSUER", "_CLIENT_ID", "_CLIENT_SECRET")
            missing = ", ".join(name for name, one in zip(names, given, strict=True) if not one)
            raise ValueError(
                "METANERF_OIDC_ISSUER, _CLIENT_ID and _CLIENT_SECRET must be set together; got "
                f"none for {missing}; the provider tells them when you register this server there"
            )
        return self


def _is_this_machine(host: str) -> bool:
    try:
        return host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False
