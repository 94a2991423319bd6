"""The section `plugins.acoustic` of a Zenoh config: a node and the streams that cross the channel.

One JSON5 file serves a router, a gateway beside one, a node without Zenoh, and a whole fleet:
Zenoh's settings stay Zenoh's, the section is ours, and arguments give what differs between nodes
(address, locator of the modem). Reading has four parts, one module each:

- `sections`: the section as written, one record per table; each field declares what its key may be;
- `problems`: errors as one line: file, key path, value, allowed values, what to do;
- `references`: looks up the nodes and links to which values refer;
- `reading`: from the records to a `Config`: addresses, names, types, the stream table. It and the
  modules beside it check what needs two keys.

Nothing is ignored: an unknown key is an error. Whatever the section holds, the result is a `Config`
or a `ConfigError`.
"""

from zacoustic.config.reading import Config, config_from_mapping, read_config
from zacoustic.config.sections import LinkEntry

__all__ = ["Config", "LinkEntry", "config_from_mapping", "read_config"]
