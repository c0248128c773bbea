"""The ``designopt`` command: an exit code, and of whatever goes wrong one line.

Nothing else is loaded before an interrupt can be handled.
"""

from __future__ import annotations

import errno
import gc
import io
import os
import signal
import sys
from contextlib import suppress

from designopt.errors import Interrupted, UserError, one_line, shortened
from designopt.interrupts import interruptible, leave

WRONG = 2
"""Exit code for faults of a person's command, files or machine."""

OUR_FAULT = 70
"""Exit code for a fault of the program: ``EX_SOFTWARE`` of BSD's ``sysexits.h``."""

INTERRUPTED = 130
"""Exit code after Ctrl-C, as shells have it (128 + SIGINT)."""

LONGEST = 4000
"""Characters of a message; of a longer one the middle is left out."""

CURES = {
    errno.ENOSPC: "make room there, or write elsewhere",
    errno.EDQUOT: "make room there, or write elsewhere",
    errno.EROFS: "write elsewhere",
    errno.EIO: "check the disk, or write elsewhere",
    errno.EACCES: "change its permissions, or use another place",
    errno.EMFILE: "allow more open files (ulimit -n)",
    errno.ENFILE: "close other programs",
    errno.ENOMEM: "ask for fewer poses or smaller images, or close other programs",
}
"""What can be done about faults of the machine that any command may meet."""


def main() -> None:
    """Run the command line; the console script's entry point."""
    # Python's own handler would print a traceback just before and after what follows.
    if signal.getsignal(signal.SIGINT) == signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    # Very many objects are made while modules are loaded and JAX traces: a tenth to a quarter of
    # that time would be spent on looking through them.
    gc.set_threshold(50_000, 20, 100)
    # Processes of ours are to import nothing from the folder that the command is started in.
    os.environ.setdefault("PYTHONSAFEPATH", "1")
    code = INTERRUPTED
    with suppress(KeyboardInterrupt), interruptible():
        code = _run_with_streams(sys.argv[1:])
    leave(code)


def run(arguments: list[str]) -> int:
    """Run one command.

    Returns:
        0 when all went well; 1 when the output is complete, but a target is missed or nothing of
        what was asked for exists; 2 for a fault of what was asked for, of a file or of the
        machine; 70 for a fault of the program; 130 when interrupted. Of everything but 0 one line
        on standard error gives the reason.
    """
    try:
        with interruptible() as check:
            try:
                from designopt.cli.app import invoke

                return invoke(arguments, check)
            except Interrupted:
                raise
            except Exception:
                check()  # an interrupt of code that is being loaded may come out as another fault
                raise
    except BrokenPipeError:  # whoever read the output has seen enough
        return 0
    except KeyboardInterrupt:
        _say("interrupted; no file is half-written")
        return INTERRUPTED
    except SystemExit:
        raise
    except BaseException as error:  # compiled extensions have faults that are no Exception
        return _reported(error)


def _run_with_streams(arguments: list[str]) -> int:
    """`run`, and standard output written to its end."""
    if sys.stderr is None:  # closed by whoever started this
        sys.stderr = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115 - open to the end
    if sys.stdout is None:
        _say("error: standard output is closed; send it to a file or to /dev/null")
        return WRONG
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal without Greek letters is no fault
    code = run(arguments)
    try:
        sys.stdout.flush()
    except OSError as error:
        # Python flushes once more at its end.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if not isinstance(error, BrokenPipeError) and code <= 1:
            code = _reported(error)
    return code


def _reported(error: BaseException) -> int:
    """Say in one line what went wrong, and return the exit code."""
    if isinstance(error, Interrupted):
        _say(f"interrupted; {error}")
        return INTERRUPTED
    if clashes := _clashes_behind(error):
        _say(f"error: {'; '.join(clashes)}")
        return WRONG
    if isinstance(error, UserError):
        _say(f"error: {error}")
        return WRONG
    if isinstance(error, OSError) and error.errno in CURES:
        place = error.filename or "output"
        _say(f"error: {place}: {os.strerror(error.errno)}; {CURES[error.errno]}")
        return WRONG
    # JAX has an error of its own for a machine without enough memory.
    if isinstance(error, MemoryError) or "RESOURCE_EXHAUSTED" in str(error):
        _say(f"error: {os.strerror(errno.ENOMEM)}; {CURES[errno.ENOMEM]}")
        return WRONG
    from designopt.fault_files import kept_traceback, short_traceback

    name = f"{type(error).__name__}: {shortened(str(error), 200)}"
    what = f"error: a fault of designopt's own ({name})"
    place = kept_traceback(error)
    if place is None:
        _say(f"{what}; please report it with this: {short_traceback(error)}")
    else:
        _say(f"{what}; please report it with the traceback in {place}")
    return OUR_FAULT


def _clashes_behind(error: BaseException) -> list[str]:
    """Packages of ours that are not as installed, where that may be the reason of an error."""
    cause = error.__cause__ if isinstance(error, UserError) else error
    # A package of somebody else's lacks modules and names; what it has may do anything.
    if not isinstance(cause, (ImportError, AttributeError, TypeError)):
        return []
    from designopt.installation import find_clashes

    return find_clashes()


def _say(message: str) -> None:
    """One line on standard error, whatever a message holds of names and files."""
    line = one_line(message)
    with suppress(OSError):
        try:
            print(shortened(line, LONGEST), file=sys.stderr, flush=True)
        except OSError:
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stderr.fileno())
