"""`python -m examples.auv`: the whole experiment; `make auv`."""

import argparse
import asyncio
import sys


def main() -> int:
    """Read the arguments and run what they ask for."""
    parser = argparse.ArgumentParser(
        prog="python -m examples.auv",
        description="A vehicle, two gateways, two emulated modems and 1500 m of water; and a web "
        "page to steer it from, or a scripted dive.",
        epilog="example: python -m examples.auv --port 8081 --loss 0.2",
    )
    parser.add_argument("--headless", action="store_true", help="the scripted dive, and its check")
    parser.add_argument(
        "--loss", type=_share, default=0.0, metavar="P", help="share of the frames that is lost"
    )
    parser.add_argument(
        "--ros", action="store_true", help="the vehicle is a node of ROS 2 on rmw_zenoh"
    )
    parser.add_argument("--port", type=_port, default=8080, help="of the console's page (8080)")
    given = parser.parse_args()
    if given.headless:
        from examples.auv.headless import headless

        return asyncio.run(headless(loss=given.loss, ros=given.ros))
    try:
        from examples.auv.console import run_console
    except ModuleNotFoundError as error:
        print(
            f"{error.name} is missing: pip install '.[console]' in the checkout, or --headless",
            file=sys.stderr,
        )
        return 2
    return run_console(port=given.port, loss=given.loss, ros=given.ros)


def _share(text: str) -> float:
    value = float(text)
    if not 0.0 <= value < 1.0:
        raise argparse.ArgumentTypeError(f"{text}; allowed: 0 up to, but not, 1")
    return value


def _port(text: str) -> int:
    value = int(text)
    if not 1 <= value <= 65535:
        raise argparse.ArgumentTypeError(f"{text}; allowed: 1..65535")
    return value


if __name__ == "__main__":
    sys.exit(main())
