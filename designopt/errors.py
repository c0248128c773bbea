"""The one error a user can cause, an end that a user asked for, and texts for their messages."""

from typing import Any


class UserError(Exception):
    """A fault in what a person wrote; its text names the place, the key and the cure in one line.

    The command line prints it as ``error: …`` and exits with code 2, without a traceback.
    """


class Interrupted(Exception):  # noqa: N818 - an end, and no error
    """Ctrl-C or SIGTERM ended a command that keeps what it has; its text lists that, in one line.

    The command line prints it and exits with code 130.
    """


def shortened(text: str, most: int = 60) -> str:
    """A text for a message; of one that is longer than ``most`` characters only its ends."""
    half = (most - 3) // 2
    return text if len(text) <= most else f"{text[:half]}...{text[-half:]}"


def one_line(text: str) -> str:
    """A text in one line for a terminal, whatever it holds of names and files."""
    line = " ".join(text.split())
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in line)


def load_plug_in(point: Any, what: str) -> Any:
    """What an installed package offers at an entry point.

    Args:
        point: an ``EntryPoint``, also that of the backport ``importlib_metadata``.
        what: the kind of plug-in, for the message.

    Raises:
        UserError: it cannot be imported.
    """
    try:
        return point.load()
    except Exception as error:  # a plug-in is anyone's code: whatever it raises, name its package
        raise UserError(
            f"{what} '{point.name}' ({point.value}) cannot be loaded: {reason_of(error)}; "
            "repair or uninstall the package that offers it"
        ) from error


def reason_of(error: Exception) -> str:
    """The text of an exception of somebody else's code in one line, or its type if it has none."""
    return " ".join(str(error).split()) or type(error).__name__
