"""EvoLogics S2C modems: the AT interface of a modem, read and written from both ends.

From the bottom up:

- `at`: the grammar. Records of the messages of host and modem, decoders and encoders of both.
- `airtime`: durations and pauses, which the driver reckons with and the emulator keeps.
- `driver`: the dialogue with one modem, without a port and without a clock: start-up, one command
  in flight, one frame, the modem's state and measurements.
- `config` and `link` (`EvologicsLink`): the settings of a locator; the port and the timer.
- `emulator`: emulated modems on a simulated channel.
"""

from zacoustic_evologics.at.answers import ReplyCollector, decode_reply, reply_text
from zacoustic_evologics.at.command_decoder import CommandDecoder
from zacoustic_evologics.at.decoder import AtDecoder
from zacoustic_evologics.at.encoder import command_name, encode_command, encode_message
from zacoustic_evologics.at.framing import SERIAL_LINE_END, TCP_LINE_END, Framing, Interpreter
from zacoustic_evologics.at.settings import SETTINGS
from zacoustic_evologics.config import EvologicsConfig
from zacoustic_evologics.driver.dialogue import AtDialogue
from zacoustic_evologics.link import EvologicsLink

__all__ = [
    "SERIAL_LINE_END",
    "SETTINGS",
    "TCP_LINE_END",
    "AtDecoder",
    "AtDialogue",
    "CommandDecoder",
    "EvologicsConfig",
    "EvologicsLink",
    "Framing",
    "Interpreter",
    "ReplyCollector",
    "command_name",
    "decode_reply",
    "encode_command",
    "encode_message",
    "reply_text",
]
