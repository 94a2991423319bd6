"""`python -m examples.auv`: the whole experiment; `make auv`."""

import argparse
import asyncio
import sys


def main() -> int:
    """Read the arguments and run what they ask for."""
    parser = argparse.ArgumentParser(prog="python -m examples.auv", description=__doc__)
    parser.add_argument("--headless", action="store_true", help="the scripted dive, and its check")
    parser.add_argument(
        "--loss", type=float, default=0.0, metavar="P", help="share of the frames that is lost"
    )
    parser.add_argument(
        "--ros", action="store_true", help="the vehicle is a node of ROS 2 on rmw_zenoh"
    )
    parser.add_argument("--port", type=int, default=8080, help="of the console's page")
    given = parser.parse_args()
    if given.headless:
        from examples.auv.headless import headless

        return asyncio.run(headless(loss=given.loss, ros=given.ros))
    try:
        from examples.auv.console import run_console
    except ModuleNotFoundError as error:
        print(
            f"{error.name} is missing: pip install 'zacoustic[console]', or --headless",
            file=sys.stderr,
        )
        return 2
    run_console(port=given.port, loss=given.loss, ros=given.ros)
    return 0


if __name__ == "__main__":
    sys.exit(main())
