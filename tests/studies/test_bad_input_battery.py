"""A battery of bad input over all commands: one line that names the thing, exit code 2, nothing written, no work begun."""

import math
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import pytest
import yaml
from pydantic import BaseModel

from alloc.loop import ClosedLoop
from studies.command_line.main import app
from studies.core.plugins import VARIABLE
from studies.files.strict import Strict, _record_in, parse
from studies.files.study_error import StudyError
from studies.scenario.scenario import Scenario
from tests.studies.conftest import SHORT
from tests.studies.test_line_command import NAMED_PATH, NOTHING, OWN_LINE, PATH, STOCK, changed
from tests.studies.test_plugins import REGISTRIES

HUGE = "1" * 5000
DEEP = "[" * 20_000
TRAM = (Path(__file__).parents[2] / "docs" / "plugins" / "tram.toml").read_text()
CAR = """name = "car"
[[cars]]
mass_t = 36.0
wheel_radius_mm = 430.0
wheel_inertia_kgm2 = [155.0, 65.0]
"""
LOG = "time_s,speed_kmh,axle1_speed_kmh,axle1_force_kn\n" + "".join(
    f"{0.1 * k:.1f},36.0,36.{k},5.0\n" for k in range(20)
)


class Case(NamedTuple):
    """A command line, what its message must say, and the files that it needs beside the good ones."""

    line: str
    words: str
    files: Mapping[str, str | bytes] = MappingProxyType({})


def scenario(old: str, new: str, words: str) -> Case:
    """A run of the short scenario with one thing changed."""
    assert old in SHORT
    return Case("simulate bad.toml", words, {"bad.toml": SHORT.replace(old, new)})


def added(text: str, words: str) -> Case:
    """A run of the short scenario with something more."""
    return Case("simulate bad.toml", words, {"bad.toml": SHORT + text})


def top(text: str, words: str) -> Case:
    """A run of the short scenario with a further key at its top."""
    return scenario('case = "A"', f'case = "A"\n{text}', words)


def train(old: str, new: str, words: str) -> Case:
    """The train of one's own with one thing changed."""
    assert old in TRAM
    return Case("--plugin bad.toml list", words, {"bad.toml": TRAM.replace(old, new)})


def car(old: str, new: str, words: str) -> Case:
    """The train of a log with one thing changed."""
    assert old in CAR
    return Case("analyse log.csv --train bad.toml", words, {"bad.toml": CAR.replace(old, new)})


def log(old: str, new: str, words: str) -> Case:
    """An analysis of the log with one thing changed."""
    assert old in LOG
    return Case("analyse bad.csv --train car.toml", words, {"bad.csv": LOG.replace(old, new)})


def plain_log(content: str | bytes, words: str) -> Case:
    """An analysis of this log."""
    return Case("analyse bad.csv --train car.toml", words, {"bad.csv": content})


def path(*place_value_words: Any) -> Case:
    """A line run with one thing changed in the line."""
    *change, words = place_value_words
    text = yaml.safe_dump(changed(PATH, *change))
    return Case("run-line --line bad.yaml --train train.yaml", words, {"bad.yaml": text})


def stock(*place_value_words: Any) -> Case:
    """A line run with one thing changed in the train."""
    *change, words = place_value_words
    text = yaml.safe_dump(changed(STOCK, *change))
    return Case("run-line --line line.yaml --train bad.yaml", words, {"bad.yaml": text})


def named(*place_value_words: Any) -> Case:
    """As `path`, with a line of schema 2024.07."""
    *change, words = place_value_words
    text = yaml.safe_dump(changed(NAMED_PATH, *change))
    return Case("run-line --line bad.yaml --train train.yaml", words, {"bad.yaml": text})


def line_file(old: str, new: str, words: str) -> Case:
    """A run over the line of one's own with one thing changed."""
    assert old in OWN_LINE
    return Case("run-line --line bad.toml", words, {"bad.toml": OWN_LINE.replace(old, new)})


def plugin(content: str | bytes, words: str, name: str = "bad.py") -> Case:
    """The list of what there is, with this plug-in."""
    return Case(f"--plugin {name} list", words, {name: content})


SECTIONS = ("paths", 0, "characteristic_sections")
VEHICLE = ("vehicles", 0)
MISSPELT = {"mas" if key == "mass" else key: value for key, value in STOCK["vehicles"][0].items()}

