"""ROS 2 without ROS: names, types, hashes and bytes as nodes on rmw_zenoh have them.

The problem: a ROS 2 system on rmw_zenoh puts its messages on Zenoh in CDR, under keys, with
attachments and liveliness tokens of its own. A gateway has to write all of it exactly so, without a
ROS installation: it is a small computer in a pressure housing.

The idea: the interface definitions come from `rosbags`, which ships those of every distribution,
and from folders of ``.msg``, ``.srv`` and ``.action`` files. Everything else is text and a few
bytes. Only the values cross the channel, as `TypeSpec` has them, so a ROS type can be packed and
dense like any other.

Modules:

- `names`: ROS names, DDS type names and the keys of rmw_zenoh;
- `attachment`: the attachment of each message; `tokens`: the tokens that make an entity visible;
  `qos`: the text of a QoS profile in a token;
- `members`: the members of an interface; `parsing`: reads definitions from files; `shipped`: common
  services and actions; `interfaces`: `Interfaces`, all that one distribution knows;
- `hashes`: RIHS01, the hash of a type;
- `overlays`: bounds, steps and constants that a ROS definition lacks; `mapping`: a ROS message as a
  `TypeSpec`; `messages`: `RosMessage`, CDR to values and back; `streams`: a stream's ROS entities;
- `types`: `ros_type` and `message_class`, for programs without a configuration.

`interfaces` and `messages` need `rosbags`, `tokens` needs `xxhash`: the extra ``ros``.
They are imported on first use; if one is missing, the error names the extra.
"""

from zacoustic.ros.types import message_class, ros_type

__all__ = ["message_class", "ros_type"]
