"""Actions: a goal crosses, feedback comes while it is pursued, and one end is told: the result.

The words are those of ROS 2. A *goal* is accepted or rejected by its server. While it runs, its
client gets *feedback*, the newest only, and may ask to *cancel* it. It ends *succeeded*, *canceled*
or *aborted*, each with a *result*; or its server died meanwhile, and what became of it is unknown.

The problem: a goal may take hours, and the modems hear each other for minutes. Either computer may
be restarted meanwhile. A goal that runs twice is a vehicle that goes out a second time, so nothing
may ever begin again by itself; and whoever sent it must be told one end of it.

The idea. A goal is named by client, the client's boot epoch, stream and *number* (`GoalKey`).

- The client repeats the goal until the server has answered; it cancels at the highest priority,
  again and again until that is answered; it confirms the result. It writes down which goals it has
  sent, so that its next life asks what became of them (`CLAIM`). It never sends a goal again that a
  former life has sent.
- The server writes a goal down before it shows it to the application. It repeats the result until
  it is confirmed, and keeps it for `result_timeout_s`. What ran when the server died ends UNKNOWN.
- The client counts its attempts to cancel a goal. The server shows each to the application once and
  answers its repetitions as the application did, however late they come.
- Feedback is sent once: of what waits, only the newest, and not more often than the action allows.
- A client that has heard nothing of a goal for half of `result_timeout_s` asks; after all of it, it
  gives the goal up.

Five bits name a goal of one life of a client on one stream (`numbers`). A record about a goal of a
*former* life carries its epoch. That is so as well after an epoch that begins without a restart, so
goals survive it.

- `news`: the events; `zacoustic.core.wire.goals` has the records, and the words in both.
- `numbers`: which of the 32 numbers are free.
- `outbox`: gets records about goals onto the queue.
- `client`, `clientgoal`, `clientletters`, `clientjournal`: the goals that this node has sent.
- `server`, `servedgoal`: the goals that this node pursues.
- `actions`: both, and what the application and the channel say to them.
"""
