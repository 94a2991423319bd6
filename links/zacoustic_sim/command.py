"""The verb `zacoustic run medium`: a simulated channel that gateways in other processes share."""

import argparse
import asyncio
from pathlib import Path
from typing import TYPE_CHECKING

from zacoustic.command import EXIT_OK, Command
from zacoustic.core.clock import ns_to_seconds
from zacoustic.link.positions import add_positions, positions_from
from zacoustic.link.serving import LineWriter, parse_place, run_until_stopped
from zacoustic.text.safetext import json_line, one_line

if TYPE_CHECKING:
    from zacoustic.channel.scenario import Scenario
    from zacoustic_sim.medium import Observation


class MediumCommand(Command):
    """Serves the channel of a scenario until it is interrupted."""

    name = "medium"
    summary = "serve simulated water, for links sim/HOST:PORT"

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare scenario, address, seed, time scale and form of the output."""
        parser.epilog = (
            "example: zacoustic run medium examples/04_medium.json5 --listen 127.0.0.1:7000"
        )
        parser.add_argument("scenario", metavar="SCENARIO", help="scenario file, JSON5")
        parser.add_argument(
            "--listen", metavar="HOST:PORT", default="127.0.0.1:7000",
            help="where to listen, port 0 for any that is free (default: %(default)s)",
        )  # fmt: skip
        parser.add_argument("--seed", type=int, help="replaces the seed of the scenario")
        parser.add_argument(
            "--time-scale", type=float, default=1.0, metavar="X",
            help="how many times faster than real (default: %(default)s)",
        )  # fmt: skip
        add_positions(parser)
        parser.add_argument("--json", action="store_true", help="one JSON object per line")

    def run(self, arguments: argparse.Namespace) -> int:
        """Serve until SIGINT or SIGTERM.

        Raises:
            ConfigError: The scenario or an argument is wrong.
            LinkOpenError: The address cannot be listened at.
        """
        run_until_stopped(lambda stop: self._serve(arguments, stop))
        return EXIT_OK

    async def _serve(self, arguments: argparse.Namespace, stop: asyncio.Event) -> None:
        from zacoustic_sim.medium import SimMedium
        from zacoustic_sim.server import MediumServer

        scenario = _read_scenario(arguments.scenario, arguments.seed)
        host, port = parse_place(arguments.listen)
        with LineWriter(self.name, stop) as writer:
            reporter = _Reporter(writer, as_json=arguments.json)
            medium = SimMedium(scenario, time_scale=arguments.time_scale, observer=reporter.observe)
            server = MediumServer(medium, host, port)
            await server.open()
            try:
                with positions_from(arguments, medium):
                    reporter.listening(server.address, arguments.scenario, scenario)
                    await asyncio.get_running_loop().create_future()  # until it is cancelled
            finally:
                await server.close()


class _Reporter:
    """Prints events, as text or as JSON."""

    def __init__(self, writer: LineWriter, *, as_json: bool) -> None:
        self._writer = writer
        self._as_json = as_json

    def listening(self, address: str, source: str, scenario: "Scenario") -> None:
        nodes = [node.address for node in scenario.nodes]
        text = f"listening at {address}, {len(nodes)} nodes of {source}: --link sim/{address}"
        self._write(
            {"event": "listening", "address": address, "nodes": nodes, "seed": scenario.seed}, text
        )

    def observe(self, at: int, observation: "Observation") -> None:
        """Print it when the frames of this instant are with their modems, which must not wait."""
        asyncio.get_running_loop().call_soon(self._print, at, observation)

    def _print(self, at: int, observation: "Observation") -> None:
        from zacoustic.channel.medium import Emission, Reception
        from zacoustic_sim.medium import Attached

        at_s = ns_to_seconds(at)
        match observation:
            case Emission() as emission:
                record: dict[str, object] = {
                    "event": "emission", "at_s": at_s, "source": emission.source,
                    "sequence": emission.sequence, "frame_bytes": emission.frame_bytes,
                    "airtime_s": ns_to_seconds(emission.ends_at - emission.started_at),
                }  # fmt: skip
                text = f"{emission.source} sends {emission.frame_bytes} bytes"
            case Reception(arrival=arrival) as reception:
                record = {
                    "event": "reception", "at_s": at_s, "source": arrival.source,
                    "sequence": arrival.sequence, "node": arrival.node,
                    "outcome": reception.outcome.value, "snr_db": round(arrival.snr_db, 2),
                    "propagation_s": arrival.propagation_s,
                }  # fmt: skip
                text = f"{arrival.source} at {arrival.node}: {reception.outcome.value}"
            case _:
                event = "attach" if isinstance(observation, Attached) else "detach"
                record = {"event": event, "at_s": at_s, "address": observation.address}
                text = f"node {observation.address}: {event}"
        self._write(record, f"{at_s:10.3f} s  {text}")

    def _write(self, record: dict[str, object], text: str) -> None:
        self._writer.write(json_line(record) if self._as_json else one_line(text))


def _read_scenario(path: str, seed: int | None) -> "Scenario":
    import msgspec

    from zacoustic.channel.scenario import scenario_from_mapping
    from zacoustic.json5 import read_json5

    scenario = scenario_from_mapping(read_json5(path), source=path, folder=Path(path).parent)
    return scenario if seed is None else msgspec.structs.replace(scenario, seed=seed)
