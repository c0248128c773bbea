"""Global settings of the test run: what the library must bear, and must never set itself."""

import gc
import os
import signal
import sys

# Most of a test's time is compiling. XLA compiles in two thirds of the time with these flags, which
# belong to the jaxlib of constraints.txt (another one may not have them and stop), and with few
# optimisations. Tests selected by ``as_users`` are compiled as users compile. JAX reads these
# settings when it is loaded; the processes and commands of a test run inherit them.
QUICK_TO_COMPILE = {
    "XLA_FLAGS": "--xla_cpu_use_fusion_emitters=false --xla_cpu_parallel_codegen_split_count=1",
    "JAX_DISABLE_MOST_OPTIMIZATIONS": "true",
}
if "PYTEST_XDIST_WORKER" not in os.environ and not any("as_users" in one for one in sys.argv):
    for name, value in QUICK_TO_COMPILE.items():
        os.environ.setdefault(name, value)

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
    """Keep what is compiled for the other processes, the commands tests start, and the next run."""
    settings = {
        "jax_compilation_cache_dir": str(config.cache.mkdir("jax")),
        "jax_persistent_cache_min_compile_time_secs": 1.0,
    }
    os.environ["DESIGNOPT_CACHE"] = "off"  # JAX's own takes its place
    for name, value in settings.items():
        jax.config.update(name, value)
        os.environ[name.upper()] = str(value)


@pytest.fixture(autouse=True)
def _commands_keep_nothing_for_other_tests(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("designopt.compilation_cache.STORES", [])


def pytest_sessionfinish() -> None:
    """Collect garbage once: pytest does it five times, which takes 8 s after all of the tests."""
    gc.collect()
    gc.freeze()


# Compiling makes a first example slow; the same examples every time keep the suite reproducible.
hypothesis.settings.register_profile("suite", deadline=None, derandomize=True, max_examples=50)
hypothesis.settings.load_profile("suite")

# Hypothesis also draws constants that it finds in the modules a process has imported so far, so
# that examples would depend on which other tests the process ran before.
providers._get_local_constants = Constants
