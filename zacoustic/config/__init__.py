"""The section `plugins.acoustic` of a Zenoh config: a node, and what crosses the channel.

One JSON5 file serves a router, a gateway beside one, or a node without Zenoh, and a whole fleet:
Zenoh's own settings stay Zenoh's, the section is ours, and what differs between nodes (the address,
the modem's locator) can be given beside it. Reading happens in four steps, one module each:

- `sections`: the section as it is written, one record per table, unknown keys refused;
- `later`: words of the format that this version does not have yet, refused by name;
- `problems`: errors as one line: file, key path, value, allowed values, what to do;
- `reading`: from the records to a `Config`: addresses, names, types, the stream table.

Nothing is ever ignored in silence: a key that is not understood is an error. Whatever the section
holds, the answer is a `Config` or a `ConfigError`.
"""

from zacoustic.config.reading import Config, config_from_mapping, read_config
from zacoustic.config.sections import LinkEntry

__all__ = ["Config", "LinkEntry", "config_from_mapping", "read_config"]
