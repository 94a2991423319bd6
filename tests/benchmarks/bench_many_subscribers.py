"""What acknowledging a broadcast costs with many subscribers: a reliable topic of one publisher.

    .venv/bin/python tests/benchmarks/bench_many_subscribers.py [--seeds 3] [--agreement confirm]

Twenty bytes every 120 s for an hour to 2, 5, 10, 20 and 40 subscribers in a square of 3 km of sea.
With `reports` each subscriber also tells all a report of ten bytes every 120 s, on which an
acknowledgement can ride.
"""

import argparse
import statistics
import sys
from pathlib import Path
from typing import Final

sys.path.insert(0, str(Path(__file__).parents[2]))

from tests.virtual.manysubscribers import Cost, run_subscribers
from zacoustic.core.peers.agreementpolicy import AgreementMethod

SUBSCRIBERS: Final = (2, 5, 10, 20, 40)


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--subscribers", default=",".join(map(str, SUBSCRIBERS)))
    parser.add_argument("--agreement", choices=[each.value for each in AgreementMethod])
    arguments = parser.parse_args()
    print(
        "per sample: subscribers  reports  arrived  airtime    late  frames"
        "  ACK bytes  repeated bytes"
    )
    for subscribers in map(int, arguments.subscribers.split(",")):
        named = arguments.agreement or ("tag" if subscribers > 5 else "confirm")
        for reports in (False, True):
            costs = [
                run_subscribers(seed, subscribers, AgreementMethod(named), reports=reports)
                for seed in range(1, arguments.seeds + 1)
            ]
            mean = {
                name: statistics.fmean(getattr(each, name) for each in costs)
                for name in Cost.__struct_fields__
            }
            print(
                f"{subscribers:23}  {'yes' if reports else 'no':7}  {mean['arrived']:7.3f}  "
                f"{mean['airtime_s']:5.1f} s  {mean['late_s']:4.0f} s  {mean['frames']:6.1f}  "
                f"{mean['ack_bytes']:9.1f}  {mean['repeated_bytes']:14.1f}",
                flush=True,
            )
    return 0


if __name__ == "__main__":
    sys.exit(main())
