"""For modules that test what is computed, not how fast: compile in half the time."""

import jax
import pytest


@pytest.fixture(autouse=True, scope="module")
def compiled_quickly():
    jax.config.update("jax_disable_most_optimizations", True)
    yield
    jax.config.update("jax_disable_most_optimizations", False)
