"""The one error a user can cause."""


class UserError(Exception):
    """A fault in what a person wrote; its text names the place, the key and the cure in one line.

    The command line prints it as ``error: …`` and exits with code 2, without a traceback.
    """
