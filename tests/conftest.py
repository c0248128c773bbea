"""Global settings of the test run: what the library must bear, and must never set itself."""

import gc
import os
import signal
import sys

# Other ways for XLA to make its code, which compile in two thirds of the time; read when JAX is
# loaded. They belong to the jaxlib of constraints.txt: another one may not know them and stop.
# With ``-m slow`` tests run what users run; processes of a test run inherit what its first one set.
QUICK_TO_COMPILE = "--xla_cpu_use_fusion_emitters=false --xla_cpu_parallel_codegen_split_count=1"
if "PYTEST_XDIST_WORKER" not in os.environ and "slow" not in sys.argv:
    os.environ.setdefault("XLA_FLAGS", QUICK_TO_COMPILE)

# Tracing makes so many objects that looking for those that hold each other, as often as Python
# does by default, takes a fifteenth of the time and finds next to nothing.
gc.set_threshold(100_000, 50, 1000)

# Who starts the tests in the background has them ignore interrupts, and so would every command that
# a test starts in order to interrupt it.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

import hypothesis  # noqa: E402
import jax  # noqa: E402
import pytest  # noqa: E402
from hypothesis.internal.conjecture import providers  # noqa: E402
from hypothesis.internal.constants_ast import Constants  # noqa: E402

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_rank_promotion", "raise")
jax.config.update("jax_numpy_dtype_promotion", "strict")


def pytest_configure(config: pytest.Config) -> None:
    """Most of a test's time is compiling.

    What is compiled is kept, for files that run in different processes and for the next run. By
    default it is compiled with few optimisations; with ``-m slow`` as users compile it.
    """
    jax.config.update("jax_compilation_cache_dir", str(config.cache.mkdir("jax")))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.2)
    jax.config.update("jax_disable_most_optimizations", config.option.markexpr == "not slow")


# Compiling makes a first example slow; the same examples every time keep the suite reproducible.
hypothesis.settings.register_profile("suite", deadline=None, derandomize=True, max_examples=50)
hypothesis.settings.load_profile("suite")

# Hypothesis also draws constants that it finds in the modules a process has imported so far, so
# that examples would depend on which other tests the process ran before.
providers._get_local_constants = Constants
