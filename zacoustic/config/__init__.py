"""The section `plugins.acoustic` of a Zenoh config: a node and the streams that cross the channel.

One JSON5 file serves a router, a gateway beside one, a node without Zenoh, and a whole fleet:
Zenoh's settings stay Zenoh's, the section is ours, and arguments give what differs between nodes
(address, locator of the modem). Reading has four parts, one module each:

- `sections`: the section as written, one record per table; refuses unknown keys;
- `later`: words of the format that this version does not have yet; refused by name;
- `problems`: errors as one line: file, key path, value, allowed values, what to do;
- `reading`: from the records to a `Config`: addresses, names, types, the stream table.

Nothing is ignored: an unknown key is an error. Whatever the section holds, the result is a `Config`
or a `ConfigError`.
"""

from zacoustic.config.reading import Config, config_from_mapping, read_config
from zacoustic.config.sections import LinkEntry

__all__ = ["Config", "LinkEntry", "config_from_mapping", "read_config"]
