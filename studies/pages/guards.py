"""Words of the pages that were written for certain results."""


def must_hold(holds: bool, words: str) -> None:
    """Check that words written for earlier results are still true of the committed ones.

    Raises:
        ValueError: the words do not follow from the results that are committed now.
    """
    if not holds:
        raise ValueError(f"'{words}' no longer follows from the committed results")
