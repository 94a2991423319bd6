"""EvoLogics S2C modems: the AT interface of a modem, read and written from both ends.

From the bottom up:

- `framing`: lines, packets, headers of payloads; the limits of each.
- `fields`, `layouts`: what stands between commas, and which record has which fields.
- `commands`, `notifications`, `usbl`, `replies`, `messages`: the records.
- `decoder` (`AtDecoder`, a modem's bytes), `command_decoder` (`CommandDecoder`, a host's bytes),
  `encoder` (both directions), `answers` (what the text of a reply means), `settings`.
- The driver: `config`; `dialogue` (the state machine) with `dialogue_channel` (one command in
  flight), `startup` (finding the modem and making it ready), `sending` (one frame), `session` (what
  is known and measured); `link` (`EvologicsLink`, port and timer).
"""

from zacoustic_evologics.answers import ReplyCollector, decode_reply, reply_text
from zacoustic_evologics.command_decoder import CommandDecoder
from zacoustic_evologics.config import EvologicsConfig
from zacoustic_evologics.decoder import AtDecoder
from zacoustic_evologics.dialogue import AtDialogue
from zacoustic_evologics.encoder import command_name, encode_command, encode_message
from zacoustic_evologics.framing import SERIAL_LINE_END, TCP_LINE_END, Framing, Interpreter
from zacoustic_evologics.link import EvologicsLink
from zacoustic_evologics.settings import SETTINGS

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
