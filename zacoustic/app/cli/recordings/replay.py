"""The verb `zacoustic replay`: runs a recording again, exactly or with changes."""

import asyncio
from typing import TYPE_CHECKING

from zacoustic.app.cli.support.printing import print_json, print_text
from zacoustic.app.cli.support.rows import endpoint, flag, option, real, repeated, whole, word
from zacoustic.app.cli.support.verb import FleetVerb
from zacoustic.errors import ConfigError
from zacoustic.link.command import EXIT_FAILED, EXIT_OK
from zacoustic.link.serving import stopped_by_signals
from zacoustic.text.safetext import one_line

if TYPE_CHECKING:
    from zacoustic.app.tools.inspect.recordings.replaying.checking import CipherOf
    from zacoustic.app.tools.inspect.recordings.replaying.playing import Played
    from zacoustic.config import Config

_CHANGES = "another way, with --what-if; also --config"
_ONTO = "onto a Zenoh network, the default"


class Replay(FleetVerb):
    """Play a recording back: onto Zenoh, or into engines, byte for byte.

    --check exits with 1 when anything differs. What a recorded node had published is
    put as it was, so a gateway on that network sends it; what came off the channel has
    the mark of a gateway, and is not sent again

    Examples:
      zacoustic replay trial.mcap --check
      zacoustic replay trial.mcap --through fleet.json5
      zacoustic replay shore.mcap auv1.mcap --what-if --add-loss 0.2
      zacoustic replay trial.mcap --connect tcp/127.0.0.1:7447 --rate 10 --key 'auv1/**'
    """

    recordings: list[str] = word("FILE", "recording, MCAP; with --what-if those of both ends", "+")
    check: bool = flag(
        "make every engine again and compare frames, events and timers, byte for byte; "
        "sealed ones take --config with `security`",
        either="what",
    )
    through: str | None = option(
        "CONFIG",
        "the same inputs into engines of this configuration: which frames are others?",
        either="what",
    )
    what_if: bool = flag(
        "the recorded load on a simulated channel, as it was and another way", either="what"
    )
    add_loss: float = real(
        "SHARE",
        "so much more of the frames is lost: 0.2 is 20 %% more",
        0.0,
        least=-1.0,
        most=1.0,
        title=_CHANGES,
    )
    loss: float | None = real(
        "SHARE", "so much, whatever it was", least=0.0, most=1.0, title=_CHANGES
    )
    access: str | None = option(
        None,
        "medium access of the nodes",
        choices=("aloha", "carrier_sense", "delegated"),
        title=_CHANGES,
    )
    codec: str | None = option(
        None, "of typed topics", choices=("cbor", "packed", "dense"), title=_CHANGES
    )
    scenario: str | None = option(
        "FILE", "the channel, instead of the measured one", title=_CHANGES
    )
    seed: int = whole("N", "of the losses", 1, title=_CHANGES)
    connect: list[str] | None = endpoint(title=_ONTO)
    config: str | None = option(
        "FILE",
        "where the router is, and the keys of ROS topics; with --what-if: the streams and rules of "
        "all nodes",
        title=_ONTO,
    )
    rate: float = real("R", "how many times as fast", 1.0, title=_ONTO)
    fast: bool = flag("without waiting at all", title=_ONTO)
    key: list[str] = repeated("EXPRESSION", "only what this key expression covers", title=_ONTO)
    node: int | None = whole(
        "N", "samples of this node, in a recording of several engines", title=_ONTO
    )

    def work(self) -> int:
        """Replay.

        Raises:
            ConfigError: The file or an argument is wrong.
            SessionError: No router can be reached.
        """
        if self.what_if:
            return self._what_if()
        if len(self.recordings) > 1:
            raise ConfigError("several recordings; allowed: with --what-if, or one")
        recording = self.recordings[0]
        if self.check:
            return self._check(recording)
        if self.through is not None:
            return self._through(recording, self.through)
        played = asyncio.run(self._play(recording))
        self.show(played, _played_text)
        if not played.samples:
            raise ConfigError(f"{recording}: it has no samples that could be put")
        return EXIT_OK

    def _what_if(self) -> int:
        from zacoustic.app.tools.inspect.recordings.whatif.changes import Wanted, what_if
        from zacoustic.app.tools.inspect.recordings.whatif.whatiftext import as_text

        names = ("add_loss", "loss", "config", "access", "codec", "scenario", "seed")
        wanted = Wanted(**{name: getattr(self, name) for name in names})
        found = what_if(self.recordings, wanted)
        self.show(found, as_text)
        return EXIT_OK

    def _check(self, recording: str) -> int:
        import msgspec

        from zacoustic.app.tools.inspect.recordings.replaying.checking import check_recording
        from zacoustic.app.tools.inspect.recordings.replaying.checktext import as_text

        verdict = check_recording(recording, _cipher_of(self.fleet()))
        if self.json:
            print_json({**msgspec.to_builtins(verdict), "is_same": verdict.is_same})
        else:
            print_text(as_text(verdict))
        return EXIT_OK if verdict.is_same else EXIT_FAILED

    def _through(self, recording: str, config: str) -> int:
        from zacoustic.app.tools.inspect.recordings.replaying.checktext import otherwise_as_text
        from zacoustic.app.tools.inspect.recordings.replaying.otherwise import replay_through
        from zacoustic.app.tools.inspect.recordings.replaying.today import configs_for
        from zacoustic.run.recording.epochs import nodes_of

        configs = configs_for(config, nodes_of(recording))
        found = replay_through(recording, configs)
        self.show(found, otherwise_as_text)
        return EXIT_OK

    async def _play(self, recording: str) -> "Played":
        from zacoustic.app.tools.inspect.recordings.replaying.playing import play

        config = self.fleet()
        stop = asyncio.Event()
        with stopped_by_signals(stop):
            return await play(
                recording,
                config=config,
                connect=self.connect,
                rate=None if self.fast else self.rate,
                keys=self.key,
                node=self.node,
                stop=stop,
            )


def _cipher_of(config: "Config | None") -> "CipherOf | None":
    """Return a source of the nodes' keys; None: the configuration names no key."""
    from zacoustic.seal.keyring import open_keyring

    security = None if config is None else config.security
    if security is None:
        return None
    return lambda address: open_keyring(security, address).cipher


def _played_text(played: "Played") -> str:
    from zacoustic.app.tools.columns import align

    rows = [(key, str(number)) for key, number in sorted(played.samples.items())]
    lines = [align(("key", "samples"), rows, right=("samples",))]
    lines += [
        f"{one_line(key)}: {number} left out; --config has the keys of ROS topics"
        for key, number in played.left_out.items()
    ]
    return "\n".join(lines)