COMMAND_LINES = [
    Case("compar", "compare"),
    Case("--unheard-of list", "--unheard-of"),
    Case("list everything", "everything"),
    Case("list --json=perhaps", "perhaps"),
    Case("--plugin", "--plugin"),
    Case("compare --unheard-of", "--unheard-of"),
    Case("compare --seeds 0", "--seeds 0"),
    Case("compare --seeds -3", "--seeds -3"),
    Case("compare --seeds 1.5", "'1.5' is not a whole number"),
    Case("compare --seeds nan", "'nan' is not a whole number"),
    Case("compare --seeds 1000000000000", "--seeds 1000000000000"),
    Case(f"compare --seeds {HUGE}", "is not a whole number"),
    Case("compare --seeds", "--seeds"),
    Case("compare --seeds ''", "is not a whole number"),
    Case("compare --jobs 0", "--jobs 0"),
    Case("sweep wsp-acceptance --adhesion x", "--adhesion x"),
    Case("sweep wsp-acceptance --adhesion -0.1", "above 0"),
    Case("sweep wsp-acceptance --curve polac", "did you mean 'polach'"),
    Case("sweep wsp-acceptance --train one-axle", "no air brake"),
    Case("sweep wsp-acceptance --train nope", "unknown train"),
    Case("sweep curves --adhesion 0.1", "unknown option of the sweep curves 'adhesion'"),
    Case("check gredy", "did you mean 'greedy'"),
    Case("check greedy --promise none", "--promise none"),
    Case("compare --jobs -1", "--jobs -1"),
    Case("compare --jobs 1000", "--jobs 1000"),
    Case("compare --jobs two", "'two' is not a whole number"),
    Case("compare --shard 0/4", "--shard '0/4': give k/n"),
    Case("compare --shard 5/4", "--shard '5/4': give k/n"),
    Case("compare --shard half", "--shard 'half': give k/n"),
    Case(f"compare --shard {HUGE}/{HUGE}", "give k/n"),
    Case("sweep ladder --shard 1", "--shard '1': give k/n"),
    Case("sweep ladder --shard=-1/2", "--shard '-1/2': give k/n"),
    Case("merge --out one", "give the folders to unite"),
    Case("merge nowhere --out one", "folder 'nowhere' does not exist"),
    Case("merge short.toml --out one", "folder 'short.toml' does not exist"),
    Case("merge folder --out short.toml", "short.toml' is a file"),
    Case("merge folder", "--out"),
    Case("merge folder other --out one", "folder 'folder' holds no table of a study"),
    Case("merge . --out one", "folder '.' holds no table of a study"),
    Case("compare --rules", "an option for names was given without one"),
    Case("compare --rules ''", "an option for names was given without one"),
    Case("compare --rules exakt", "unknown rule 'exakt'; did you mean 'exact'?"),
    Case("compare --rules exact,", "unknown rule ''"),
    Case("compare --controllers mcp", "unknown controller 'mcp'; did you mean 'mpc'?"),
    Case("compare --scenario wet-strat", "did you mean 'wet-start'?"),
    Case("compare --scenario none.toml", "scenario file 'none.toml' does not exist"),
    Case("compare --scenario ''", "an option for names was given without one"),
    Case("compare --scenario folder/", "'folder' cannot be read: Is a directory"),
    Case("compare --scenario short.toml other/short.toml", "two different scenarios are named 'short'"),
    Case("compare --line none.yaml", "running path file 'none.yaml' does not exist"),
    Case("compare --line folder", "'folder' cannot be read: Is a directory"),
    Case("compare --line short.toml", "short.toml: unknown key 'title'"),
    Case("compare --line nowhere", "unknown line 'nowhere'"),
    Case("compare --line train.yaml", "key 'schema'"),
    Case("compare --train none.yaml", "rolling stock file 'none.yaml' does not exist"),
    Case("compare --train nothing", "unknown train 'nothing'"),
    Case("compare --train none.toml", "train file 'none.toml' does not exist"),
    Case("compare --out ''", "--out"),
    Case("compare --out short.toml", "short.toml' is a file"),
    Case("compare --out short.toml/inside", "is a file"),
    Case(f"compare --out {'x' * 5000}", "cannot be written"),
    Case("compare --out one --out two", "--out"),
    Case("simulate", "scenario"),
    Case("simulate short.toml short.toml extra", "short.toml"),
    Case("simulate ''", "unknown scenario ''"),
    Case("simulate wet-strat", "did you mean 'wet-start'?"),
    Case("simulate short.toml --rule gredy", "did you mean 'greedy'?"),
    Case("simulate short.toml --rule ''", "unknown rule ''"),
    Case("simulate short.toml --rule exact --rule greedy", "--rule"),
    Case("simulate short.toml --controller cut", "did you mean 'cut-and-ramp'?"),
    Case("simulate short.toml --controller ''", "unknown controller ''"),
    Case("simulate short.toml --seed -1", "--seed -1"),
    Case("simulate short.toml --seed 0.5", "'0.5' is not a whole number"),
    Case("simulate short.toml --seed inf", "'inf' is not a whole number"),
    Case("simulate short.toml --seed 99999999999999999999", "--seed 99999999999999999999"),
    Case("simulate short.toml --out x.csv", "'x.csv': ending '.csv' must be .nc"),
    Case("simulate short.toml --out run", "'run': ending '' must be .nc"),
    Case("simulate short.toml --out ''", "--out"),
    Case("simulate short.toml --out ' '", "--out"),
    Case("simulate short.toml --out no/where.nc", "'no/where.nc' cannot be written"),
    Case("simulate short.toml --out folder.nc", "'folder.nc' cannot be written: Is a directory"),
    Case("simulate short.toml --out short.toml/run.nc", "cannot be written: Not a directory"),
    Case("simulate short.toml --figure run", "'run': ending '' must be .pdf or .png or .svg"),
    Case("simulate short.toml --figure run.xyz", "ending '.xyz' must be"),
    Case("simulate short.toml --figure ''", "--figure"),
    Case("simulate short.toml --figure no/where.pdf", "'no/where.pdf' cannot be written"),
    Case("simulate short.toml --log x.txt", "ending '.txt' must be .csv or .parquet"),
    Case("simulate short.toml --log no/x.csv", "'no/x.csv' cannot be written"),
    Case("simulate short.toml --log taken.csv", "'taken.train.toml' cannot be written"),
    Case("sweep", "name"),
    Case("sweep laddr", "did you mean 'ladder'?"),
    Case("sweep ''", "unknown sweep ''"),
    Case("sweep ladder --events 0", "--events 0"),
    Case("sweep ladder --events -5", "--events -5"),
    Case("sweep ladder --events 1000000000", "--events 1000000000"),
    Case("sweep ladder --events many", "'many' is not a whole number"),
    Case("sweep ladder --seed -1", "--seed -1"),
    Case("sweep ladder --jobs -2", "--jobs -2"),
    Case("sweep ladder --out ''", "--out"),
    Case("sweep ladder --out short.toml", "short.toml' is a file"),
    Case("figures slipevent", "did you mean 'slip-event'?"),
    Case("figures ''", "unknown figure ''"),
    Case("figures --jobs 0", "--jobs 0"),
    Case("figures slip-event --out short.toml", "figure folder 'short.toml' cannot be written"),
    Case("figures slip-event --out ''", "--out"),
    Case("figures slip-event --results short.toml", "results folder 'short.toml' cannot be written"),
    Case("report wet-patch", "'wet-patch': no option takes this; events go after --scenario"),
    Case("compare wet-patch", "'wet-patch': no option takes this; events go after --scenario"),
    Case("report --scenario no-such-event", "unknown scenario 'no-such-event'"),
    Case("report --scenario none.toml", "'none.toml' does not exist"),
    Case("report --scenario short.toml --rules exakt", "did you mean 'exact'?"),
    Case("report --scenario short.toml --controllers cut", "controller 'cut'"),
    Case("report --scenario short.toml --seeds 0", "--seeds 0"),
    Case("report --scenario short.toml --seeds 1.5", "'1.5' is not a whole number"),
    Case("report --scenario short.toml --jobs 0", "--jobs 0"),
    Case("report --scenario short.toml --out page.pdf", "ending '.pdf' must be .html"),
    Case("report --scenario short.toml --out none/page.html", "'none/page.html' cannot be written"),
    Case("report --scenario short.toml --out ''", "no name is given"),
    Case("report --scenario short.toml --results short.toml", "results folder 'short.toml' cannot be written"),
    Case("analyse", "--train"),
    Case("analyse --train car.toml", "no log is given"),
    Case("analyse log.csv --train car.toml --mapping none.toml", "mapping file 'none.toml' does not exist"),
    Case("analyse log.csv --train car.toml --line none.yaml", "'none.yaml'"),
    Case("analyse log.csv --train car.toml --events slips.txt", "ending '.txt' must be .csv"),
    Case("analyse log.csv log.csv --train car.toml --figure f.pdf", "--figure is for a single log"),
    Case("analyse log.csv", "--train"),
    Case("analyse none.csv --train car.toml", "log 'none.csv' does not exist"),
    Case("analyse folder.csv --train car.toml", "log 'folder.csv' does not exist"),
    Case("analyse car.toml --train car.toml", "ending '.toml' must be .csv or .parquet"),
    Case("analyse '' --train car.toml", "no name is given"),
    Case("analyse log.csv --train nothing", "unknown train 'nothing'"),
    Case("analyse log.csv --train none.toml", "train file 'none.toml' does not exist"),
    Case("analyse log.csv --train folder", "unknown train 'folder'"),
    Case("analyse log.csv --train car.toml --slip-kmh nan", "--slip-kmh nan"),
    Case("analyse log.csv --train car.toml --slip-kmh inf", "--slip-kmh inf"),
    Case("analyse log.csv --train car.toml --slip-kmh -1", "--slip-kmh -1"),
    Case("analyse log.csv --train car.toml --slip-kmh 0", "--slip-kmh 0"),
    Case("analyse log.csv --train car.toml --slip-kmh fast", "--slip-kmh"),
    Case("analyse log.csv --train car.toml --slip-percent 0", "--slip-percent 0"),
    Case("analyse log.csv --train car.toml --slip-percent nan", "--slip-percent nan"),
    Case("analyse log.csv --train car.toml --figure f", "ending '' must be"),
    Case("analyse log.csv --train car.toml --figure no/f.pdf", "cannot be written"),
    Case("cite nothing", "unknown scenario 'nothing'"),
    Case("cite wet-patch --rule nope", "unknown rule 'nope'"),
    Case("cite wet-patch --controller nope", "unknown controller 'nope'"),
    Case("schema wagon", "wagon"),
    Case("schema line --reference", "leave out the kind"),
    Case("schema --out keys.md", "must be .json"),
    Case("schema --reference --out keys.json", "must be .md"),
    Case("schema --out no/such/x.json", "cannot be written"),
    Case("new-scenario", "name"),
    Case("new-scenario ''", "give letters"),
    Case("new-scenario a/b", "give letters"),
    Case("new-scenario 'a b'", "give letters"),
    Case("new-scenario own --like wetpatch", "did you mean 'wet-patch'?"),
    Case("new-scenario own --like none.toml", "'none.toml' does not exist"),
    Case("new-scenario own --like car.toml", "car.toml"),
    Case("new-scenario own --out car.toml", "'car.toml' exists"),
    Case("new-scenario own --out log.csv", "cannot be written"),
    Case("export-controller", "scenario"),
    Case("export-controller short.toml --out x", "--unit"),
    Case("export-controller short.toml --unit 1", "--out"),
    Case("export-controller wetpatch --unit 1 --out x", "did you mean 'wet-patch'?"),
    Case("export-controller none.toml --unit 1 --out x", "'none.toml' does not exist"),
    Case("export-controller wet-patch --unit 0 --out x", "--unit 0: give a whole number from 1 to"),
    Case("export-controller wet-patch --unit 99 --out x", "--unit 99: give a whole number from 1 to"),
    Case("export-controller wet-patch --unit 1.5 --out x", "'1.5' is not a whole number"),
    Case("export-controller wet-patch --unit 1 --out short.toml", "short.toml' is a file"),
    Case("export-fmu short.toml", "--out"),
    Case("export-fmu wetpatch --out x.fmu", "did you mean 'wet-patch'?"),
    Case("export-fmu short.toml --out x.zip", "ending '.zip' must be .fmu"),
    Case("export-fmu short.toml --out x.fmu --unit 9", "--unit 9: give a whole number from 1 to"),
    Case("export-fmu short.toml --out x.fmu --seed -1", "--seed -1: give a whole number from 0 to"),
    Case("export-fmu short.toml --out none/x.fmu", "x.fmu' cannot be written"),
    Case("export-qps --scenario wetpatch --out x", "did you mean 'wet-patch'?"),
    Case("export-qps --scenario short.toml", "--out"),
    Case("export-qps --scenario short.toml --out short.toml", "short.toml' is a file"),
    Case("export-controller wet-patch --unit 1 --out ''", "no name is given"),
    Case("export-controller wet-patch --unit 1 --out x --target armv7", "target = 'armv7' must be one of x86-64"),
    Case("run-line --line", "--line"),
    Case("run-line --line line.yaml --train", "--train"),
    Case("run-line --line dresden-gorlitz", "did you mean 'dresden-goerlitz'?"),
    Case("run-line --train br642", "did you mean 'br-642'?"),
    Case("run-line --train commuter-8cars", "did you mean 'commuter-8car'?"),
    Case("run-line --stops Bauzen", "did you mean 'Bautzen'?"),
    Case("run-line --stops ''", "without one"),
    Case("run-line --stops 10", "stop '10 m': the front stands at 10 m"),
    Case("run-line --stops 5000,5010", "50 m or more from other stops"),
    Case("run-line --stops 2e5", "ends of the line"),
    Case("run-line --stops nan", "the front stands at nan m"),
    Case("run-line --stops all --dwell -1", "--dwell -1"),
    Case("run-line --stops all --dwell nan", "--dwell nan"),
    Case("run-line --stops all --dwell 1e9", "--dwell 1e+09"),
    Case("run-line --effort 0", "effort = 0.0"),
    Case("run-line --effort 1.5", "effort = 1.5"),
    Case("run-line --effort nan", "effort = nan"),
    Case("run-line --effort full", "--effort"),
    Case("run-line --coasting -5", "coasting = -5.0"),
    Case("run-line --coasting inf", "coasting = inf"),
    Case("run-line --effort 0.01", "cannot climb at "),
    Case("run-line --line none.yaml --train train.yaml", "'none.yaml' does not exist"),
    Case("run-line --line line.yaml --train none.yaml", "'none.yaml' does not exist"),
    Case("run-line --line folder --train train.yaml", "Is a directory"),
    Case("run-line --line '' --train train.yaml", "--line"),
    Case("run-line --line line.yaml --train line.yaml", "key 'schema'"),
    Case("run-line --line line.yaml --train train.yaml --load 1.5", "--load 1.5"),
    Case("run-line --line line.yaml --train train.yaml --load nan", "--load nan"),
    Case("run-line --line line.yaml --train train.yaml --load -1", "--load -1"),
    Case("run-line --line line.yaml --train train.yaml --load full", "--load"),
    Case("run-line --line line.yaml --train train.yaml --out x.csv", "ending '.csv' must be .nc"),
    Case("run-line --line line.yaml --train train.yaml --out no/x.nc", "cannot be written"),
    Case("run-line --line line.yaml --train train.yaml --figure x", "ending '' must be"),
]  # fmt: skip

