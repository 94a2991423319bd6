"""The Zenoh session: the parts that a gateway and a node share.

- `session`: an open session, and errors of opening one; `worker`, `exitguard`: the thread for calls
  that may block, and its end with the process;
- `wake_up`: the wake-up from Zenoh's threads to the loop;
- `asking`: queries of other programs and of this one: calls, goals, commands;
- `latching`: publishers that keep samples for late joiners, and subscribers that ask for them;
- `values`, `marker`: payloads, and the attachments of a gateway.

No thread of Zenoh may run when the interpreter ends: a thread that returns to it from foreign code
is ended there, which aborts the process. So closing waits for all of them.
"""
