"""Objects: payloads larger than a frame, up to megabytes.

An object is cut into fragments and erasure coded (`code`): the sender sends the source fragments,
asks what the receivers lack, and sends as many repair fragments as that takes, until every receiver
has confirmed (`outgoing`, `incoming`). Both ends journal what they have (`stored`), so either may
be killed at any instant. `objects` is what the engine sees; docs/wire.md, section "Objects", is
normative.

Throughput between whole engines, in % of the bit rate, for 10 KiB and a modem that is 1 s away and
takes 0.951 s for a full frame of 64 bytes (tests/benchmarks/bench_objects.py, 200 seeds):

====================  ======  ======  ======  ======
frames lost              0 %    20 %    30 %    50 %
====================  ======  ======  ======  ======
with listen windows       84      66      57      40
exclusive                 92      72      62      43
====================  ======  ======  ======  ======

======================  ============================================================================
`objects`, `admission`  the engine's view; what objects ask of the other components
`large`                 samples that are larger than a frame, for the topics
`sending`               which object is next; `outgoing` one of them, `planning` its repair
`receiving`             incoming objects; `incoming` one of them, `replies` when to send feedback,
                        `endings` those that have ended
`timing`                the durations, the listen windows
`code`                  the erasure code
`manifest`, `limits`    what an object is; how much memory objects may take
`stored`, `progress`    the journal entries; the events for the application
======================  ============================================================================
"""
