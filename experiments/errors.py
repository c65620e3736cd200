"""Errors that a user can mend, told in one or two lines."""


class InputError(Exception):
    """Wrong usage or input: what is wrong, with the offending value, and what would be right."""


class RunFailedError(Exception):
    """Something that had begun could not go on. A second line may say how it can, later."""
