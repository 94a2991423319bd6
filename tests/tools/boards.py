"""A gateway with something of everything, for the tests of what shows it."""

import json
from typing import Any, Final

from zacoustic.app.tools.watch.board import Board
from zacoustic.app.tools.watch.views import GatewayView

NOW_S: Final = 1000.0

DOCUMENTS: Final[dict[str, Any]] = {
    "node": {"name": "auv1", "version": "0.1.0", "wire": "native", "link": "evologics/tcp:h:9200",
             "started_at_unix_s": 100.0},
    "link": {"state": "up", "frames_transmitted": 40, "frames_received": 30, "airtime_s": 90.0,
             "bytes_transmitted": 1300,
             "capabilities": {"mtu_bytes": 64, "bit_rate_bps": 976.0}},
    "streams": {"digest": "c0ffee", "streams": [
        {"id": 10, "name": "auv1/nav", "kind": "topic", "jobs": ["forward"], "published": 30,
         "transmitted": 20, "sent_at_unix_s": 997.0, "sent_period_s": 30.0, "waiting": 2},
        {"id": 11, "name": "auv1/cmd", "kind": "topic", "jobs": ["deliver"], "received": 3,
         "heard_at_unix_s": 940.0, "heard_period_s": 60.0, "age_s": 2.0, "deadline_missed": 4},
        {"id": 12, "name": "quiet", "kind": "service", "jobs": ["proxy"]},
        {"id": 13, "name": "odd", "kind": "topic"},
    ], "differ": [{"id": 13, "name": "odd", "peers": [1]}]},
    "peers": {"1": {"name": "shore", "same_table": True, "heard_at_unix_s": 940.0, "delivered": 6,
                    "not_delivered": 2, "per": 0.25,
                    "metrics": {"snr_db": 12.5, "received_level_db": -38.0}},
              "3": {"name": "buoy", "same_table": False}},
    "peer/1/range": {"range_m": 1512.3, "propagation_s": 1.008, "measured_at_unix_s": 800.0},
    "peer/3/lost": {"lost": True, "since_unix_s": 500.0},
    "ledger": {"entries": [
        {"id": 10, "stream": "auv1/nav", "cause": "payload", "bytes": 900, "airtime_s": 62.3},
        {"id": 10, "stream": "auv1/nav", "cause": "repeat", "bytes": 300, "airtime_s": 20.8},
        {"id": 0, "stream": "", "cause": "hello", "bytes": 100, "airtime_s": 6.9}]},
    "objects": {"sending": [{"id": 7, "to": 1, "stream": "auv1/photo", "done_bytes": 5000,
                             "sent_bytes": 8000, "total_bytes": 20_000}],
                "receiving": [], "ended": [{"source": 1, "transfer": 3, "stream": "auv1/plan",
                                            "done_bytes": 900, "total_bytes": 900,
                                            "outcome": "delivered"}]},
    "channel": {
        "transmitting": {"way": "out", "peer": 1, "bytes": 24, "streams": ["auv1/nav"],
                         "begun_unix_s": 999.9, "airtime_s": 0.31, "outcome": ""},
        "last": [{"way": "in", "peer": 1, "bytes": 7, "streams": [], "begun_unix_s": 940.0,
                  "airtime_s": 0.2, "outcome": ""},
                 {"way": "out", "peer": None, "bytes": 33, "streams": ["auv1/nav", "auv1/photo"],
                  "begun_unix_s": 990.0, "airtime_s": 0.4, "outcome": "not_delivered"}]},
    "journal": {"kept": True, "failure": ""},
    "modem": {"firmware": "1.9", "battery_v": 24.1},
    "dropped": {"channel": {"check": 2, "unconfirmed": 1}},
    "events": {"events": [
        {"at_unix_s": 100.0, "event": "link", "trouble": False, "text": "link up"},
        {"at_unix_s": 500.0, "event": "lost", "trouble": True, "text": "lost 3 buoy"}]},
}  # fmt: skip

