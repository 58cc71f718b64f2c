"""How much one account may keep: what it has is counted anew whenever it asks for more.

Bytes are what the store holds of the account's people, so that nothing has to be kept in step; what
others recorded of them counts, too, and goes with their part in the recording.
"""

from __future__ import annotations

from services.container import Services
from services.errors import QuotaReached

_GIB = 1 << 30


def require_room(
    services: Services,
    account: str,
    *,
    people: int = 0,
    sequences: int = 0,
    models: int = 0,
    more_bytes: int = 0,
) -> None:
    """Raise QuotaReached where so many more would be beyond what an account may have."""
    quotas = services.settings.quotas
    with services.reading() as unit:
        held = unit.people.holdings(account)
    for what, wanted, has, most, mend in (
        ("people", people, len(held.people), quotas.people, "erase one"),
        ("clips", sequences, held.sequences, quotas.sequences, "delete one"),
        ("models", models, held.models, quotas.models, "erase a person, or cancel a training"),
    ):
        if wanted and has + wanted > most:
            raise QuotaReached(
                f"an account may have at most {most} {what}; got {has} and {wanted} more; {mend} "
                "of yours, or ask the server's keeper for more"
            )
    if more_bytes or sequences or models:
        used = held.coming_bytes + sum(
            one.bytes for person in held.people for one in services.objects.list(person)
        )
        if used + more_bytes > quotas.bytes:
            raise QuotaReached(
                f"an account may keep at most {quotas.bytes / _GIB:.3g} GiB; got "
                f"{used / _GIB:.3g} GiB and {more_bytes / _GIB:.3g} GiB more; delete clips that "
                "models were made of, uploads that you gave up, or people, or ask the server's "
                "keeper for more"
            )