SCENARIO_FILES = [
    top("step_s = 1e-12", "'step_s' = 1e-12"),
    scenario("duration_s = 2.0", "duration_s = 20.0\nstep_s = 1e-6", "than 20 s, or choose a longer step"),
    top("step_s = 0.0", "'step_s' = 0.0"),
    top("record_period_s = 1e9", "'record_period_s' = 1000000000.0"),
    top("record_period_s = 1e3", "record_period_s = 1000.0 must not exceed duration_s = 2.0"),
    top("record_period_s = -0.01", "'record_period_s' = -0.01"),
    top("initial_speed_kmh = 1e6", "'initial_speed_kmh' = 1000000.0"),
    top("initial_speed_kmh = -1.0", "'initial_speed_kmh' = -1.0"),
    top("initial_speed_kmh = nan", "'initial_speed_kmh' = nan"),
    top("load_t = []", "0 loads for 8 cars"),
    top("load_t = [1e300]", "'load_t': 1e+300"),
    top("load_t = 'full'", "'load_t' = 'full'"),
    top("start_m = inf", "'start_m' = inf"),
    top("start_m = [[[]]]", "'start_m'"),
    top("case = 'B'", "is not TOML"),
    top("seed = 3", "unknown key 'seed'"),
    top("inverter_group = '2C4M'", "'inverter_group' = '2C4M'"),
    top("name = ''", "'name' = ''"),
    top("name = 'a b'", "'name' = 'a b'"),
    top("failures = 3", "'failures'"),
    top("failures = [{ unit = 99 }]", "no traction unit 99"),
    top("failures = [{ unit = 1, time_s = nan }]", "'failures[1].time_s' = nan"),
    top("coupler = { stiffness_n_per_m = 1e300 }", "'coupler.stiffness_n_per_m' = 1e+300"),
    scenario("duration_s = 2.0", "duration_s = 1e12", "'duration_s' = 1000000000000.0"),
    scenario("duration_s = 2.0", "duration_s = 36000.0", "axle-steps"),
    scenario("[[command]]", "[command]", "write [[command]], not [command]"),
    Case("simulate my-event", "did you mean the file my-event.toml?", {"my-event.toml": SHORT}),
    scenario("duration_s = 2.0", "duration_s = 0.001", "must not be below the control period"),
    scenario("duration_s = 2.0", "duration_s = '2'", "'duration_s' = '2'"),
    scenario("duration_s = 2.0", "duration_s = true", "'duration_s' = True"),
    scenario("duration_s = 2.0\n", "", "'duration_s' is missing"),
    scenario("duration_s = 2.0", f"duration_s = {HUGE}", "is not TOML"),
    scenario("duration_s = 2.0", "duration_s = 1e999", "'duration_s' = inf"),
    scenario("acceleration_kmhs = 3.0", "acceleration_kmhs = 1e9", "'command[1].acceleration_kmhs' = 1000000000.0"),
    scenario("acceleration_kmhs = 3.0", "acceleration_kmhs = nan", "'command[1].acceleration_kmhs' = nan"),
    scenario("[[command]]", "[command]", "'command'"),
    scenario("level = 0.05", "level = 1e300", "'rail.level' = 1e+300"),
    scenario("level = 0.05", "level = 0.0", "level = 0.0 must be"),
    scenario("level = 0.05", "level = -0.05", "level = -0.05 must be"),
    scenario("level = 0.05", "level = nan", "key 'rail.level' = nan"),
    scenario("level = 0.05", "level = 'wet'", "'rail.level' = 'wet'"),
    scenario("level = 0.05", "levl = 0.05", "unknown key 'rail.levl'; did you mean 'level'?"),
    scenario("level = 0.05", "level = 0.05\nlevel = 0.06", "is not TOML"),
    scenario("level = 0.05", "law_factor = 0.05", "without it say level"),
    scenario("level = 0.05\n", "", "level is missing"),
    scenario("level = 0.05", "level = 0.3\nspeed_law = 'shinkansen'", "with speed_law say law_factor"),
    scenario("level = 0.05", "speed_law = 'shinkansen'", "law_factor is missing"),
    scenario("level = 0.05", "level = 0.05\nrear_speed_law = [1.0, 1.0, 0.0]", "goes with speed_law"),
    scenario('increments = { law = "logarithmic" }\n', "", "'rail.increments' is missing: Growth"),
    scenario('{ law = "logarithmic" }', "{ slope = 0.01 }", "'rail.increments.law' is missing"),
    scenario('law = "logarithmic"', 'law = "none", slope = 0.01', "slope and offset go with"),
    scenario("level = 0.05", "law_factor = 0.05\nspeed_law = 'fast'", "speed_law = 'fast' is unknown"),
    scenario("level = 0.05", "level = 0.05\ncurve = { kind = 'polch' }", "did you mean 'polach'?"),
    scenario("level = 0.05", "level = 0.05\ncurve = { micro_slope = 1e300 }", "micro_slope"),
    scenario("level = 0.05", "level = 0.05\ncurve = { micro_slope = true }", "micro_slope"),
    scenario("level = 0.05", "level = 0.05\ncurve = { micro_slope = 1e6 }", "without rates as fast as"),
    added("[[rail.patches]]\nfactor = 0.5\nstart_m = 5.0\nend_m = 1.0\n", "rail.patches[1].start_m = 5.0 must lie before"),
    scenario("level = 0.05", f"level = 0.05\npatches = [{'{ factor = 0.5 },' * 2000}]", "at most 1000"),
    scenario('"commuter-8car"', '"comuter-8car"', "did you mean 'commuter-8car'?"),
    scenario('"commuter-8car"', '""', "unknown train ''"),
    scenario('"commuter-8car"', '"none.toml"', "train file 'none.toml' does not exist"),
    scenario('"commuter-8car"', r'"a\u0000b.toml"', "cannot be read"),
    scenario('"commuter-8car"', '["commuter-8car"]', "'train'"),
    scenario("load_error = 0.05", "load_error = -0.05", "load_error = -0.05"),
    scenario("load_error = 0.05", "dropouts = [{ axle = 99, begin_s = 0.0 }]", "dropout of axle 99"),
    scenario("loss = 0.1", "loss = 1.1", "loss = 1.1"),
    scenario("loss = 0.1", "period_s = 1e-6", "onboard.telegrams.period_s = 1e-06"),
    added("[onboard.mpc]\nhorizon = 1000000\n", "horizon"),
    added("[onboard.mpc]\nhorizn = 10\n", "horizn"),
    added("[onboard.cut_and_ramp]\nheld = 3\n", "held"),
    added("[line]\nfile = 'none.yaml'\n", "'none.yaml' does not exist"),
    added("[line]\nfile = ''\n", "Is a directory"),
    added("[line]\nfile = 'line.yaml'\nsections = [{ start_m = 0.0, grade_permille = 1.0 }]\n", "either file or sections"),
    added("[line]\nsections = [{ start_m = 0.0, grade_permille = 1e6 }]\n", "grade_permille"),
    added("[line]\ntunnels = [{ start_m = 5.0, end_m = 1.0 }]\n", "tunnel"),
    added("[line]\ncurves = [{ start_m = 5.0, end_m = 9.0, radius_m = 0.0 }]\n", "radius"),
    added('[line]\ncurve_law = "900/R"\n', "curve_law"),
    added('[onboard.braking]\nair_force = "sensor"\n', "air_force"),
    added('[onboard]\ntrigger = "slips"\n', "onboard.trigger"),
    added("[receptivity]\nperiod_s = 0.0\n", "receptivity.period_s = 0.0"),
    added("[belief]\nincrements = { law = 'given' }\n", "'belief.increments': values go with law"),
    added("[belief]\nunit_increments = []\n", "0 unit_increments"),
    Case("simulate bad.toml", "keys 'title', 'train', 'rail', 'command', 'duration_s' are missing", {"bad.toml": ""}),
    Case("simulate bad.toml", "is no text in UTF-8", {"bad.toml": bytes(range(256))}),
    Case("simulate bad.toml", "is no text in UTF-8", {"bad.toml": SHORT.encode("utf-16")}),
    Case("simulate bad.toml", "is not TOML", {"bad.toml": "\0" * 100}),
    Case("simulate bad.toml", "is not TOML", {"bad.toml": f"title = {DEEP}"}),
    Case("simulate bad.toml", "more than 1000000 bytes; give", {"bad.toml": "#" * 1_000_001}),
    Case("simulate bad.toml", "is not TOML", {"bad.toml": "title = "}),
]  # fmt: skip

