"""The AT grammar of an S2C modem in both directions; without the state of a modem or a clock.

- `commands`, `notifications`, `usbl`, `replies`, `refusals`, `messages`: the records. The
  annotation of each field names its kind and its limits, which are in `fields`.
- `table`: one row for each record, with its words and the order of its fields. Both directions
  follow from it (`zacoustic.link.forms`), so driver and emulator cannot disagree.
- `framing`, `stream`: lines, packets, headers of payloads; the limits of each.
- `decoder` (`AtDecoder`, a modem's bytes), `command_decoder` (`CommandDecoder`, a host's bytes),
  `encoder` (both directions), `answers` (an answer by its command).
- `settings`, `firmware`: the numbers of a modem, and what differs between its firmwares.

Modules with many records in them import `commands as asked` and `notifications as said`: the prefix
tells which side a record is from.
"""
