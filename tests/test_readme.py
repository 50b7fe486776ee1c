"""What the README shows works."""

import re
import shlex
from pathlib import Path

import pytest

from alloc.rules import RULES
from alloc.simulation import CONTROLLERS
from paper_figs.registry import FIGURES
from studies.core.collection import all_studies
from studies.lines.named_files import TRAINS, shipped
from studies.scenario.loading import shipped_scenarios

README = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"```python\n(.*?)```", README, re.DOTALL)


def test_there_are_examples():
    assert len(BLOCKS) >= 2


@pytest.mark.parametrize("code", BLOCKS)
def test_library_examples_run(code, capsys):
    exec(compile(code, "README.md", "exec"), {})
    assert capsys.readouterr().out.strip()


def test_rule_example_prints_what_it_says(capsys):
    exec(compile(BLOCKS[1], "README.md", "exec"), {})
    assert capsys.readouterr().out.startswith("B 0.176 0.17416")


def test_commands_name_what_exists():
    known = {*RULES, *CONTROLLERS, *FIGURES, *all_studies(), *shipped_scenarios(), *shipped(TRAINS)}
    commands = [line for line in README.splitlines() if line.startswith(".venv/bin/readhesion")]
    assert len(commands) >= 5
    for command in commands:
        words = shlex.split(command, comments=True)[2:]
        for word in words:
            if not word.startswith("-") and "." not in word and not word.isdigit():
                assert word in known, command


def test_pictures_exist():
    for picture in re.findall(r"!\[.*?\]\((.*?)\)", README):
        assert (Path(__file__).parents[1] / picture).exists()
