"""The Zenoh session: what a gateway and a node share of it.

- `session`: an open session; `explain`: why there is none; `worker`, `exitguard`: the thread for
  calls that may block, and its end with the process;
- `doorbell`: the wake-up from Zenoh's threads to the loop;
- `asking`: queries of others, and own ones: calls, goals, commands;
- `latching`: publishers that keep samples for late joiners, and subscribers that ask for them;
- `values`, `marker`: payloads, and the attachments of a gateway.

Nothing of Zenoh's may be on a thread when the interpreter ends: a thread that comes back to it from
foreign code is ended there, and that aborts the process. Hence closing waits for all of them.
"""
