"""`python -m zacoustic.app.cli`: the same as `python -m zacoustic`."""

import runpy

runpy.run_module("zacoustic", run_name="__main__", alter_sys=True)
