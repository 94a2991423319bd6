"""Exchanges: a request crosses, an answer comes back, and each end confirms what it has.

The problem: frames are lost, duplicated and late, either end may restart, and what a request asks
for must happen once at most: an arm that moves twice, a vehicle that goes out a second time.

The idea: client, client boot epoch, stream and *number* identify an exchange
(`zacoustic.core.wire.exchanges`). The client repeats its request until the server shows that it has
it, by a confirmation or by the answer. The server executes it once, and repeats the answer until
the client confirms it. A confirmation is said once: whoever lacks it repeats, and is told again.

- *Numbers* are few, so that they cost few bits, and each is used again when both ends know that its
  last use is over (`numbers`).
- *At most once*: the server remembers what it has taken for as long as a copy of the request can
  arrive, in a bounded table (`taken`).
- *Journal*: a request is journalled before it is executed, and an answer before it is sent, if the
  stream says so. After a restart an exchange without an answer has an unknown outcome. An entry
  belongs to one definition of its stream (`journal`).
- *Former lives*: a boot epoch that is over has used the same numbers. The server's table tells them
  apart by its keys. A client takes a record without an epoch only if the server has confirmed the
  client's present epoch; until then the server names the epoch.

Who uses what:

=============  =======  =====  =======  =========  =======
of this room   numbers  taken  journal  repeating  records
=============  =======  =====  =======  =========  =======
calls          yes      yes    yes      yes        yes
commands       yes      yes    yes      yes        yes
actions        yes      yes    yes      yes        QoS
subscriptions  –        –      –        yes        –
=============  =======  =====  =======  =========  =======

What stays apart, since it promises something else:

- Commands are calls. Beside that they have an order (`zacoustic.core.transport.commands`): none is
  executed after a later one about the same object, of whichever call. At most once says nothing
  about two different requests. The order is kept as long as the node that commands is known, not
  only while copies may arrive.
- A subscribe message is a state, and the newest one replaces all others. To execute it twice does
  no harm and to miss an earlier one neither, so it has a version and no number, and its publisher
  keeps the last one in place of a table.
- A client of actions journals its goals too, since it asks for their outcome after a restart; a
  call ends with the process that made it.
- All goals together are limited, calls only those of each client. Commands are calls, and forged
  requests of many addresses must not keep out the one that ends a silence.
- Answers to calls name the epoch in one byte that is written with the answer, if the last copy of
  the request came behind HELLO or TAG. Records about goals, which live through new epochs of their
  client, name it in three bytes, as FORMER, if the frame that takes them finds it needed. Each rule
  is on the wire (docs/wire.md, sections 5 and 12), so they are not one here.
- Requests of rmw_desert are sent once, and its wire names neither client nor epoch
  (`zacoustic.core.profiles.rmw_desert.calls`).

==========  ========================================================================================
`numbers`   the window of numbers of one client on one stream
`taken`     the table of what a server has taken
`journal`   the entries of exchanges in the journal
`repeating` repeats a record until it is stopped
`records`   records that are said once, and the QoS of both kinds
==========  ========================================================================================
"""
