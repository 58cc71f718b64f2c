"""The checker of array annotations, with ints accepted as floats as PEP 484 has it."""

from __future__ import annotations

from beartype import BeartypeConf, beartype

typecheck = beartype(conf=BeartypeConf(is_pep484_tower=True))
