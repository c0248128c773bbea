"""Global settings of the test run: what the library must bear, and must never set itself."""

import hypothesis
import jax
import pytest

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_rank_promotion", "raise")
jax.config.update("jax_numpy_dtype_promotion", "strict")


@pytest.fixture
def quick_table1() -> list[str]:
    """Settings with which ``table1`` runs in seconds, every part of it included."""
    return ["--set", "precision_problems=300", "--set", "precision_repeats=3"]


# Compiling makes a first example slow; the same examples every time keep the suite reproducible.
hypothesis.settings.register_profile("suite", deadline=None, derandomize=True, max_examples=50)
hypothesis.settings.load_profile("suite")