TRAINS = [
    train('formation = "MTM"', 'formation = ""', "'formation' = ''"),
    train('formation = "MTM"', 'formation = "MXM"', "has a car 'X'"),
    train('formation = "MTM"', f'formation = "{"M" * 600}"', "'formation'"),
    train('name = "tram"', 'name = "../tram"', "'name' = '../tram'"),
    train('name = "tram"', 'name = "one-axle"', "train 'one-axle' exists already"),
    train("mass_t = 14.0", "mass_t = 1e300", "'car.M.mass_t' = 1e+300"),
    train("mass_t = 14.0", "mass_t = 0.0", "car.M.mass_t = 0.0"),
    train("mass_t = 14.0", "mass_t = -1.0", "car.M.mass_t = -1.0"),
    train("gear_ratio = 6.2", "gear_ratio = 0.0", "'car.M.motors.gear_ratio' = 0.0"),
    train("gear_ratio = 6.2", "gear_ratio = nan", "'car.M.motors.gear_ratio' = nan"),
    train("wheel_radius_m = 0.31\nwheel_inertia_kgm2 = 40.0", "wheel_radius_m = 310.0", "'car.M.wheel_radius_m' = 310.0"),
    train("axle_positions_m = [4.1, 5.9]", "axle_positions_m = []", "has no axles"),
    train("axle_positions_m = [4.1, 5.9]", "axle_positions_m = [5.9, 4.1]", "must grow"),
    train("pressure_kpa = 400.0, force_kn = 9.0", "pressure_kpa = 0.0, force_kn = 9.0", "pressure"),
    car("mass_t = 36.0", "mass_t = 36000.0", "'cars[1].mass_t' = 36000.0"),
    car("mass_t = 36.0", "mass_t = nan", "'cars[1].mass_t' = nan"),
    car("wheel_radius_mm = 430.0", "wheel_radius_mm = 0.43", "wheel_radius_mm"),
    car("[155.0, 65.0]", "[]", "wheel_inertia_kgm2"),
    car("[155.0, 65.0]", "[155.0, 65.0]\ndriven = [true]", "driven has 1 entries for 2"),
    car("[[cars]]", "[cars]", "'cars'"),
    Case("analyse log.csv --train bad.toml", "keys 'name', 'cars' are missing", {"bad.toml": ""}),
]  # fmt: skip

