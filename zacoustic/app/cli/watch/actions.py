"""The verb `zacoustic action list`: the actions of gateways."""

from zacoustic.app.cli.watch.topics import StreamsCommand

_EXAMPLE = """It costs no airtime.

example:
  zacoustic action list --connect tcp/127.0.0.1:7447
"""


class ActionsCommand(StreamsCommand):
    """Lists the actions of gateways, once."""

    summary = "the actions that cross the channel: how often, what waits"
    kind = "action"
    example = _EXAMPLE
