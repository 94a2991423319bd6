"""The Zenoh session: the parts that a gateway and a node share.

- `session`: opens and closes a session, and explains its errors; `worker`, `exitguard`: the thread
  for calls that may block, and its end with the process;
- `asking`: queries of other programs and of this one: calls, goals, commands;
- `latching`: publishers that keep samples for late joiners, and subscribers that ask for them;
- `values`, `marker`: payloads, and the attachments of a gateway.

No thread of Zenoh may run when the interpreter ends: if a thread then returns to it from foreign
code, the process aborts. So closing waits for all of them.
"""