LINES = [
    path("schema", NOTHING, "key 'schema' is missing"),
    path("schema", 3, "key 'schema' = 3"),
    path("schema_version", "2030.01", "key 'schema_version' = '2030.01'"),
    path("paths", [], "'paths'"),
    path("paths", "all", "'paths'"),
    path(*SECTIONS, [], "'paths[1].characteristic_sections'"),
    path(*SECTIONS, [[0.0, 60, 0.0]], "characteristic_sections"),
    path(*SECTIONS, [[0.0, 60, 0.0]] * 6000, "characteristic_sections"),
    path(*SECTIONS, 1, [500.0, 40], "characteristic_sections[2]"),
    path(*SECTIONS, 1, 0, 0.0, "must lie beyond the one before"),
    path(*SECTIONS, 1, 0, math.nan, "characteristic_sections[2]"),
    path(*SECTIONS, 2, 0, 1e12, "characteristic_sections[3]: 1e+12"),
    path(*SECTIONS, 1, 1, 0, "speed limit 0 km/h must exceed 0"),
    path(*SECTIONS, 1, 1, 1e9, "characteristic_sections[2]: 1e+09"),
    path(*SECTIONS, 1, 1, "fast", "characteristic_sections[2]"),
    path(*SECTIONS, 1, 2, 1e300, "characteristic_sections[2]: 1e+300"),
    path(*SECTIONS, 1, 2, -80.0, "falls by 80 per mille"),
    path("paths", 0, "points_of_interest", [[9e3, "far", "front"]], "lies off the line"),
    path("paths", 0, "points_of_interest", [[400.0, "mid", "middle"]], "points_of_interest[1]"),
    path("schema_version", "2021.01", "'schema_version' = '2021.01': must be"),
    path("paths", NOTHING, "bad.yaml: key 'paths' is missing"),
    path(*SECTIONS, NOTHING, "bad.yaml: key 'paths[1].characteristic_sections' is missing"),
    path(*SECTIONS, 1, 0, -5.0, "characteristic_sections[2]: start -5 m must lie beyond the one before"),
    path(*SECTIONS, 1, 1, -40, "characteristic_sections[2]: speed limit -40 km/h must exceed 0"),
    path(*SECTIONS, 1, 2, math.nan, "characteristic_sections[2][3]' = nan: input should be a finite number"),
    path("paths", 0, "points_of_interest", 1, 0, 1e4, "'clear' at 10000 m lies off the line, which is 0 m to 900 m"),
    stock("vehicles", [], "'vehicles'"),
    stock("vehicles", NOTHING, "bad.yaml: key 'vehicles' is missing"),
    stock("trains", 0, "formation", ["R7"], "'trains[1].formation': unknown vehicle 'R7'; did you mean 'R1'?"),
    stock("schema_version", "2021.01", "must be '2022.05' or '2024.07'"),
    stock(*VEHICLE, "mass", "heavy", "'vehicles[1].mass' = 'heavy': input should be a valid number"),
    stock(*VEHICLE, "speed_limit", -50, "'vehicles[1].speed_limit' = -50: input should be greater than 0"),
    stock(*VEHICLE, "load_limit", -1, "'vehicles[1].load_limit' = -1: input should be greater than or equal to 0"),
    stock(*VEHICLE, "tractive_effort", [[0, 400e3], [60, 1e3]], "the effort needs an adhesion coefficient of 0.81"),
    Case("run-line --line bad.yaml --train train.yaml", "running path: no keys at the top", {"bad.yaml": ""}),
    Case("run-line --line bad.yaml --train train.yaml", "bad.yaml' is not YAML: ", {"bad.yaml": "{ ["}),
    Case("run-line --line train.yaml --train train.yaml", "rolling-stock.json': must be"),
    Case("run-line --line line.yaml --train bad.yaml", "rolling stock: no keys at the top", {"bad.yaml": ""}),
    Case("run-line --line line.yaml --train bad.yaml", "bad.yaml' is not YAML: ", {"bad.yaml": "a: b: c"}),
    stock(*VEHICLE, MISSPELT, "there is an unknown key 'vehicles[1].mas'; did you mean 'mass'?"),
    stock("trains", 0, "formation", [], "'trains[1].formation'"),
    stock("trains", 0, "formation", ["R1"] * 600, "'trains[1].formation'"),
    stock("trains", 0, "formation", ["R2"], "did you mean 'R1'?"),
    stock("vehicles", [STOCK["vehicles"][0]] * 2, "id 'R1' is there twice"),
    stock(*VEHICLE, "mass", NOTHING, "'vehicles[1].mass' is missing"),
    stock(*VEHICLE, "mass", 0.0, "'vehicles[1].mass' = 0.0"),
    stock(*VEHICLE, "mass", math.nan, "'vehicles[1].mass' = nan"),
    stock(*VEHICLE, "mass", 1e300, "'vehicles[1].mass' = 1e+300"),
    stock(*VEHICLE, "length", 1e9, "'vehicles[1].length' = 1000000000.0"),
    stock(*VEHICLE, "length", -5.0, "'vehicles[1].length' = -5.0"),
    stock(*VEHICLE, "a_braking", 0.6, "'vehicles[1].a_braking' = 0.6"),
    stock(*VEHICLE, "tractive_effort", [], "'vehicles[1].tractive_effort'"),
    stock(*VEHICLE, "tractive_effort", NOTHING, "tractive_effort is missing"),
    stock(*VEHICLE, "tractive_effort", 0, 1, 1e12, "tractive_effort"),
    stock(*VEHICLE, "tractive_effort", 1, 0, 0.0, "tractive_effort: speeds must grow"),
    stock(*VEHICLE, "vehicle_type", "boat", "'vehicles[1].vehicle_type' = 'boat'"),
    stock(*VEHICLE, "mass_traction", 99.0, "mass_traction = 99.0 exceeds mass"),
    path("paths", [PATH["paths"][0]] * 2, "paths: id 'p1' is there twice"),
    path("paths", 0, "name", 7, "'paths[1].name' = 7"),
    path("paths", 0, None, "'paths[1]'"),
    path(*SECTIONS, [[500.0, 60, 0.0], [0.0, 40, 8.0]], "start 0 m must lie beyond the one before, 500 m"),
    path(*SECTIONS, [[-1e9, 60, 0.0], [0.0, 40, 8.0]], "characteristic_sections[1]: -1e+09 must be at most"),
    path(*SECTIONS, [[-9e6, 60, 0.0], [0.0, 40, 8.0]], "the line is 9e+06 m long"),
    path(*SECTIONS, [[5.0 * k, 60, 0.0] for k in range(30_000)], "characteristic_sections"),
    path(*SECTIONS, {}, "characteristic_sections"),
    path(*SECTIONS, 1, 1, True, "must be a number"),
    path(*SECTIONS, 1, 1, "60", "number"),
    named(*SECTIONS, 0, "speed", 0, "'paths[1].characteristic_sections[1].speed' = 0"),
    named(*SECTIONS, 0, {"position": 0.0}, "speed and resistance are missing"),
    named(*SECTIONS, 0, {"speed": 80}, "'paths[1].characteristic_sections[1].position' is missing"),
    named(*SECTIONS, 0, [0.0, 80, 0.0], "characteristic_sections[1]"),
    named(*SECTIONS, 1, "position", -1.0, "must lie beyond the one before"),
    named(*SECTIONS, 0, "position", "start", "'start'"),
    named("paths", 0, "points_of_interest", 0, "measure", "end", "'end'"),
    named("paths", 0, "id", NOTHING, "'paths[1].id' is missing"),
    stock("trains", [STOCK["trains"][0]] * 3, "trains: id 'T' is there 3 times"),
    stock(*VEHICLE, "mass", "66", "must be a number without quotes, not '66'"),
    stock(*VEHICLE, "mass", True, "must be a number without quotes, not True"),
    stock(*VEHICLE, "mass", [66.0], "'vehicles[1].mass'"),
    stock("vehicles", None, "'vehicles'"),
    stock("trains", 0, "formation", "R1", "'trains[1].formation'"),
    Case("run-line --line bad.yaml --train train.yaml", "no keys at the top", {"bad.yaml": ""}),
    Case("run-line --line bad.yaml", "is no text in UTF-8", {"bad.yaml": "name: Görlitz".encode("latin-1")}),
    Case("run-line --line bad.yaml", "key 'schema' is there twice", {"bad.yaml": "schema: a\nschema: b\n"}),
    Case("run-line --line bad.yaml", "nested more than 20 deep", {"bad.yaml": "[" * 900_000}),
    Case("run-line --line bad.yaml", "nested more than 20 deep", {"bad.yaml": "- " * 300_000}),
    line_file("end_m = 2000.0", "end_m = 900.0", "sections[3]: start 900 m must lie beyond the one before"),
    line_file("end_m = 2000.0", "", "key 'end_m' is missing"),
    line_file("limit_kmh = 60.0", "limit_kmh = 0.0", "sections[2]: speed limit 0 km/h"),
    line_file("limit_kmh = 60.0", "limit_km = 60.0", "did you mean 'limit_kmh'?"),
    line_file("limit_kmh = 60.0", "limit_kmh = nan", "'sections[2].limit_kmh' = nan"),
    line_file("start_m = 1000.0", "start_m = -1000.0", "start -1000 m must lie beyond"),
    line_file("station_m = 500.0", "station_m = 5000.0", "points[1]: 'halt' at 5000 m lies off the line"),
    line_file("dwell_s = 20.0", "dwell_s = -20.0", "'points[1].dwell_s' = -20.0"),
    line_file("dwell_s = 20.0", "dwell_s = 1e5", "stop 'halt': dwell 100000 s"),
    line_file('name = "own"', 'name = ""', "'name' = ''"),
    train("torque_nm = 750.0, power_kw = 90.0", "power_kw = 90.0", "torque_nm is missing"),
    train("torque_nm = 750.0, power_kw = 90.0", "effort_kn = [9.0]", "effort_speed_kmh has 0 entries, effort_kn 1"),
    train("power_kw = 90.0", "power_kw = 90.0, effort_kn = [9.0, 1.0]", "not both"),
    train(
        "torque_nm = 750.0, power_kw = 90.0", "effort_speed_kmh = [9.0, 1.0], effort_kn = [9.0, 1.0]",
        "effort_speed_kmh must grow",
    ),
    Case("run-line --line bad.yaml --train train.yaml", "no keys at the top", {"bad.yaml": "[1]"}),
    Case("run-line --line bad.yaml --train train.yaml", "is not YAML", {"bad.yaml": DEEP}),
    Case("run-line --line bad.yaml --train train.yaml", "is not YAML", {"bad.yaml": "a: [b"}),
    Case("run-line --line bad.yaml --train train.yaml", "is not YAML", {"bad.yaml": "a: !!python/name:os.system ''"}),
    Case("run-line --line bad.yaml --train train.yaml", "is no text in UTF-8", {"bad.yaml": b"\xff\xfe\x00"}),
    Case("run-line --line bad.yaml --train train.yaml", "more than 1000000 bytes; give", {"bad.yaml": "#" * 1_000_001}),
]  # fmt: skip

