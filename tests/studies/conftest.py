"""Short scenarios, written to files as a user would write them."""

from pathlib import Path

import pytest

from studies.command_line.main import run
from studies.scenario.scenario import Scenario, load_scenario

SHORT = """
title = "two slippery seconds"
case = "A"
train = "commuter-8car"
duration_s = 2.0
target_speed_kmh = 1.0

[[command]]
time_s = 0.0
acceleration_kmhs = 3.0

[rail]
level = 0.05
increments = { law = "logarithmic" }
scatter = 0.01

[onboard.sensors]
speed_noise_kmh = 0.02
load_error = 0.05

[onboard.telegrams]
jitter_s = 0.03
loss = 0.1
"""


@pytest.fixture
def short_file(tmp_path) -> Path:
    """A scenario file of two seconds, in which every random draw is used."""
    path = tmp_path / "short.toml"
    path.write_text(SHORT)
    return path


@pytest.fixture
def short(short_file) -> Scenario:
    return load_scenario(short_file)


@pytest.fixture
def write_scenario(tmp_path):
    """Write TOML text to a file and give its path; `SHORT` with replacements if no text is given."""

    def write(text: str = SHORT, *replacements: tuple[str, str], name: str = "own.toml") -> Path:
        for old, new in replacements:
            assert old in text
            text = text.replace(old, new)
        path = tmp_path / name
        path.write_text(text)
        return path

    write.short = SHORT  # type: ignore[attr-defined]
    return write


@pytest.fixture
def call(capsys):
    """Run the command in this process; gives exit code, stdout and stderr."""

    def call(*arguments: object) -> tuple[int, str, str]:
        code = run([str(argument) for argument in arguments])
        captured = capsys.readouterr()
        return code, captured.out, captured.err

    return call
