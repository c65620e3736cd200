"""Errors that a user can fix; their messages have one or two lines."""


class InputError(Exception):
    """Wrong usage or input; the message names the offending value and says what would be right."""


class RunFailedError(Exception):
    """Something that had begun could not go on. A second line may say how it can, later."""
