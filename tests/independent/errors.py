"""The one way in which this reader says no. Written from docs/wire.md alone."""


class ReadError(Exception):
    """These bytes are not what the page describes."""


class EndedError(ReadError):
    """What is refused shows its end, where the cursor stands now: nothing else is lost."""
