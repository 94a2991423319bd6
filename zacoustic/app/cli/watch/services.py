"""The verb `zacoustic service list`: the services of gateways."""

from zacoustic.app.cli.watch.topics import StreamsCommand

_EXAMPLE = """It costs no airtime.

example:
  zacoustic service list --connect tcp/127.0.0.1:7447
"""


class ServicesCommand(StreamsCommand):
    """Lists the services of gateways, once."""

    summary = "the services that cross the channel: how often, what waits"
    kind = "service"
    example = _EXAMPLE
