"""One log in the formats, namings and writings of many recorders is one reading."""

import sys
import zipfile
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.io import savemat

from studies.files.study_error import StudyError
from studies.logs.channels import open_channels
from studies.logs.mapping import (
    SI,
    Mapping,
    draft_text,
    factor,
    kinds_of,
    read_mapping,
    registry,
    told_by_names,
)
from studies.logs.measured_log import check_log, read_log
from studies.logs.measured_run import analyse_run
from studies.logs.own_samples import _gained, numbers
from studies.logs.recorder_files import READERS, decimal_of, encoding_of, numbers_of, read_recording
from studies.logs.remarks import MOST, grouped
from studies.logs.train import GradientLine, MeasuredTrain
from tests.studies.test_measured_log import TRAIN, make_table

TABLE = make_table()
TABLE.columns = pd.Index([name.replace("speed_ms", "speed_kmh") for name in TABLE])
TABLE[[name for name in TABLE if "speed" in name]] *= 3.6
TIME = TABLE["time_s"].to_numpy()
AXLES = range(1, 5)
WHEELS, FORCES = ([f"axle{n}_{what}" for n in AXLES] for what in ("speed_kmh", "force_kn"))
TRUTH = {("speed", 0): TABLE["speed_kmh"] / 3.6}
TRUTH |= {("wheel", n): TABLE[WHEELS[n - 1]] / 3.6 for n in AXLES}
TRUTH |= {("effort", n): TABLE[FORCES[n - 1]] * 1e3 for n in AXLES}


def channels(path: Path, mapping: Mapping | None = None, train: MeasuredTrain = TRAIN):
    """What a file says: instants from the first and values in SI units by place."""
    opened = open_channels(read_recording(path), train, mapping, "mapping file")
    found = {}
    for place in opened.assigned:
        if place != ("time", 0):
            time, values = opened.series(place)
            found[place] = time - time[0], opened.scaled(place, values)
    return found


