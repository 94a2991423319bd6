"""The AT grammar of an S2C modem, both ways; no state of a modem and no clock.

- `framing`: lines, packets, headers of payloads; the limits of each.
- `fields`, `layouts`: what stands between commas, and which record has which fields.
- `commands`, `notifications`, `usbl`, `replies`, `messages`: the records.
- `decoder` (`AtDecoder`, a modem's bytes), `command_decoder` (`CommandDecoder`, a host's bytes),
  `encoder` (both directions), `answers` (what the text of a reply means), `settings`.
"""
