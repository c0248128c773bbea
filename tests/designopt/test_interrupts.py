"""Interrupts come through, whatever is running, and end a process without a crash."""

import os
import signal
import sys
import time

import pytest

from designopt.interrupts import deferred, interruptible
from tests.commands import python

SIGNALS = [signal.SIGINT, signal.SIGTERM]


class Interrupting:
    """Its destructor is interrupted, and Python swallows what is raised there."""

    def __init__(self, number):
        self.number = number

    def __del__(self):
        os.kill(os.getpid(), self.number)
        time.sleep(0.01)


class Failing:
    def __del__(self):
        raise ValueError("in a destructor")


@pytest.mark.parametrize("number", SIGNALS)
def test_an_interrupt_that_a_destructor_swallows_is_raised_again(capsys, number):
    with pytest.raises(KeyboardInterrupt), interruptible():  # noqa: PT012
        Interrupting(number)
        time.sleep(60)
    assert capsys.readouterr() == ("", "")


def test_it_can_be_raised_at_a_place_of_choice():
    with interruptible() as check:
        check()
        Interrupting(signal.SIGINT)
        with pytest.raises(KeyboardInterrupt):
            check()


def test_other_faults_of_destructors_are_reported_as_ever(monkeypatch):
    reported = []
    monkeypatch.setattr(sys, "unraisablehook", lambda one: reported.append(str(one.exc_value)))
    with interruptible():
        Failing()
    assert reported == ["in a destructor"]


@pytest.mark.parametrize("number", SIGNALS)
def test_deferred_interrupts_raise_nothing(number):
    before = signal.getsignal(number)
    with deferred() as is_interrupted:
        assert not is_interrupted()
        os.kill(os.getpid(), number)
        time.sleep(0.01)
        assert is_interrupted()
    assert signal.getsignal(number) == before


LEAVING = """
import atexit, os, signal, sys
from designopt.interrupts import deferred, leave

atexit.register(print, "torn down")
with deferred():
    if sys.argv[1] == "interrupted":
        os.kill(os.getpid(), signal.SIGINT)
print("flushed")
leave(3)
"""


@pytest.mark.parametrize(
    ("how", "out"), [("interrupted", "flushed\n"), ("at last", "flushed\ntorn down\n")]
)
def test_an_interrupted_process_ends_without_python_being_torn_down(how, out):
    done = python("-c", LEAVING, how)
    assert (done.returncode, done.stdout, done.stderr) == (3, out, "")
