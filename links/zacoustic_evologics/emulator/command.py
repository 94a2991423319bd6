"""The verb `zacoustic run modems evologics`: modems on TCP ports and pseudo-terminals.

With `--json` it prints one object a line: first the place of each modem, before anything else::

    listening   address locator                   again for each further port of a modem

then the events on the channel, which no modem knows. Names as in `zacoustic run medium --json`::

    emission    at_s source sequence service      a signal begins; `source` is the modem's address
                destination frame_bytes airtime_s in the scenario, `sequence` counts its signals
    reception   at_s source sequence service      … and has ended at another modem, `node`
                node outcome snr_db propagation_s

`service` is `im`, `ims` or `burst` for data of hosts, and `frame_bytes` is their size. Signals that
modems send by themselves have 0 bytes, unless a message goes with them: `ack`, `connect`, `accept`,
`burst ack`, `probe`. `outcome` is `received`, or the cause of the loss: `noise`, `collision`,
`half_duplex` (the modem was transmitting), `deaf` (it followed another sound). It is the outcome on
the channel: it does not show a modem that restarts meanwhile, or an acknowledgement lost by
`--faults`. `at_s` counts from the start, in the time of the modems.

With `--positions` another program steers the modems: see `zacoustic.link.positions`.
"""

import argparse
import asyncio
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Final

from zacoustic.command import EXIT_OK, Command
from zacoustic.core.clock import ns_to_seconds
from zacoustic.errors import ConfigError
from zacoustic.link.emulation.verb import Reporter, add_places, add_scenario, serve
from zacoustic.link.serving import LineWriter, run_until_stopped
from zacoustic_evologics.at.firmware import FIRMWARES

if TYPE_CHECKING:
    from zacoustic_evologics.emulator.fleet import EmulatedFleet
    from zacoustic_evologics.emulator.observation import Observation, Observer

FIRST_PORT: Final = 9200
"""Port of the first modem, as on a real one; further modems have the next ports."""


class EvologicsEmulation(Command):
    """Serves emulated S2C modems until it is interrupted."""

    name = "evologics"
    summary = "EvoLogics S2C modems, on TCP ports and pseudo-terminals"

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare modems, places, faults and form of the output."""
        parser.epilog = "example: zacoustic run modems evologics --modems 2 --listen 127.0.0.1:9200"
        add_scenario(parser)
        add_places(
            parser,
            FIRST_PORT,
            json_help=": `listening` for each place, `emission` and `reception` of each signal",
        )
        parser.add_argument("--faults", metavar="FILE", help="what goes wrong, JSON5")
        parser.add_argument("--seed", type=int, help="replaces the seeds of scenario and faults")
        parser.add_argument(
            "--interpreter", choices=("NET", "AT"), default="NET",
            help="who reads on the ports; AT begins in data mode (default: %(default)s)",
        )  # fmt: skip
        parser.add_argument(
            "--firmware", choices=FIRMWARES, default="1.9",
            help="of all modems: which fields records have, what is known (default: %(default)s)",
        )  # fmt: skip
        parser.add_argument(
            "--set", metavar="NAME=VALUE", nargs="+", action="extend", default=[], dest="settings",
            help="settings and port options of all modems, such as ZX=1 RI=0",
        )  # fmt: skip

    def run(self, arguments: argparse.Namespace) -> int:
        """Serve until SIGINT or SIGTERM.

        Raises:
            ConfigError: A file or an argument is wrong.
            LinkOpenError: An address cannot be listened at.
        """
        run_until_stopped(lambda stop: self._serve(arguments, stop))
        return EXIT_OK

    async def _serve(self, arguments: argparse.Namespace, stop: asyncio.Event) -> None:
        with LineWriter("emulate evologics", stop) as writer:
            reporter = _Reporter(writer, "evologics", as_json=arguments.json)
            fleet = _create_fleet(arguments, reporter.observe)
            await serve(fleet, arguments, reporter, first_port=FIRST_PORT)


class _Reporter(Reporter):
    """Prints the events on the channel, too."""

    def observe(self, observation: "Observation") -> None:
        """Print an event on the channel."""
        from zacoustic_evologics.emulator.observation import SignalEmitted

        signal = observation.signal
        at_s, service = ns_to_seconds(observation.at), signal.kind.service
        if isinstance(observation, SignalEmitted):
            size = signal.content_bytes
            record: dict[str, object] = {
                "event": "emission", "at_s": at_s, "source": observation.node,
                "sequence": observation.sequence, "service": service,
                "destination": signal.destination, "frame_bytes": size,
                "airtime_s": ns_to_seconds(signal.duration_ns),
            }  # fmt: skip
            text = f"{observation.node} sends {service}" + (f", {size} bytes" if size else "")
        else:
            record = {
                "event": "reception", "at_s": at_s, "source": observation.source,
                "sequence": observation.sequence, "service": service, "node": observation.node,
                "outcome": observation.outcome.value, "snr_db": round(observation.snr_db, 2),
                "propagation_s": observation.propagation_s,
            }  # fmt: skip
            heard = f"{observation.source} at {observation.node}"
            text = f"{heard}: {service} {observation.outcome.value}"
        self.write(record, f"{at_s:10.3f} s  {text}")


def _create_fleet(arguments: argparse.Namespace, observer: "Observer") -> "EmulatedFleet":
    import msgspec

    from zacoustic.json5 import read_json5
    from zacoustic.link.emulation.placing import read_scenario
    from zacoustic_evologics.at.framing import Interpreter
    from zacoustic_evologics.emulator.fleet import EmulatedFleet
    from zacoustic_evologics.emulator.hardware.chassis import Behaviour
    from zacoustic_evologics.emulator.station.faults import NO_FAULTS, plan_from_mapping

    faults = NO_FAULTS
    if arguments.faults is not None:
        faults = plan_from_mapping(read_json5(arguments.faults), source=arguments.faults)
    scenario = read_scenario(arguments, read_json5)
    if arguments.seed is not None:
        faults = msgspec.structs.replace(faults, seed=arguments.seed)
        scenario = msgspec.structs.replace(scenario, seed=arguments.seed)
    return EmulatedFleet(
        scenario,
        interpreter=Interpreter(arguments.interpreter),
        faults=faults,
        settings=_parse_settings(arguments.settings),
        behaviour=Behaviour(firmware=arguments.firmware),
        observer=observer,
    )


def _parse_settings(texts: Sequence[str]) -> Mapping[str, int]:
    settings = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not (equals and value.isascii() and value.isdigit()):
            raise ConfigError(f"--set {text!r}; allowed: NAME=VALUE with a whole number")
        settings[name] = int(value)
    return settings
