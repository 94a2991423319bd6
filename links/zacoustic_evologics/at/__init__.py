"""The AT grammar of an S2C modem in both directions; without the state of a modem or a clock.

- `framing`: lines, packets, headers of payloads; the limits of each.
- `fields`, `layouts`: the kinds of fields, and the fields of each record.
- `commands`, `notifications`, `usbl`, `replies`, `messages`: the records.
- `decoder` (`AtDecoder`, a modem's bytes), `command_decoder` (`CommandDecoder`, a host's bytes),
  `encoder` (both directions), `answers` (the meaning of a reply's text), `settings`.
"""