HEADER = LOG.partition("\n")[0] + "\n"
LOGS = [
    plain_log("", "bad.csv"),
    plain_log("\n\n\n", "bad.csv"),
    plain_log(HEADER, "0 rows"),
    plain_log(HEADER + "0.0,36.0,36.0,5.0\n", "1 rows"),
    plain_log(bytes(range(256)), "bad.csv"),
    plain_log("\0" * 1000, "bad.csv"),
    plain_log(LOG.partition("\n")[2], "give every column a name"),
    log("time_s", "tme_s", "column 'time_s'"),
    log("speed_kmh,", "sped_ms,", "is missing"),
    log("axle1_speed_kmh", "speed_of_axle", "is missing"),
    log("axle1_speed_kmh", "axle9_speed_kmh", "has 2 axles"),
    log("axle1_speed_kmh", "speed_kmh", "'speed_kmh' is there twice"),
    log("axle1_force_kn", "axle1_speed_ms", "give one"),
    log("1.0,36.0,", "5.0,36.0,", "column 'time_s', row 12: time goes back: 1.1 s after 5 s"),
    log("1.0,36.0,", "inf,36.0,", "column 'time_s', row 11"),
    log("1.0,36.0,", "12h,36.0,", "'12h' is not a number"),
    log("1.0,36.0,", "1.0,3x6,", "'3x6' is not a number"),
    log("1.0,36.0,", "1.0,1e308,", "faster than any train"),
    log("1.0,36.0,", "1.0,-36.0,", "is negative"),
    log(",5.0\n", ",5000.0\n", "axle loads at the rim"),
    log(",5.0\n", ",5.0,7\n", "bad.csv"),
    log("1.0,36.0,", '1.0,"36.0,', "bad.csv"),
    Case("analyse bad.parquet --train car.toml", "is no table of parquet", {"bad.parquet": LOG}),
    Case("analyse bad.parquet --train car.toml", "is no table of parquet", {"bad.parquet": ""}),
]  # fmt: skip

