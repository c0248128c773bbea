"""What JAX has compiled is kept as long as it serves, and forgotten when it only fills memory."""

import jax
import jax.numpy as jnp

from designopt.sweep import compiled_programs


def test_programs_that_points_share_are_kept_and_others_forgotten(monkeypatch):
    forgotten = []
    monkeypatch.setattr(jax, "clear_caches", lambda: forgotten.append(True))
    programs = compiled_programs.Compiled()

    def compile_one(seconds):
        jax.monitoring.record_event_duration_secs(f"{compiled_programs.COMPILING}any", seconds)
        jax.monitoring.record_event_duration_secs("/other", 1e6)
        programs.task_is_done()

    def tasks_until_forgotten(seconds):
        forgotten.clear()
        for count in range(100):
            compile_one(seconds)
            if forgotten:
                return count + 1
        return None

    compile_one(1.0)
    assert tasks_until_forgotten(0.0) is None
    assert tasks_until_forgotten(0.5) == 21
    # The next task is the first again.
    compile_one(8.0)
    assert tasks_until_forgotten(1.0) == 81


def test_jax_tells_of_its_compiling():
    heard = []
    jax.monitoring.register_event_duration_secs_listener(
        lambda event, duration_secs, **_: heard.append((event, duration_secs))
    )
    jax.jit(lambda x: jnp.sin(x) + 3)(1.0)
    assert (
        sum(seconds for event, seconds in heard if event.startswith(compiled_programs.COMPILING))
        > 0
    )
