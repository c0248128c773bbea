"""The one answer type: success, messages, batches."""

import equinox as eqx
import jax
import jax.numpy as jnp

from designopt import Solution, combine_checks


class Outcome(eqx.Enumeration):
    successful = ""
    negative = "The argument is negative: make it positive."


def solve(x):
    result = Outcome.where(x > 0, Outcome.successful, Outcome.negative)
    return Solution(jnp.sqrt(jnp.abs(x)), x, jnp.zeros_like(x), result)


def test_a_code_that_was_never_computed_has_its_message_too():
    one = jnp.asarray(1.0)
    assert Solution(one, one, one, Outcome.negative).messages() == [Outcome[Outcome.negative]]
    assert Solution(one, one, one, Outcome.successful).messages() == [""]
    two = jnp.ones(2)
    assert Solution(two, two, two, Outcome.negative).messages() == 2 * [Outcome[Outcome.negative]]


def test_a_batch_says_which_failed_and_why():
    found = jax.jit(jax.vmap(solve))(jnp.asarray([1.0, -1.0, 4.0]))
    assert found.ok.tolist() == [True, False, True]
    assert found.messages() == ["", Outcome[Outcome.negative], ""]
    assert found.failures() == {Outcome[Outcome.negative]: 1}


def test_the_first_failure_counts_and_the_least_margin():
    class Faults(eqx.Enumeration):
        successful = ""
        first = "first"
        second = "second"

    def judge(a, b):
        margin, code = combine_checks(Faults.successful, (a, Faults.first), (b, Faults.second))
        return Solution(a, margin, jnp.zeros_like(a), code)

    found = jax.vmap(judge)(jnp.asarray([1.0, -1.0, 1.0, -1.0]), jnp.asarray([2.0, 1.0, 0.0, -2.0]))
    assert found.messages() == ["", "first", "second", "first"]
    assert found.margin.tolist() == [1.0, -1.0, 0.0, -2.0]
