"""Range checks of the records that a scenario consists of: one wording for all of them."""


def check_range(key: str, value: float, low: float, high: float) -> None:
    """Check that a value lies within its limits, both included.

    Args:
        key: What the message calls the value.
        value: The value; NaN is outside every range.
        low: Smallest allowed value.
        high: Largest allowed value.

    Raises:
        ValueError: It does not; the message begins with the key.
    """
    if not low <= value <= high:
        raise ValueError(f"{key} is {value!r}; allowed: {low:g}..{high:g}")