PLUGINS = [
    Case("--plugin none.py list", "is no file"),
    Case("--plugin '' list", "is no file"),
    Case("--plugin folder list", "is no file"),
    plugin("", "registers nothing"),
    plugin("# only a comment\n", "registers nothing"),
    plugin("def (", "SyntaxError"),
    plugin("1 / 0", "ZeroDivisionError"),
    plugin("import sys\nsys.exit(0)", "SystemExit"),
    plugin("raise SystemExit", "SystemExit"),
    plugin("import nothing_of_this_name", "ModuleNotFoundError"),
    plugin("\0", "bad.py"),
    plugin(b"\xff\xfe", "SyntaxError"),
    plugin("x = 1", "is no file", "bad.txt"),
    plugin("from alloc.rules import RULES\nRULES.register('exact', None)", "rule 'exact' exists already"),
    plugin("from studies.scenario.scenario import SCENARIOS\nSCENARIOS.register('wet-start', {})", "exists already"),
    plugin("", "bad.toml", "bad.toml"),
    Case("--plugin weird.py compare --scenario own", "title", {
        "weird.py": "from studies.scenario.scenario import SCENARIOS\nSCENARIOS.register('own', {})"}),
]  # fmt: skip

BATTERY = {
    "command lines": COMMAND_LINES, "scenarios": SCENARIO_FILES, "trains": TRAINS, "lines": LINES, "logs": LOGS,
    "plug-ins": PLUGINS,
}  # fmt: skip
GOOD = {
    "short.toml": SHORT,
    "other/short.toml": SHORT.replace("duration_s = 2.0", "duration_s = 3.0"),
    "line.yaml": yaml.safe_dump(PATH),
    "train.yaml": yaml.safe_dump(STOCK),
    "car.toml": CAR,
    "log.csv": LOG,
}


def keep_registries(patched) -> None:
    """A plug-in may register something before it is refused."""
    for registry in REGISTRIES:
        list(registry)
        patched.setattr(registry, "_parts", dict(registry._parts))
        patched.setattr(registry, "_origins", dict(registry._origins))


@pytest.fixture
def place(tmp_path, monkeypatch):
    """A folder of good files to be called in; nothing may be simulated."""

    def no_run(*_, **__):
        raise AssertionError("a run was begun before bad input was refused")

    monkeypatch.setattr(ClosedLoop, "run", no_run)
    for module in ("studies.core.run", "studies.core.study", "paper_figs.drawing"):
        monkeypatch.setattr(f"{module}.run_cells", no_run)
    keep_registries(monkeypatch)
    monkeypatch.setenv(VARIABLE, "")
    monkeypatch.chdir(tmp_path)
    for folder in ("folder", "folder.nc", "folder.csv", "taken.train.toml", "other"):
        (tmp_path / folder).mkdir()
    write(tmp_path, GOOD)
    return tmp_path


def write(folder: Path, files: Mapping[str, str | bytes]) -> None:
    for name, content in files.items():
        data = content.encode() if isinstance(content, str) else content
        (folder / name).write_bytes(data)


def tree(folder: Path) -> dict[str, tuple[int, int]]:
    """Everything below a folder with its size and time of change."""
    found = {}
    for item in sorted(folder.rglob("*")):
        state = item.stat()
        found[str(item)] = (state.st_size, state.st_mtime_ns)
    return found


def test_the_battery_meets_every_command_and_is_large():
    told = " ".join(case.line for cases in BATTERY.values() for case in cases)
    commands = [name for name in app if not name.startswith("-")]
    assert len(commands) >= 7
    assert all(name in told for name in commands)
    assert sum(map(len, BATTERY.values())) >= 400


