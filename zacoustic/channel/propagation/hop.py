"""One direction between two nodes: turns an emission into the arrival that it causes.

A hop knows the geometry (computed once if both ends are fixed), the channel model, the fades, and
the named losses and faults of its direction. It makes all random draws of a frame when the frame
leaves, in the order of its sender, and stores them in the `Arrival`; the receiver only decides the
effect of overlaps.
"""

from typing import Final

import msgspec

from zacoustic.channel.arrival import Arrival
from zacoustic.channel.faults.blackout import Darkness
from zacoustic.channel.faults.faults import FaultSpec
from zacoustic.channel.faults.loss import FrameLoss, LossSpec
from zacoustic.channel.formulae.acoustics import combined_snr_db
from zacoustic.channel.propagation.fading import FadingProcess
from zacoustic.channel.propagation.position import Motion, Path, path_between
from zacoustic.channel.propagation.randomness import direction_random
from zacoustic.channel.propagation.recordedfades import RecordedFades
from zacoustic.channel.propagation.sea import ChannelModel
from zacoustic.channel.recorded import RecordedSpec

_NS_PER_S: Final = 1_000_000_000
_SEEDS: Final = 1 << 53  # number of distinct uniform draws


class Hop:
    """The direction from one node to another.

    Args:
        seed: Seed of the scenario.
        source: Address of the sender.
        node: Address of the receiver.
        channel: The channel model for frames of the sender's modem.
        sender: Motion of the sender.
        receiver: Motion of the receiver.
        sound_speed_m_s: Speed of sound, m/s.
        loss: Named loss of this direction.
        faults: Faults of the receiving modem, and blackouts.
        gain_db: Gain of this direction over the channel model, dB.
        propagation_s: Propagation delay, s, instead of the geometric one, or None.
        recorded: The recording that frames meet, or None.
    """

    def __init__(
        self,
        *,
        seed: int,
        source: int,
        node: int,
        channel: ChannelModel,
        sender: Motion,
        receiver: Motion,
        sound_speed_m_s: float,
        loss: LossSpec,
        faults: FaultSpec,
        gain_db: float = 0.0,
        propagation_s: float | None = None,
        recorded: RecordedSpec | None = None,
    ) -> None:
        self.source = source
        self.node = node
        self._channel = channel
        self._sender = sender
        self._receiver = receiver
        self._sound_speed_m_s = sound_speed_m_s
        self._gain_db = gain_db
        self._fixed_s = propagation_s
        self._water_rng = direction_random(seed, source, node, "water")
        self._fading: FadingProcess | None = None
        if channel.fading is not None:
            self._fading = FadingProcess(channel.fading, self._water_rng)
        self._recorded: RecordedFades | None = None
        if recorded is not None:
            rng = direction_random(seed, source, node, "recorded")
            self._recorded = RecordedFades(recorded, rng)
        self._loss: FrameLoss | None = None
        if loss.frame > 0.0:
            self._loss = FrameLoss(loss, direction_random(seed, source, node, "loss"))
        self._faults: FaultSpec | None = None
        if faults.touch_frames:
            self._faults = faults
            self._fault_rng = direction_random(seed, source, node, "faults")
            self._faults_until = None if faults.until_s is None else faults.until_s * _NS_PER_S
        dark = [each for each in faults.blackouts if each.concerns(source, node)]
        self._darkness = Darkness(dark, faults.until_s) if dark else None
        self._measure(0)

    @property
    def _is_fixed(self) -> bool:
        """Whether both nodes stand still now; that may change."""
        return self._sender.is_fixed and self._receiver.is_fixed

    def path(self, now: int) -> Path:
        """Return the path of sound that leaves at an instant, ns."""
        if not self._is_fixed:
            self._measure(now)
        return self._path

    def is_dark(self, arrival: Arrival) -> bool:
        """Tell whether a blackout blocks an arrival of this hop."""
        darkness = self._darkness
        return darkness is not None and darkness.covers(arrival.starts_at, arrival.ends_at)

    def arrival(
        self, sequence: int, frame_bytes: int, now: int, airtime_ns: int, level_db: float = 0.0
    ) -> Arrival:
        """Return the arrival that a frame causes, and draw everything about it.

        Args:
            sequence: Number of the emission, rising.
            frame_bytes: Length, bytes.
            now: Instant of its start, ns, not before that of the previous emission.
            airtime_ns: Duration at the sender, ns.
            level_db: Source level relative to that of the channel model, dB.
        """
        if not self._is_fixed:
            self._measure(now)
            # A receding node hears the frame stretched.
            airtime_ns += round(airtime_ns * self._path.range_rate_m_s / self._sound_speed_m_s)
        path = self._path
        gain_db = level_db if self._fading is None else level_db + self._fading.next_gain_db(now)
        effective_snr_db = self._effective_snr_db + gain_db
        if self._recorded is not None:
            all_db, used_db, over_echoes_db = self._recorded.over(now, airtime_ns)
            effective_snr_db = combined_snr_db(effective_snr_db + used_db, over_echoes_db)
            gain_db += all_db
        corrupt_seed: int | None = None
        delay_s = 0.0
        duplicates_after_s: tuple[float, ...] = ()
        if self._faults is not None:
            corrupt_seed, delay_s, duplicates_after_s = self._draw_faults(self._faults, now)
        starts_at = now + self._propagation_ns
        return Arrival(
            node=self.node,
            source=self.source,
            sequence=sequence,
            frame_bytes=frame_bytes,
            starts_at=starts_at,
            ends_at=starts_at + airtime_ns,
            received_level_db=self._level_db + gain_db,
            snr_db=self._snr_db + gain_db,
            effective_snr_db=effective_snr_db,
            propagation_s=path.propagation_s,
            distance_m=path.distance_m,
            range_rate_m_s=path.range_rate_m_s,
            chance=self._water_rng.random(),
            dropped=False if self._loss is None else self._loss.next_is_lost(now),
            corrupt_seed=corrupt_seed,
            delay_s=delay_s,
            duplicates_after_s=duplicates_after_s,
        )

    def _measure(self, now: int) -> None:
        self._path = path_between(
            self._sender, self._receiver, now, sound_speed_m_s=self._sound_speed_m_s
        )
        if self._fixed_s is not None:
            self._path = msgspec.structs.replace(self._path, propagation_s=self._fixed_s)
        distance = self._path.distance_m
        self._propagation_ns = round(self._path.propagation_s * _NS_PER_S)
        self._level_db = self._channel.received_level_db(distance) + self._gain_db
        self._snr_db = self._level_db - self._channel.noise_level_db
        self._effective_snr_db = self._channel.effective_snr_db(distance) + self._gain_db

    def _draw_faults(
        self, faults: FaultSpec, now: int
    ) -> tuple[int | None, float, tuple[float, ...]]:
        # Equal numbers of draws for every frame, so that shares do not change later frames.
        rng = self._fault_rng
        is_corrupt = rng.random() < faults.corrupt
        corrupt_seed = int(rng.random() * _SEEDS)
        is_duplicate = rng.random() < faults.duplicate
        after_s = faults.duplicate_after_s
        if isinstance(after_s, tuple):
            low_s, high_s = after_s
            after_s = low_s + (high_s - low_s) * rng.random()
        delay_s = rng.random() * faults.jitter_s if faults.jitter_s else 0.0
        if self._faults_until is not None and now >= self._faults_until:
            return None, 0.0, ()
        return (
            corrupt_seed if is_corrupt else None,
            delay_s,
            (after_s,) if is_duplicate else (),
        )
