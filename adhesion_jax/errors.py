"""The exceptions whose messages are written for the user."""


class InputError(ValueError):
    """Something the user gave cannot be used.

    The message is one sentence that names what was given (the file, column and row, or the
    option) and says what would be right. A command prints it and ends with exit status 2.
    """


def cannot_write(folder: object, reason: str | None) -> InputError:
    """The refusal of a folder for results."""
    return InputError(f"--out {folder} cannot be written to ({reason}); name a folder that can.")


class WorkerError(Exception):
    """A worker process came to an end before its work did; the message is for the user."""