@pytest.mark.parametrize("kind", BATTERY)
def test_bad_input_is_one_line_and_exit_code_2_and_nothing_is_written(
    place, call, kind, monkeypatch
):
    wrong = []
    for case in BATTERY[kind]:
        write(place, case.files)
        before = tree(place)
        with monkeypatch.context() as patched:
            keep_registries(patched)
            code, out, err = call(*shlex.split(case.line))
        one_line = err.startswith("readhesion: ") and err.count("\n") == 1 and len(err) < 2000
        if (code, out) != (2, "") or not one_line or case.words not in err or tree(place) != before:
            wrong.append(
                f"{case.line} must say {case.words!r}; exit code {code}: {out}{err[:2000]}"
            )
        for name in case.files:
            (place / name).unlink()
        write(place, {name: GOOD[name] for name in set(case.files) & set(GOOD)})
        assert tree(place).keys() == before.keys() - {
            str(place / n) for n in set(case.files) - set(GOOD)
        }
    assert not wrong, "\n".join(wrong)


def keys_of(kind: type[BaseModel], base: dict[str, Any], place: tuple = ()) -> list:
    """(path, content of its table that has all that this needs, name, annotation) of every key of `kind` but tables."""
    found = []
    kind = kind.complete() if issubclass(kind, Strict) else kind
    for name, field in kind.model_fields.items():
        record = _record_in(field.annotation)
        if record is not None:
            several = "tuple" in str(field.annotation)
            inner = {
                key: NEEDED[key] for key, own in record.model_fields.items() if own.is_required()
            }
            found += keys_of(record, inner, (*place, (name, several)))
        else:
            found.append((place, base, name, field.annotation))
    return found


NEEDED = {
    "factor": 0.5, "stiffness_n_per_m": 2e7, "unit": 1, "start_m": 0.0, "end_m": 100.0, "axle": 0,
    "grade_permille": 5.0, "radius_m": 300.0, "time_s": 0.0, "acceleration_kmhs": 3.0, "level": 0.1, "begin_s": 0.0,
    "increments": {"law": "none"}, "law": "logarithmic",
}  # fmt: skip
ALL_KEYS = [key for key in keys_of(Scenario, {}) if not any("mpc_" in t for t, _ in key[0])]
"""Every key of a scenario; settings of controllers too, of the MPC once."""
KEYS = [key[:3] for key in ALL_KEYS if re.search("float|int", str(key[3]))]
"""Those that hold numbers."""


NO_NUMBERS = (math.nan, math.inf, -math.inf, 1e300, "0.1", "wet", {}, True, [[]], [math.nan])


def content_with(place, base, name, value) -> dict[str, Any]:
    """The content of a scenario file in which one key has `value`."""
    content: Any = dict(base) | {name: value}
    for table, several in reversed(place):
        content = {table: [content] if several else content}
    top = {
        "name": "own", "title": "t", "train": "one-axle", "duration_s": 0.1,
        "command": [{"time_s": 0.0, "acceleration_kmhs": 3.0}],
    }  # fmt: skip
    rail = {"increments": {"law": "none"}} | content.get("rail", {})
    if "law_factor" in rail:
        rail["speed_law"] = "shinkansen"
    elif rail.get("speed_law", "none") == "none" and "rear_speed_law" not in rail:
        rail = {"level": 0.1} | rail
    elif "rear_speed_law" in rail:
        rail |= {"speed_law": "shinkansen", "law_factor": 1.0}
    else:
        rail = {"law_factor": 1.0} | rail
    return top | content | {"rail": rail}


def test_no_number_key_takes_what_is_no_number_or_ends_in_a_traceback():
    for place, base, name in KEYS:
        for value in (*NO_NUMBERS, 0, -1, 0.0, -1.0, [], [0.0], [-1.0], 1e-300, 1, 1e6):
            message = "nothing is said"
            try:
                parse(Scenario, content_with(place, base, name, value), "own.toml").event()
            except StudyError as error:
                message = str(error)
            if any(value is one for one in NO_NUMBERS):
                case = f"{place} {name} = {value}: {message}"
                assert name in message, case
                assert "\n" not in message, case


def test_files_with_blanks_and_byte_order_marks_work(place, monkeypatch):
    from studies.lines.named_files import with_real_input
    from studies.logs.measured_log import read_log
    from studies.logs.train import read_log_train
    from studies.scenario.scenario import load_scenario

    mark = b"\xef\xbb\xbf"
    write(place, {
        "my event.toml": mark + SHORT.encode(), "my line.yaml": mark + yaml.safe_dump(PATH).encode(),
        "my train.yaml": yaml.safe_dump(STOCK), "my log.csv": mark + LOG.encode(),
        "my car.toml": mark + CAR.encode(),
    })  # fmt: skip
    found = load_scenario("my event.toml")
    assert found.name == "my-event"
    real = with_real_input(found, "my line.yaml", "my train.yaml")
    assert real.name == "my-event+my-line+my-train"
    assert read_log("my log.csv", read_log_train("my car.toml")).run.time.size == 20


@pytest.mark.skipif(os.geteuid() == 0, reason="nothing is unreadable for root")
@pytest.mark.parametrize("line", ["simulate short.toml", "analyse log.csv --train car.toml"])
def test_a_file_that_may_not_be_read_is_refused(place, call, line):
    for name in ("short.toml", "log.csv"):
        (place / name).chmod(0)
    code, _, err = call(*shlex.split(line))
    assert (code, err.count("\n")) == (2, 1)
    assert "Permission denied" in err


def process(*arguments: str, **environment: str) -> subprocess.Popen:
    command = [sys.executable, "-m", "studies.command_line"]
    return subprocess.Popen(
        [*command, *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        env=os.environ | environment,
    )  # fmt: skip


def test_a_reader_who_leaves_early_ends_the_command_quietly():
    with process("list") as running:
        assert running.stdout is not None
        running.stdout.close()  # as `| head` does, before anything is written
        assert running.stderr is not None
        assert running.stderr.read() == b""
        assert running.wait(timeout=600) == 141


@pytest.mark.parametrize("arguments", [["list"], ["sweep", "--help"]])
def test_a_terminal_of_plain_letters_gets_plain_letters(arguments):
    running = process(*arguments, PYTHONIOENCODING="ascii", LC_ALL="C", PYTHONUTF8="0")
    out, err = running.communicate(timeout=600)
    assert (running.returncode, err) == (0, b"")
    assert out.decode("ascii").strip()


def test_as_a_process_bad_input_is_one_line_and_exit_code_2():
    running = process("simulate", "wet-strät", PYTHONIOENCODING="ascii", LC_ALL="C")
    out, err = running.communicate(timeout=600)
    assert (running.returncode, out, err.count(b"\n")) == (2, b"", 1)
    assert b"did you mean 'wet-start'?" in err
