"""The one exception that speaks to the user."""


class InputError(ValueError):
    """Something the user gave cannot be used.

    The message is one sentence that names what was given (the file, column and row, or the
    option) and says what would be right. A command prints it and ends with exit status 2.
    """
