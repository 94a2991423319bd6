"""The figures of a gateway: one struct a subject, for who counts and for who shows.

A gateway fills the structs from its engine and puts them on its local network as the JSON documents
of its health report. Monitors, the dashboard, the doctor and Prometheus decode the same structs,
so a figure has one name between the engine and a screen, and a new member is written once.

A member's name in Python is the word that screens use; where the JSON has another one, ``field``
names it beside the member. Rules for who adds a member:

- it has a default, so that a gateway of an earlier version can be read;
- unknown is None (null in JSON), never a plausible number;
- a member that a subject may lack by its nature, such as outcomes of a topic that is not reliable,
  is `msgspec.UNSET`: the JSON lacks it;
- an instant is Unix time in seconds, and its name in JSON ends in ``unix_s``: a gateway moves these
  when somebody sets its computer's clock.

The modules: `node` (node, journal, modem, dropped data, events), `link` (links, routes, lists of
links, carried topics, ledger), `peers`, `streams`, `channel` (frames and large samples), `table`
(which document has which struct).
"""
