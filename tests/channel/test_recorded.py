"""Recorded channels: files of impulse responses in place of a channel model."""

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from zacoustic.channel.arrival import Outcome
from zacoustic.channel.medium import Medium
from zacoustic.channel.recorded import RecordedSpec, read_recording
from zacoustic.channel.scenario import Scenario, scenario_from_mapping
from zacoustic.errors import ConfigError

h5py = pytest.importorskip("h5py")

NODES = [{"address": 1, "position": [0, 0, 10]}, {"address": 2, "position": [500, 0, 10]}]
MATLAB_COMPLEX = np.dtype([("real", "<f8"), ("imag", "<f8")])


def write(
    path: Path, responses: npt.NDArray[Any], *, in_params: bool = False, **rates: float
) -> Path:
    """Write responses × delays as MATLAB v7.3 does: transposed, complex as pairs."""
    stored = np.empty(responses.T.shape, MATLAB_COMPLEX)
    stored["real"], stored["imag"] = responses.T.real, responses.T.imag
    with h5py.File(path, "w", userblock_size=512) as file:
        file["h"] = stored
        place = file.create_group("params") if in_params else file
        for name, value in rates.items():
            place[name] = np.array([[value]])
    return path


def synthetic(folder: Path, *, in_params: bool = False) -> Path:
    """Ten responses a second; in the second half an echo of equal power arrives 5 ms later."""
    responses = np.zeros((200, 100), complex)
    responses[:, 10] = 1j
    responses[100:, 60] = 1.0
    return write(folder / "bay.mat", responses, in_params=in_params, fs_t=10.0, fs_tau=10_000.0)


def scenario(folder: Path, **more: object) -> Scenario:
    mapping = {"channel": "recorded", "recorded": {"file": "bay.mat"}, "nodes": NODES, **more}
    return scenario_from_mapping(mapping, source="test", folder=folder)


@pytest.mark.parametrize("in_params", [False, True])
def test_a_file_gives_gains_over_the_mean_and_the_share_that_is_used(
    tmp_path: Path, in_params: bool
) -> None:
    spec = read_recording(synthetic(tmp_path, in_params=in_params))
    assert spec.every_s == pytest.approx(0.1)
    # Powers 1 and 2, mean 1.5; a window of 1 ms holds one of the two paths.
    assert spec.gains_db[0] == spec.used_db[0] == pytest.approx(-1.7609, abs=1e-3)
    assert spec.gains_db[150] == pytest.approx(1.2494, abs=1e-3)
    assert spec.used_db[150] == pytest.approx(-1.7609, abs=1e-3)
    wide = read_recording(tmp_path / "bay.mat", window_s=0.01)
    assert wide.used_db[150] == pytest.approx(wide.gains_db[150])


def test_frames_are_lost_while_their_power_is_spread_over_all_delays(tmp_path: Path) -> None:
    responses = np.zeros((200, 1000), complex)
    responses[:100, 10] = 1.0
    responses[100:] = 1.2 / 1000**0.5  # a window has a hundredth of it: 20 dB below the echoes
    write(tmp_path / "bay.mat", responses, fs_t=10.0, fs_tau=10_000.0)
    lost: dict[float, list[bool]] = {}
    medium = Medium(scenario(tmp_path))
    for number in range(200):
        (arrival,) = medium.transmit(1, 64, number * 2_000_000_000).arrivals
        is_lost = medium.finish(arrival).outcome is not Outcome.RECEIVED
        mean_db = arrival.received_level_db
        lost.setdefault(round(mean_db, 1), []).append(is_lost)
    clean, echoing = lost[min(lost)], lost[max(lost)]
    assert len(clean) > 50
    assert not any(clean)
    assert len(echoing) > 50
    assert sum(echoing) > 0.9 * len(echoing)


def test_one_seed_gives_the_same_arrivals_and_another_begins_elsewhere(tmp_path: Path) -> None:
    synthetic(tmp_path)

    def levels(seed: int) -> list[float]:
        medium = Medium(scenario(tmp_path, seed=seed))
        emissions = [medium.transmit(1, 64, each * 3_000_000_000) for each in range(20)]
        return [emission.arrivals[0].received_level_db for emission in emissions]

    assert levels(1) == levels(1)
    assert len({tuple(levels(seed)) for seed in range(5)}) > 1


def test_bad_files_are_refused_with_file_variable_and_value(tmp_path: Path) -> None:
    good = np.ones((3, 4), complex)
    old = tmp_path / "old.mat"
    old.write_bytes(b"MATLAB 5.0 MAT-file" + bytes(500))
    text = tmp_path / "text.mat"
    text.write_text("no recording")
    flat = tmp_path / "flat.mat"
    with h5py.File(flat, "w") as file:
        file["fs_t"], file["fs_tau"], file["h"] = 1.0, 1.0, np.ones(3)
    cases = {
        tmp_path / "none.mat": "No such file",
        old: "v7.3",
        text: "is no HDF5 file",
        flat: r"h has the shape \(3,\)",
        write(tmp_path / "a.mat", good, fs_t=1.0): "fs_tau is missing",
        write(tmp_path / "b.mat", good, fs_t=0.0, fs_tau=1.0): "fs_t is 0.0",
        write(tmp_path / "c.mat", 0 * good, fs_t=1.0, fs_tau=1.0): "mean power of h is 0.0",
        write(tmp_path / "d.mat", np.nan * good, fs_t=1.0, fs_tau=1.0): "mean power of h is nan",
    }
    for path, words in cases.items():
        with pytest.raises(ConfigError, match=words) as caught:
            read_recording(path)
        assert path.name in str(caught.value)


def test_the_scenario_names_a_recording_exactly_with_its_channel(tmp_path: Path) -> None:
    synthetic(tmp_path)
    for more, words in (
        ({"channel": "sea"}, "recorded is there"),
        ({"recorded": None}, "recorded is missing"),
        ({"recorded": {"file": "bay.mat", "window": 1}}, "recorded.window is unknown"),
        ({"recorded": {"file": "bay.mat", "window_s": 0}}, "recorded.window_s is 0"),
        ({"recorded": {"file": 3}}, "recorded.file is 3"),
    ):
        with pytest.raises(ConfigError, match=words):
            scenario(tmp_path, **more)
    with pytest.raises(ValueError, match="used_db"):
        RecordedSpec(every_s=1.0, gains_db=(0.0,), used_db=(1.0,))
