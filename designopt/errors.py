"""The one error a user can cause, an end that a user asked for, and texts for their messages."""


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
