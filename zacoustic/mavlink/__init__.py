"""MAVLink across the channel: a bridge beside the autopilot, another one beside the ground station.

MAVLink expects a link on which a heartbeat a second and a repeated command cost nothing. On this
channel they cost everything, so no MAVLink packet crosses. What crosses is what the packets say, as
streams that any Zenoh program may use as well (`entries`)::

    autopilot ⇄ vehicle bridge ⇄ Zenoh ⇄ gateway ~~~ gateway ⇄ Zenoh ⇄ shore bridge ⇄ ground station

    high_latency2   topic     the state of the vehicle, dense
    ground          topic     a ground station is there
    arm, mode, waypoint, abort   services: one call for each command, its answer the autopilot's

The bridges are programs of their own, on the local networks of the two gateways, and use nothing
that other programs cannot use.

Two engines hold all rules: `autopilot.AutopilotSide` and `station.StationSide`. They are functions
of their inputs, with instants in ns as arguments. The shells `vehicle` and `shore` connect them to
a `Node` and to a `port`. Three rules must survive every change:

1. *Only the autopilot accepts.* The shore bridge says ACCEPTED when the answer of the autopilot has
   crossed, and never by itself. Whatever ends otherwise says whether the command may have been
   executed.
2. *Old is not shown as new.* Each side sends heartbeats in the name of the other one only while it
   hears the other one. So the failsafe of the autopilot, and the alarm of the ground station, act
   as on any MAVLink link.
3. *One command is one call.* A ground station repeats what is not acknowledged within a second or
   three; repetitions share the call and its answer, until another command is given. A command that
   a later one has overtaken on the channel is not executed, nor one whose call has timed out on
   shore: it carries the time of the vehicle (`vehicletime`). An abort always is.

`dialect` alone imports pymavlink (extra `mavlink`).
"""
