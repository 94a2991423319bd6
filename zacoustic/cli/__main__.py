"""`python -m zacoustic.cli`: the same as `python -m zacoustic`."""

import sys

from zacoustic.__main__ import start

if __name__ == "__main__":
    sys.exit(start())
