"""Objects: payloads larger than a frame, to megabytes.

An object is cut into fragments and erasure coded (`code`): the sender sends the source fragments,
asks what the receivers lack, and sends as many repair fragments as that takes, until every receiver
has confirmed (`outgoing`, `incoming`). Both ends write down what they have (`stored`), so either
may be killed at any instant. `objects` is what the engine sees; docs/wire.md, section "Objects", is
normative.

What it reaches between whole engines, in % of the bit rate of a modem that takes 0.951 s for a full
frame of 64 bytes and is 1 s away, with 10 KiB (tests/benchmarks/bench_objects.py, 200 seeds):

====================  ======  ======  ======  ======
frames lost              0 %    20 %    30 %    50 %
====================  ======  ======  ======  ======
with listen windows       84      66      57      40
exclusive                 92      72      62      43
====================  ======  ======  ======  ======

======================  ============================================================================
`objects`               the engine's view
`sending`, `outgoing`   which object is next; one of them, its rounds and questions
`receiving`, `replies`  what is kept, and when to speak of it
`incoming`, `endings`   one object that arrives, from fragments to the payload; those that are over
`planning`, `timing`    how many repair fragments; the durations, the listen windows
`code`, `galois`        the erasure code
`manifest`, `wire`      what an object is; the two records
`stored`, `progress`    what is written down; what the application hears
======================  ============================================================================
"""
