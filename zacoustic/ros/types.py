"""ROS types for programs without a configuration: as `TypeSpec`, and as Python classes.

Types of a configuration, with its overlays, are in `Config.types`; the class of one is
`Config.class_of`.
"""

from functools import cache
from pathlib import Path

import msgspec

from zacoustic.core.values.types import TypeSpec, struct_from_type
from zacoustic.ros.interfaces import DEFAULT_DISTRO, Interfaces


def ros_type(name: str, *, distro: str = DEFAULT_DISTRO, packages: Path | None = None) -> TypeSpec:
    """Return the type of a ROS message, without any overlay.

    Args:
        name: ``PACKAGE/msg/Name``, or a part of a service or an action:
            ``PACKAGE/srv/Name_Request``, ``PACKAGE/action/Name_Goal`` and so on.
        distro: The distribution that defines it.
        packages: Folder with the definitions of user packages, or None.

    Raises:
        ConfigError: It is unknown, or the extra is missing.
    """
    return _ros_type(name, distro, packages)


def message_class(
    name: str, *, distro: str = DEFAULT_DISTRO, packages: Path | None = None
) -> type[msgspec.Struct]:
    """Return a class for a ROS message; every field has a default. Arguments as for `ros_type`.

    Raises:
        ConfigError: It is unknown, or the extra is missing.
    """
    return struct_from_type(ros_type(name, distro=distro, packages=packages))


@cache
def _ros_type(name: str, distro: str, packages: Path | None) -> TypeSpec:
    interfaces = Interfaces(distro, packages)
    interfaces.members(name)
    from zacoustic.ros.mapping import TypeMapper

    return TypeMapper(interfaces).map(name).spec