WAYS: Final[dict[str, Any]] = {
    "link/acoustic": {"name": "acoustic", "state": "up", "frames_transmitted": 30,
                      "frames_received": 25, "airtime_s": 88.0},
    "link/radio": {"name": "radio", "state": "up", "frames_transmitted": 10,
                   "frames_received": 5, "airtime_s": 2.0},
    "route/far": {"name": "far", "path": [2, 1, 4, 5], "link": "acoustic", "link_state": "up",
                  "frames_transmitted": 120, "frames_received": 98},
    "relay": {"hops": [
        {"route": "far", "next_node": 1, "waiting": 1, "transmissions": 140, "passed_on": 100,
         "given_up": 3},
        {"route": "back", "next_node": 3, "waiting": 0, "transmissions": 90, "passed_on": 10,
         "given_up": 8}]},
    "carry": {"own": 3, "in_custody": 2, "carried": 12, "carried_bytes": 3400,
              "max_bytes": 65_536, "refused": 1, "expired": 4,
              "streams": [
                  {"id": 12, "stream": "auv1/log", "own": {"5": 3}, "custodians": {"3": 2},
                   "oldest_at_unix_s": 400.0, "ends_at_unix_s": 8200.0},
                  {"id": 13, "stream": "buoy/log", "carried": {"1": 10, "5": 2},
                   "carried_bytes": 3400, "oldest_at_unix_s": None}]},
    "bond/radio+acoustic": {"name": "radio+acoustic", "links": ["radio", "acoustic"],
                            "in_use": "acoustic", "again": 4, "frames_transmitted": 40,
                            "reach": {"1": {"radio": "up", "acoustic": "up"},
                                      "3": {"radio": "doubt", "acoustic": "down"},
                                      "5": {"radio": "down", "acoustic": "down"}}},
    "peers": {"1": {"name": "shore", "same_table": True, "heard_at_unix_s": 940.0,
                    "received": {"acoustic": {"frames": 20, "bytes": 500, "airtime_s": 45.0},
                                 "radio": {"frames": 5, "bytes": 99, "airtime_s": 0.9}}},
              "3": {"name": "buoy", "same_table": True},
              "5": {"name": "auv5", "heard_at_unix_s": 990.0, "received": {}}},
}  # fmt: skip
"""Documents of two links, two routes, a list of links and carried samples."""


def put(board: Board, name: str, document: object, address: int = 2) -> None:
    """Give a document to a board."""
    board.take(f"@acoustic/{address}/{name}", json.dumps(document).encode())


def full_board(**changed: object) -> Board:
    """Make a board with gateway 2, at `NOW_S`; documents may be changed."""
    board = Board(lambda: NOW_S)
    for name, document in (DOCUMENTS | changed).items():
        put(board, name, document)
    return board


def full_view(**changed: object) -> GatewayView:
    """Make the view of gateway 2, at `NOW_S`; documents may be changed."""
    return full_board(**changed).view(2)


def fleet_board(gateways: int = 40) -> Board:
    """Return a board of a fleet in which each gateway hears each other node."""
    board = full_board()
    nodes = range(1, gateways + 1)
    for address in nodes:
        peers = {
            str(each): {
                "name": f"auv{each}",
                "same_table": (address, each) != (1, 30),
                "heard_at_unix_s": NOW_S - each,
                "per": 0.7 if (address, each) == (1, 40) else 0.0,
            }
            for each in nodes
            if each != address
        }
        streams = [
            {"id": each, "name": f"auv{each}/report", "kind": "topic", "jobs": ["deliver"],
             "received": 3, "deadline_missed": int(each == 175)}
            for each in range(1, 176)
        ]  # fmt: skip
        for name, document in {
            "node": {"name": f"auv{address}"},
            "link": {"state": "down" if address == 39 else "up"},
            "peers": peers,
            "peer/3/lost": {"lost": False},
            "streams": {"streams": streams},
        }.items():
            put(board, name, document, address)
    return board


def line_board(nodes: int = 5, worst: int = 3) -> Board:
    """Return a board of a line of nodes with a route from end to end, and each node's gateway."""
    board = Board(lambda: NOW_S)
    path = list(range(1, nodes + 1))
    for address in path:
        near = [each for each in (address - 1, address + 1) if each in path]
        hop = {"route": "far", "waiting": 0, "given_up": 2 if address == worst else 0,
               "transmissions": 420 if address == worst else 130, "passed_on": 100}  # fmt: skip
        received = {"acoustic": {"frames": 10, "bytes": 400, "airtime_s": 9.0}}
        documents: dict[str, Any] = {
            "node": {"name": f"n{address}", "started_at_unix_s": 100.0},
            "link": {"name": "acoustic", "state": "up"},
            "streams": {},
            "peers": {
                str(each): {"name": f"n{each}", "heard_at_unix_s": 995.0, "received": received}
                for each in near
            },
            "relay": {"hops": [hop | {"next_node": each} for each in near]},
        }
        if address in (path[0], path[-1]):
            documents["route/far"] = {"path": path, "link": "acoustic", "link_state": "up"}
            other = path[-1] if address == path[0] else path[0]
            documents["peers"][str(other)] = {"heard_at_unix_s": 990.0, "received": {}}
        for name, document in documents.items():
            put(board, name, document, address)
    return board
