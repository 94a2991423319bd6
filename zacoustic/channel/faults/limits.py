"""Range checks for the records of a scenario, with one wording for all messages."""


def check_range(key: str, value: float, low: float, high: float) -> None:
    """Check that a value lies within its limits, both included.

    Args:
        key: Name of the value in the message.
        value: The value; NaN is outside every range.
        low: Smallest allowed value.
        high: Largest allowed value.

    Raises:
        ValueError: It is outside; the message begins with the key.
    """
    if not low <= value <= high:
        raise ValueError(f"{key} is {value!r}; allowed: {low:g}..{high:g}")