def named(
    time, train, wheel, force, table=TABLE, speed=1.0, wheels=1.0, forces=1.0
) -> pd.DataFrame:
    """The log under other names and in other units: patterns of n, of the car c and the axle in it k."""
    numbers = [{"n": n, "c": "AB"[(n - 1) // 2], "k": (n - 1) % 2 + 1, "z": n - 1} for n in AXLES]
    found = table.copy()
    found["speed_kmh"] *= speed
    found[WHEELS] *= wheels
    found[FORCES] *= forces
    columns = {"time_s": time, "speed_kmh": train}
    for one in numbers:
        columns[WHEELS[one["z"]]] = wheel.format(**one)
        columns[FORCES[one["z"]]] = force.format(**one)
    return found.rename(columns=columns)


RPM = 60.0 / 3.6 / 0.43 / (2.0 * np.pi)
GERMAN = (
    "Messzeit [s]", "Zuggeschwindigkeit [km/h]", "Raddrehzahl Radsatz {n} [U/min]", "Längskraft Radsatz {n} [daN]"
)  # fmt: skip
JAPANESE = ("時刻[s]", "対地速度[km/h]", "第{n}軸 軸速度[km/h]", "第{n}軸 周方向力[kN]")
BY_CAR = (
    "Elapsed Time (sec)", "GPS Speed (mph)", "Car {c} Axle {k} Speed (mph)", "Car {c} Axle {k} Tractive Effort (lbf)"
)  # fmt: skip
BARE = ("t", "v", "BCU.WheelSpeed[{z}]", "TCU.AxleForce[{z}]")
MILE, POUND = 1.0 / 1.609344, 1e3 / 4.4482216152605


def with_units_below(path: Path) -> None:
    """Lines about the recorder, names in one row, units in the next."""
    table = named("Time", "GPS/Velocity", "Axle0{n}/v", "Axle0{n}/F_rim", wheels=1 / 3.6 / 0.43, forces=1e3)  # fmt: skip
    units = ["(s)", "(km/h)"] + ["(rad/s)", "(N)"] * 4
    with open(path, "w", encoding="utf-16") as out:
        out.write("File:\trun 7\nRate [Hz]:\t50\n\n" + "\t".join(table) + "\n" + "\t".join(units) + "\n")  # fmt: skip
        table.to_csv(out, sep="\t", decimal=",", header=False, index=False)


def mdf(path: Path) -> None:
    asammdf = pytest.importorskip("asammdf")
    file = asammdf.MDF(version="4.10")
    for part in ("speed", "force"):
        unit = "km/h" if part == "speed" else "kN"
        signals = [asammdf.Signal(TABLE[n].to_numpy(), TIME, name=n.rpartition("_")[0], unit=unit)
                   for n in TABLE if part in n]  # fmt: skip
        file.append(signals)
    file.save(path)


def tdms(path: Path) -> None:
    library = pytest.importorskip("nptdms")
    told = {"wf_increment": 0.02, "wf_start_offset": 0.0, "wf_samples": 1}
    with library.TdmsWriter(path) as writer:
        writer.write_segment([library.ChannelObject("run", name, TABLE[name].to_numpy(), told)
                              for name in TABLE if name != "time_s"])  # fmt: skip


def mat_of_matrices(path: Path) -> None:
    run = {"time": TIME, "v_train_kmh": TABLE["speed_kmh"].to_numpy(), "comment": "brake test"}
    run |= {"wheel_speed_ms": TABLE[WHEELS].to_numpy() / 3.6, "fs": 50.0}
    run |= {"wheel_force": {"values": TABLE[FORCES].to_numpy(), "unit": "kN"}}
    savemat(path, {"run": run}, do_compression=True)


def mat_of_structs(path: Path) -> None:
    axles = [{"speed": {"data": TABLE[w].to_numpy(), "unit": "km/h"}, "force": TABLE[f].to_numpy()}
             for w, f in zip(WHEELS, FORCES, strict=True)]  # fmt: skip
    log = {"time": TIME, "train_speed": TABLE["speed_kmh"].to_numpy() / 3.6}
    savemat(path, {"log": log | {"axle": np.array(axles, dtype=object)}})


def mat_73(path: Path) -> None:
    """Each channel has a struct with its own clock, as MATLAB writes version 7.3."""
    h5py = pytest.importorskip("h5py")
    units = {"speed_kmh": "km/h"} | dict.fromkeys(WHEELS, "km/h") | dict.fromkeys(FORCES, "kN")
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, unit in units.items():
            group = file.create_group(name.rpartition("_")[0])
            for key, values in (("Time", TIME), ("Data", TABLE[name].to_numpy())):
                group.create_dataset(key, data=values[None]).attrs["MATLAB_class"] = np.bytes_("double")  # fmt: skip
            text = group.create_dataset("Units", data=np.array([[ord(c)] for c in unit], dtype=np.uint16))  # fmt: skip
            text.attrs["MATLAB_class"] = np.bytes_("char")
    with open(path, "r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")


def csv(table: pd.DataFrame = TABLE, **options):
    return lambda path: table.to_csv(path, index=False, **options)


FORMATS = {
    "plain.csv": csv(), "mark.csv": csv(encoding="utf-8-sig"), "wide.csv": csv(sep=";", encoding="utf-16"),
    "semicolon.csv": csv(sep=";", decimal=","), "tab.txt": csv(sep="\t"), "bar.dat": csv(sep="|"),
    "packed.csv.gz": csv(), "packed.csv.xz": csv(), "packed.csv.bz2": csv(),
    "packed.zip": csv(compression={"method": "zip", "archive_name": "a/log.csv"}),
    "shuffled.csv": csv(TABLE[sorted(TABLE, key=lambda name: name[::-1])]),
    "ended.csv": lambda p: p.write_text(TABLE.to_csv(index=False).replace("\n", ",\n")),
    "table.parquet": lambda p: TABLE.to_parquet(p),
    "german.csv": csv(named(*GERMAN, wheels=RPM, forces=100.0), sep=";", decimal=",", encoding="cp1252"),
    "japanese.csv": csv(named(*JAPANESE), encoding="cp932"),
    "cars.csv": csv(named(*BY_CAR, speed=MILE, wheels=MILE, forces=POUND)),
    "bare.csv": csv(named(*BARE)), "below.txt": with_units_below,
    "log.mf4": mdf, "log.tdms": tdms, "matrices.mat": mat_of_matrices, "structs.mat": mat_of_structs, "own.mat": mat_73,
}  # fmt: skip


def test_every_format_gives_the_same_channels_and_its_draft_the_same_again(tmp_path):
    for name, write in FORMATS.items():
        path, drafted = tmp_path / name, tmp_path / "log.toml"
        write(path)
        drafted.write_text(draft_text(read_recording(path), TRAIN), encoding="utf-8")
        found, again = channels(path), channels(path, read_mapping(drafted))
        assert found.keys() == again.keys() == TRUTH.keys(), name
        for place, truth in TRUTH.items():
            np.testing.assert_allclose(found[place][0], TIME, atol=1e-9, err_msg=name)
            np.testing.assert_allclose(found[place][1], truth, 1e-9, 1e-9, err_msg=name)
            np.testing.assert_array_equal(found[place], again[place], err_msg=name)


def test_no_guess_is_silent(tmp_path):
    """What the names and the sizes of values suggest is said, and marked in the draft; what nobody uses is in it too."""
    table = named("Zeit", "v_GPS [km/h]", "n_Achse{n} [1/min]", "F_Achse{n}", wheels=RPM, forces=1e3)  # fmt: skip
    table.assign(Licht=1.0, imp_1=np.arange(600)).to_csv(tmp_path / "log.csv", index=False)
    log = read_log(tmp_path / "log.csv", TRAIN)
    said = [remark.text for remark in log.remarks if remark.kind == "guess"]
    assert "'n_Achse1 [1/min]' to 'n_Achse4 [1/min]': axle 1 to 4 speed in 1/min" in said
    assert said.count("no unit, read as N") == 4
    lines = draft_text(read_recording(tmp_path / "log.csv"), TRAIN).splitlines()
    (force,) = [
        line for line in lines if line.startswith('"F_Achse1" = { is = "axle1_force", unit = "N" }')
    ]
    assert force.endswith("# guessed from the name, unit guessed from the size of the values")
    assert '# "Licht" = { is = "" }  # not known' in lines
    assert sum("# guessed" in line for line in lines) == 10


MAPPING = """
[columns]
"Messzeit [s]" = { is = "time" }
"v" = { is = "speed", unit = "km/h" }
"n1" = { is = "axle1_speed", unit = "rpm" }
"n2" = { is = "axle2_speed", unit = "rpm", gear_ratio = 2.0 }
"F1" = { is = "axle1_force", unit = "kN", sign = -1 }
"p2" = { is = "axle2_pressure", unit = "bar", newton_per_kpa = 60.0 }
[wheels]
radius_mm = [430.0, 420.0, 430.0, 430.0]
"""
MAPPED = named("Messzeit [s]", "v", "n{n}", "F{n}", wheels=RPM).assign(p2=1.5)


def test_a_mapping_says_what_is_used_and_how(tmp_path):
    path = tmp_path / "log.csv"
    MAPPED.to_csv(path, index=False)
    (tmp_path / "log.toml").write_text(MAPPING)
    told = read_mapping(tmp_path / "log.toml")
    found = channels(path, told, told.train(TRAIN, ""))
    assert found.keys() == {("speed", 0), ("wheel", 1), ("wheel", 2), ("effort", 1), ("effort", 2)}
    np.testing.assert_allclose(found["wheel", 1][1], TRUTH["wheel", 1], rtol=1e-9)
    np.testing.assert_allclose(found["wheel", 2][1], TRUTH["wheel", 2] * 0.5 * 42 / 43, rtol=1e-9)
    np.testing.assert_allclose(found["effort", 1][1], -TRUTH["effort", 1], rtol=1e-9)
    opened = open_channels(read_recording(path), TRAIN, told, "")
    assert opened.assigned["effort", 2].newton_per_pascal == 0.06
    left = [remark.text for remark in opened.remarks]
    assert "the mapping file does not name 'n3' to 'n4': axle 3 to 4 speed; so it is not used" in left  # fmt: skip


REFUSED = [
    ('"v"', '"w"', "column 'w'"), ('"axle1_speed"', '"axle1_sped"', "'axle1_sped' is no quantity"),
    ('"km/h"', '"bar"', "unit 'bar' is no unit of a speed"), ("sign = -1", "sing = -1", "unknown key"),
    ("[430.0, 420.0, 430.0, 430.0]", "[430.0]", "1 radii for 4 axles"), (", newton_per_kpa = 60.0", "", "newton_per_kpa"),
    ("sign = -1", "gear_ratio = 2.0", "gear_ratio is for"), ('"axle1_force"', '"axle9_force"', "has 4 axles"),
    ('"axle2_pressure", unit = "bar", newton_per_kpa = 60.0', '"axle2_pulses"', "give pulses_per_turn"),
    ('"axle1_force"', '"axle1_torque"', "unit 'kN' is no unit of a torque"),
    ('"axle2_pressure", unit = "bar", newton_per_kpa = 60.0', '"axle1_force", unit = "N"', "is the same as 'F1'"),
]  # fmt: skip


def test_a_faulty_mapping_is_refused_in_one_sentence(tmp_path):
    MAPPED.to_csv(tmp_path / "log.csv", index=False)
    for old, new, words in REFUSED:
        assert MAPPING.count(old) == 1
        (tmp_path / "log.toml").write_text(MAPPING.replace(old, new))
        with pytest.raises(StudyError) as caught:
            read_log(tmp_path / "log.csv", TRAIN, read_mapping(tmp_path / "log.toml"))
        assert words in str(caught.value)
        assert "\n" not in str(caught.value)


def test_a_log_of_another_train_says_so_by_number(tmp_path, call):
    """Experiment of issue 39: half of a train's axles gave a negative Q."""
    from studies.logs.simulated import write_log
    from tests.simulation.slides import TRAIN as THREE_CARS
    from tests.simulation.slides import braked, readhering

    path, drafted = tmp_path / "log.csv", tmp_path / "log.toml"
    write_log(braked(readhering, duration=3.0), THREE_CARS, path)
    table = pd.read_csv(path)
    few = [name for name in table if not name.startswith("axle") or int(name[4:].split("_")[0]) <= 8]  # fmt: skip
    table[few].to_csv(path, index=False)
    analyse = ("analyse", path, "--train", tmp_path / "log.train.toml")
    code, _, err = call(*analyse)
    assert code == 2
    assert "8 axles, the train has 12" in err
    assert call(*analyse, "--map", drafted)[0] == 0
    assert call(*analyse, "--map", drafted)[0] == 2  # it may have been corrected
    assert "8 axles, the train has 12" in call(*analyse, "--json")[2]
    drafted.write_text(drafted.read_text() + "[wheels]\npartial = true\n")
    assert call(*analyse, "--json")[0] == 0
    assert call(*analyse, path, "--map", tmp_path / "a.toml")[0] == 2


def test_what_is_no_file_of_its_ending_or_needs_a_package_is_refused_in_one_sentence(
    tmp_path, monkeypatch
):
    for ending in (*READERS, ".csv", ".csv.gz", ".zip"):
        path = tmp_path / f"log{ending}"
        for content in (b"", b"-" * 600, bytes(range(256)) * 4):
            path.write_bytes(content)
            with pytest.raises(StudyError, match=r"^log '.*log\.") as caught:
                read_recording(path)
            assert "\n" not in str(caught.value)
    savemat(tmp_path / "text.mat", {"name": "no arrays", "fs": 100.0})
    with pytest.raises(StudyError, match="has no channels"):
        read_recording(tmp_path / "text.mat")
    with zipfile.ZipFile(tmp_path / "log.zip", "w") as archive:
        archive.writestr("export/run.csv", TABLE.to_csv(index=False))
        archive.writestr("export/readme.md", "nothing")
    assert read_log(tmp_path / "log.zip", TRAIN).rows == len(TABLE)
    with zipfile.ZipFile(tmp_path / "log.zip", "a") as archive:
        archive.writestr("second.csv", "a,b")
    with pytest.raises(StudyError, match="2 tables of text"):
        read_log(tmp_path / "log.zip", TRAIN)
    for ending, module, package in (
        ("mf4", "asammdf", "asammdf"), ("tdms", "nptdms", "npTDMS"), ("mat", "h5py", "h5py"),
    ):  # fmt: skip
        monkeypatch.setitem(sys.modules, module, None)
        path = tmp_path / f"log.{ending}"
        path.write_bytes(b"MATLAB 7.3 MAT-file".ljust(520))
        with pytest.raises(StudyError, match=rf"needs the package {package}.*\.\[logs\]"):
            read_recording(path)


def clocks() -> dict[str, object]:
    """The instants of the log by many clocks."""
    seconds, index = TABLE["time_s"], pd.to_timedelta(TABLE["time_s"], unit="s")
    at = pd.Timestamp("2026-03-29 00:59:58") + index
    return {
        "utc": at.dt.strftime("%Y-%m-%dT%H:%M:%S.%fZ"), "german": at.dt.strftime("%d.%m.%Y %H:%M:%S,%f"),
        "seconds": at.dt.strftime("%Y-%m-%d %H:%M:%S"), "clock": at.dt.strftime("%H:%M:%S.%f"),
        "datetime.parquet": at, "epoch": seconds + 1.774e9, "days of a spreadsheet": 46100.25 + seconds / 86400.0,
        "milliseconds": np.round(1e3 * (seconds + 1.774e9)).astype(np.int64),
        "whole microseconds": np.round(1e6 * seconds).astype(np.int64),
        "minutes and seconds": [f"{int(t // 60):02d}:{t % 60:06.3f}" for t in seconds + 50.0],
        "nanoseconds since 1970": np.round(1e9 * seconds).astype(np.int64) + 1_790_000_000_000_000_000,
        "index.parquet": index, "zone.parquet": pd.Timestamp("2026-02-02", tz="Asia/Tokyo") + index,
    }  # fmt: skip


def test_every_clock_gives_the_same_instants_and_wheel_damage(tmp_path):
    expected = analyse_run(check_log(TABLE, TRAIN, "log").run, TRAIN).total_damage
    wrong = {}
    for kind, clock in clocks().items():
        table, path = TABLE.assign(time_s=clock), tmp_path / kind
        path = path if path.suffix else path.with_suffix(".csv")
        if " " in kind:  # nor does the name say the unit
            table = table.rename(columns={"time_s": "Time"})
        if kind in ("index.parquet", "zone.parquet"):  # the clock is the table's index
            table = table.drop(columns="time_s").set_index(pd.Index(clock, name="elapsed"))
        table.to_parquet(path) if path.suffix == ".parquet" else table.to_csv(path, index=False)
        log = read_log(path, TRAIN)
        damage = analyse_run(log.run, TRAIN).total_damage
        late = np.abs(log.run.time - log.run.time[0] - TIME).max()
        if abs(damage / expected - 1.0) > 2e-3 or late > 2e-3 or len(grouped(log.remarks)) > MOST:
            wrong[kind] = (damage, expected, late, log.remarks)
    assert not wrong
    single = TABLE.assign(time_s=(TABLE["time_s"] + 1.774e9).astype(np.float32))
    single.to_parquet(tmp_path / "single.parquet")
    with pytest.raises(
        StudyError, match="do not tell their period; give period_s in a mapping file"
    ):
        read_log(tmp_path / "single.parquet", TRAIN)


def test_pressure_position_and_a_line_take_part(tmp_path):
    table = TABLE.drop(columns=FORCES)
    way = np.cumsum(table["speed_kmh"] / 3.6 * 0.02)
    pressure = np.maximum(-TABLE["axle1_force_kn"], 0.0) * 0.5
    table = table.assign(km=(1000.0 + way) / 1e3, p1=pressure, p2=pressure)
    names = {
        name: {"is": name.rsplit("_", 1)[0], "unit": "km/h"} for name in table if "speed" in name
    }
    names |= {"time_s": {"is": "time", "unit": "s"}, "km": {"is": "position", "unit": "km"}}
    for car in (1, 2):
        names[f"p{car}"] = {"is": f"car{car}_pressure", "unit": "bar", "newton_per_kpa": 20.0}
    mapping = Mapping.model_validate({"columns": names})
    line = GradientLine(np.array([0.0, 1100.0]), np.array([0.0, 1e-3]))
    log = check_log(table, TRAIN, "log", mapping, line)
    expected = np.minimum(1e3 * TABLE["axle1_force_kn"], 0.0)
    for axle in range(4):
        np.testing.assert_allclose(log.run.applied_force[:, axle], expected, atol=1e-6)
    np.testing.assert_array_equal(log.grade, np.where(log.position < 1100.0, 0.0, 1e-3))


NUMBERS = np.random.default_rng(11).normal(0.0, 3000.0, 400)
WRITINGS = {
    "point": (".", lambda v: f"{v:.3f}"),
    "comma": (",", lambda v: f"{v:.3f}".replace(".", ",")),
    "English groups": (".", lambda v: f"{v:,.2f}"),
    "German groups": (",", lambda v: f"{v:,.2f}".replace(",", "_").replace(".", ",").replace("_", ".")),
    "Swiss groups": (".", lambda v: f"{v:,.2f}".replace(",", "'")),
    "thin blanks": (",", lambda v: f"{v:,.2f}".replace(",", "\u202f").replace(".", ",")),
    "Fortran": (".", lambda v: f"{v:.9E}".replace("E", "D")),
    "groups alone": (".", lambda v: f"{round(v):,}"),
    "points alone": (",", lambda v: f"{round(v):,}".replace(",", ".")),
}  # fmt: skip


def test_every_writing_of_a_number_is_that_number_and_every_other_text_is_none():
    for decimal, write in WRITINGS.values():
        texts = [write(value) for value in NUMBERS]
        assert decimal_of([texts]) == decimal
        found = numbers_of(np.array(texts, dtype=object), decimal)
        assert (found.wrong, sum(found.words.values())) == (None, 0)
        np.testing.assert_allclose(found.values, NUMBERS, atol=0.51)
    # three decimals are no groups
    assert decimal_of([["0,120", "12,345", "-1,000"]]) == ","
    assert decimal_of([["12,345", "13,456"], ["0,5", "1,5"]]) == ","
    for text in ("1:20", "12 5", "1.2.3", "0x1F", "1_000", "12,34,5"):
        with pytest.raises(StudyError, match=r"row 2: .* is not a number"):
            numbers(np.array(["1.0", text, "2.0"], dtype=object), "v", "log")
    for text in ("Bad", "1.#QNAN", "-1.#IND", "?", "#VALUE!", "axle1_speed"):
        values, said = numbers(np.array(["1.0", text, "2.0"], dtype=object), "v", "log")
        np.testing.assert_array_equal(values, [1.0, np.nan, 2.0])
        assert repr(text) in said[0].text


def test_a_number_far_from_all_others_stands_for_none():
    for none in (-9999.0, 9999.0, 6553.5, 1e30):
        speed = np.linspace(100.0, 0.0, 200)
        speed[::17] = none
        values, said = numbers(speed, "v", "log")
        assert np.isnan(values[::17]).all(), none
        assert np.isfinite(np.delete(values, np.s_[::17])).all()
        assert len(said) == 1
    # a wheel that locks from full speed has no such value
    locked = np.where(np.arange(200) > 100, 0.0, np.linspace(100.0, 80.0, 200))
    assert numbers(locked, "v", "log")[1] == []


def test_an_encoding_is_told_by_its_bytes():
    for text, encoding in (
        ("Zeit;v über Grund;Längskraft [kN]", "cp1252"), ("temps écoulé;n° essieu", "latin-1"),
        ("時刻[s],列車速度[km/h],軸1速度", "cp932"), ("時刻,列車速度", "utf-8"), ("ﾊﾟﾙｽ,時刻,速度", "cp932"),
        ("time;µ [-];speed", "cp1252"), ("time;v", "utf-16-le"), ("time;v", "utf-16-be"), ("time;v", "utf-16"),
    ):  # fmt: skip
        written = (text + "\n1;2;3\n" * 20).encode(encoding)
        assert written.decode(encoding_of(written)).lstrip("\ufeff").startswith(text)


def train_of(*axles: int) -> MeasuredTrain:
    """A train of cars with so many axles."""
    count = sum(axles)
    return MeasuredTrain(
        name="cars", car_mass=np.full(len(axles), 40e3), axle_car=np.repeat(np.arange(len(axles)), axles),
        axle_load=np.full(count, 9e4), radius=np.full(count, 0.43), inertia=np.full(count, 80.0),
        driven=np.ones(count, dtype=bool),
    )  # fmt: skip


COUNTED = {
    "through the train": "axle {n} speed [km/h]", "from 0": "nAxle{z} [1/min]", "short, in cars": "W{c}_RS{k}_v_kmh",
    "cars by letters": "Car {l} Axle {k} speed [km/h]", "cars, and through": "Car {c} Axle {n} speed [km/h]",
    "Japanese, in cars": "{c}号車 第{k}軸速度[km/h]", "bogies of a car": "Car {c} Bogie {b} Axle {s} speed [km/h]",
    "bogies of the train": "Drehgestell {t} Radsatz {s} Geschwindigkeit", "alone": "v{n}", "array": "vWheel[{z}]",
    "a field of structs": "log.axle {n}.speed", "of a matrix": "wheel_speed_kmh {n}", "with a unit behind": "v_RS_{n}_rpm",
}  # fmt: skip


def test_axles_are_found_however_they_are_counted_in_any_order():
    for way, pattern in COUNTED.items():
        for axles in (4, 4, 4), (4, 4), (4, 2, 4), (6, 4):
            train, names, t = train_of(*axles), [], 0
            for i, car in enumerate(train.axle_car.tolist()):
                k = i - int((train.axle_car < car).sum())
                t += k % 2 == 0
                told = {"n": i + 1, "z": i, "c": car + 1, "l": "ABC"[car], "k": k + 1, "t": t}
                names.append(pattern.format(**told, b=k // 2 + 1, s=k % 2 + 1))
            shuffled = np.random.default_rng(len(axles)).permutation(names).tolist()
            found = told_by_names(dict.fromkeys(["Zeit", *shuffled], ""), train)
            assert found.pop("Zeit").stem == "time"
            assert [found[name].number for name in names] == list(range(1, sum(axles) + 1)), way
            assert {told.stem for told in found.values()} == {"axleN_speed"}, way


MEANT = {
    "motor 1 speed [rpm]": ("axleN_speed", "gear_ratio"), "TM1 torque [Nm]": ("axleN_torque", "gear_ratio"),
    "Bremszylinderdruck Achse 1 [bar]": ("axleN_pressure", "newton_per_kpa"),
    "Impulse RS 1": ("axleN_pulses", "pulses_per_turn"),
    "Kupplungskraft 1 [kN]": ("couplerK_force", ""), "Druck Wagen 1 [bar]": ("carK_pressure", ""),
    "a_car1": ("carK_acceleration", ""), "Neigung [‰]": ("gradient", ""), "キロ程[km]": ("position", ""),
    "couple essieu n° 1 (N.m)": ("axleN_torque", ""), "T_Achslager_1": None, "current [A]": None, "yaw rate [deg/s]": None,
    "brake notch": None, "line voltage [V]": None, "x [9**9**9]": None,
}  # fmt: skip


def test_a_name_means_one_thing_or_nothing():
    for name, meant in MEANT.items():
        told = told_by_names({name: ""}, train_of(4, 4)).get(name)
        assert (told and (told.stem, told.needs)) == meant, name


def test_a_counter_that_begins_anew_goes_on():
    time = 0.02 * np.arange(2000)
    total = np.floor(np.cumsum(9.0 + 6.0 * np.sin(0.3 * time)))
    for turn, low in ((100, 0), (256, 0), (256, 128), (1000, 0), (4096, 0), (65536, 32768)):
        gained, _ = _gained(time, total % turn - low)
        assert gained.sum() == pytest.approx(total[-1] - total[0], rel=0.01), (turn, low)


def test_every_unit_that_the_library_has_of_a_quantity_is_that_unit():
    library, count = registry(), 0
    for kind, si in SI.items():
        if kind in ("turning", "pulses", "slope"):
            continue
        for unit in map(str, library.get_compatible_units(library.Unit(si).dimensionality)):
            count += 1
            # the library's own units of a quantity, with a prefix and with the worth of a digit
            for text, scale in (
                (unit, 1.0),
                (f"[{unit}]", 1.0),
                (f"kilo{unit}", 1e3),
                (f"0.01 {unit}", 0.01),
            ):
                one = scale * library.Quantity(1.0, unit).to(si).magnitude
                assert factor(text, kind) == pytest.approx(one, rel=1e-12), text
                assert kind in kinds_of(text)
    assert count > 80


LOGGERS = {
    "speed": "km/h kmh KM/H kph Km/h 0.277777777778; mph MPH mile/h 0.44704; kn kt knots 0.514444444444; m/s ms M/S 1",
    "turning": "1/min U/min rpm RPM r/min min-1 min^-1 umin 0.104719755120; Hz 1/s s-1 6.28318530718; rad/s rads 1",
    "force": "N n 1; kN KN kn 1e3; MN 1e6; mN 1e-3; daN dan 10; kgf kp 9.80665; lbf 4.4482216152605",
    "torque": "Nm NM N*m N·m N.m 1; kNm kN.m KNM 1e3; ft*lbf 1.3558179483314",
    "pressure": "bar Bar BAR 1e5; kPa KPA 1e3; MPa 1e6; mbar hPa 1e2; kgf/cm2 kgf/cm² kg/cm2 98066.5; psi PSI 6894.7572932",
    "acceleration": "m/s2 m/s² m/s^2 m/s**2 m·s⁻² ms2 1; km/h/s 0.277777777778; g 9.80665",
    "time": "s S sec 1; ms 1e-3; us µs μs 1e-6; h 3600",
    "slope": "‰ permille mm/m 1e-3; % percent 0.01; m/m - 1", "position": "m M 1; km KM 1e3; ft 0.3048",
    "pulses": "imp counts - 1",
}  # fmt: skip
"""By kind of quantity: units, and what they are worth."""


def test_units_are_read_as_loggers_write_them():
    for kind, written in LOGGERS.items():
        for line in written.split(";"):
            *texts, worth = line.split()
            scale = eval(worth, {"pi": np.pi})
            assert [factor(text, kind) for text in texts] == pytest.approx([scale] * len(texts), rel=1e-9), line  # fmt: skip
    for text, kind in (
        ("kN", "torque"),
        ("bar", "force"),
        ("A", "time"),
        ("9**9**9", "slope"),
        ("km", "speed"),
    ):
        assert factor(text, kind) is None


def test_headings_and_summaries_between_rows_are_left_out(tmp_path):
    lines = TABLE.to_csv(index=False).splitlines()
    lines.insert(300, lines[0])
    lines += [f"{word},{lines[1].partition(',')[2]}" for word in ("Min", "Max", "Mean")]
    (tmp_path / "log.csv").write_text("\n".join(lines))
    log = read_log(tmp_path / "log.csv", TRAIN)
    assert log.rows == len(TABLE)
    assert any("4 rows without a time" in remark.text for remark in log.remarks)


def test_groups_name_their_channels_and_begin_when_they_say(tmp_path):
    tdms = pytest.importorskip("nptdms")
    begin = np.datetime64("2026-05-05T10:00:00", "us")
    with tdms.TdmsWriter(tmp_path / "log.tdms") as writer:
        writer.write_segment(
            [
                tdms.ChannelObject(
                    group, "Speed", np.arange(50.0),
                    {"wf_increment": 0.02, "wf_samples": 1, "wf_start_offset": 0.0, "unit_string": "km/h",
                     "wf_start_time": begin + np.timedelta64(late, "ms")},
                )
                for group, late in (("Axle 2", 500), ("Axle 1", 0))
            ]
        )  # fmt: skip
    channels = read_recording(tmp_path / "log.tdms").channels
    assert sorted(channels) == ["Axle 1 Speed", "Axle 2 Speed"]
    assert channels["Axle 1 Speed"].clock[0] == 0.0
    assert channels["Axle 2 Speed"].clock[0] == pytest.approx(0.5)
