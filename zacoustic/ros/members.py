"""The members of a ROS interface, exactly as defined."""

from typing import Final

import msgspec

UNSUPPORTED: Final = ("wstring", "wchar", "char", "float128")
"""Types that cannot cross. This `char` is that of ``.idl`` files; that of a ``.msg`` is a uint8."""

BASE_TYPES: Final = (
    "bool", "byte", "char", "float32", "float64",
    "int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64", "string",
)  # fmt: skip
"""Types that are not interfaces."""

NO_MEMBER: Final = "structure_needs_at_least_one_member"
"""The only member of an interface without members: a byte without meaning."""


class Member(msgspec.Struct, frozen=True, kw_only=True):
    """One member."""

    name: str
    """Its name in the definition."""
    type: str
    """One of `BASE_TYPES`, or the name of an interface."""
    most_characters: int = 0
    """Bound of a string; 0: none."""
    is_array: bool = False
    """It is an array of fixed length."""
    is_sequence: bool = False
    """It is a sequence, bounded if `count` is above 0."""
    count: int = 0
    """Length of an array; bound of a sequence, 0: none."""

    @property
    def is_nested(self) -> bool:
        """Whether the type is an interface."""
        return self.type not in BASE_TYPES


Members = tuple[Member, ...]
"""The members of one interface, in order."""

PLACEHOLDER: Final[Members] = (Member(name=NO_MEMBER, type="uint8"),)
"""The members of an interface without any."""
