"""Cases that stand in a file of data."""

from typing import Any

from tests.helpers import load_toml


def cases(table: str) -> list[Any]:
    """A table of ``tests/data/designopt_cases.toml``."""
    return load_toml("designopt_cases.toml")[table]
