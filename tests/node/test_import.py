"""What importing zacoustic brings with it."""

import subprocess
import sys
from pathlib import Path
from typing import Final, get_args

import zacoustic

ROOT: Final = Path(__file__).parents[2]


def modules_after(statement: str) -> set[str]:
    script = f"import sys\n{statement}\nprint(*sys.modules)"
    process = subprocess.run(
        [sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, check=True
    )
    return set(process.stdout.split())


def test_import_zacoustic_starts_neither_zenoh_nor_serial_nor_asyncio() -> None:
    heavy = {"zenoh", "serial", "asyncio", "cbor2", "msgspec"}
    assert not heavy & modules_after("import zacoustic")


def test_the_node_of_a_link_imports_no_zenoh() -> None:
    loaded = modules_after(
        "from zacoustic import Node, Qos, Bounds, blocking\n"
        "import zacoustic.zenoh.node.onlink.onlink"
    )
    assert "zacoustic.zenoh.node.onlink.onlink" in loaded
    assert not {"zenoh", "serial"} & loaded


def test_every_public_name_is_there() -> None:
    for name in zacoustic.__all__:
        assert getattr(zacoustic, name) is not None
    assert set(zacoustic.__all__) <= set(dir(zacoustic))
    assert zacoustic.__version__.count(".") >= 1
    assert not hasattr(zacoustic, "nonsense")


def test_everything_that_events_yields_can_be_imported_from_the_package() -> None:
    kinds = get_args(zacoustic.NodeEvent)
    assert len(kinds) >= 15
    for kind in kinds:
        assert getattr(zacoustic, kind.__name__) is kind
        assert kind.__name__ in zacoustic.__all__


def test_the_blocking_node_is_imported_as_any_other_name() -> None:
    from zacoustic.blocking import Node

    assert Node is zacoustic.blocking.Node
