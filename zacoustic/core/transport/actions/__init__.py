"""Actions: a goal crosses, feedback comes while it runs, and each end learns one outcome.

The terms are those of ROS 2. A server accepts or rejects a *goal*. While the goal runs, its client
gets *feedback*, the newest only, and may ask to *cancel* it. It ends *succeeded*, *canceled* or
*aborted*, each with a *result*; or its server died meanwhile, and its outcome is unknown.

The problem: a goal may take hours, and the modems hear each other for minutes. Either computer may
restart meanwhile. A goal that runs twice is a vehicle that goes out a second time, so nothing may
ever start again by itself; and the client must learn exactly one outcome.

The idea: client, client boot epoch, stream and *number* identify a goal (`GoalKey`).

- The client repeats the goal until the server has answered. It repeats a cancel at the highest
  priority until that is answered, and it confirms the result. It journals which goals it has sent,
  so that after a restart it asks for their outcome (`CLAIM`). It never sends a goal again that it
  sent before a restart.
- The server journals a goal before it gives it to the application. It repeats the result until it
  is confirmed, and keeps it for `result_timeout_s`. A goal that ran when the server died ends
  UNKNOWN.
- The client counts its attempts to cancel a goal. The server gives each to the application once and
  answers its repetitions as the application did, however late they come.
- Feedback is sent once: of several that wait only the newest, and not more often than the action
  allows.
- A client that has heard nothing of a goal for half of `result_timeout_s` asks; after all of it,
  the client gives the goal up.

Five bits identify a goal of one boot epoch of a client on one stream. A record about a goal of an
*earlier* epoch carries that epoch. This also holds for an epoch that begins without a restart, so
goals survive it.

Numbers, table, journal and repetition are those of every exchange
(`zacoustic.core.transport.exchanges`).

- `events`: the events; `zacoustic.core.wire.goals` has the records and the terms of both.
- `outbox`: queues records about goals.
- `client`, `clientgoal`, `clientrequests`, `clientjournal`: the goals that this node has sent.
- `server`, `servedgoal`: the goals that this node serves.
- `actions`: both, for the application and the channel.
"""
