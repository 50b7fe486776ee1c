"""Lines and trains from railtoolkit files: what they say arrives, what they leave open is assumed as documented."""

import json

import numpy as np
import pytest
import yaml

from alloc.plant.laws import GRAVITY
from studies.files.study_error import FileWarning, StudyError
from studies.lines.named_files import with_real_input
from studies.railtoolkit.reading import read_path, read_rolling_stock, read_train
from studies.scenario.scenario import load_scenario

PATH = {
    "schema": "https://railtoolkit.org/schema/running-path.json",
    "schema_version": "2022.05",
    "paths": [
        {
            "name": "up and down",
            "id": "p1",
            "characteristic_sections": [
                [0.0, 80, 0.0], [400.0, 80, 12.5], [900.0, 60, -4.0], [1500.0, 60, 0.0],
            ],
        }
    ],
}  # fmt: skip
RAILCAR = {
    "name": "railcar",
    "id": "R1",
    "vehicle_type": "multiple unit",
    "picture": "a key that this project has no use for",
    "length": 41.0,
    "mass": 66.0,
    "mass_traction": 44.0,
    "rotation_mass": 1.1,
    "base_resistance": 3.0,
    "rolling_resistance": 1.5,
    "air_resistance": 4.0,
    "tractive_effort": [[0.0, 90e3], [10.0, 80e3], [50.0, 30e3]],
}
COACH = {"name": "coach", "id": "C1", "vehicle_type": "passenger", "length": 26.4, "mass": 50.0,
         "base_resistance": 1.9, "rolling_resistance": 0.25, "air_resistance": 2.2}  # fmt: skip


def stock(*vehicles, formation=None) -> dict:
    content = {
        "schema": "https://railtoolkit.org/schema/rolling-stock.json",
        "schema_version": "2022.05",
        "vehicles": list(vehicles),
    }
    if formation is not None:
        content["trains"] = [{"name": "a train", "id": "T", "formation": formation}]
    return content


@pytest.fixture
def write(tmp_path):
    def to_file(content, name="file.yaml") -> str:
        path = tmp_path / name
        path.write_text(content if isinstance(content, str) else yaml.safe_dump(content))
        return str(path)

    return to_file


def test_a_gradient_holds_from_its_section_to_the_next(write):
    path = read_path(write(PATH))
    assert [(s.start, s.end) for s in path.sections] == [(0, 400), (400, 900), (900, 1500)]
    assert [s.grade for s in path.sections] == pytest.approx([0.0, 0.0125, -0.004])
    assert (path.steepest().start, path.steepest().end) == (400.0, 900.0)
    line = path.line()
    assert line.stations == (0.0, 400.0, 900.0)


def test_masses_add_up_and_sit_where_the_file_says(write):
    train = read_train(write(stock(RAILCAR, COACH, formation=["R1", "C1", "R1"])))
    assert train.name == "a train"
    assert [car.mass for car in train.cars] == pytest.approx([66e3, 50e3, 66e3])
    railcar = train.cars[0]
    driven = np.array(railcar.driven)
    assert driven.sum() == 4
    assert np.array(railcar.axle_load_share)[driven].sum() * railcar.mass == pytest.approx(44e3)


def test_rotating_mass_is_what_the_factor_says(write):
    train = read_train(write(stock(RAILCAR)))
    assert train.rotating_mass == pytest.approx(0.1 * 66e3)


def test_the_motors_deliver_the_effort_of_the_file(write):
    car = read_train(write(stock(RAILCAR))).cars[0]
    table = np.array(car.motors.drive.table)
    effort = table * car.motors.gear_ratio / car.wheel_radius * sum(car.driven)
    assert effort[[0, 5, 10, 30, 50]] == pytest.approx([90e3, 85e3, 80e3, 55e3, 30e3])
    assert effort[-1] == pytest.approx(30e3)  # beyond the table its last effort holds


def test_resistance_of_a_driving_vehicle_follows_its_formula(write):
    a, b, c = read_train(write(stock(RAILCAR))).resistance
    weight = 66.0 * GRAVITY  # per mille of it in N
    for speed in (0.0, 20.0):
        mean = 3.0 * 44 / 66 + 1.5 * 22 / 66
        expected = weight * (mean + 4.0 * ((speed + 15 / 3.6) / (100 / 3.6)) ** 2)
        assert a + b * speed + c * speed**2 == pytest.approx(expected)


def test_a_file_without_trains_is_one_vehicle(write):
    assert len(read_train(write(stock(RAILCAR, COACH))).cars) == 1


def changed(content, **values):
    return content | values


WAGON = {"name": "wagon", "id": "W", "vehicle_type": "freight", "length": 15.0, "mass": 22.0,
         "load_limit": 60.0, "base_resistance": 1.5, "rolling_resistance": 9.0, "air_resistance": 4.0}  # fmt: skip
NAMED_PATH = {
    "schema": "https://railtoolkit.org/schema/running-path.json",
    "schema_version": "2024.07",
    "paths": [
        {
            "id": "p1",
            "description": "up and down",
            "points_of_interest": [{"position": 600.0, "label": "Gleis 1", "measure": "middle"}],
            "characteristic_sections": [
                {"position": 0.0, "speed": 80, "resistance": 0.0},
                {"position": 400.0, "resistance": 12.5},
                {"position": 900.0, "speed": 60, "resistance": -4.0},
                {"position": 1500.0, "speed": 60},
            ],
        }
    ],
}


def test_both_schemas_of_lines_say_the_same(write):
    old, new = read_path(write(PATH, "old.yaml")), read_path(write(NAMED_PATH, "new.yaml"))
    assert old.sections == new.sections
    assert old.name == new.name
    (point,) = new.points
    assert point.front_position(100.0) == 650.0


def test_what_a_section_does_not_say_holds_on(write):
    rows = [
        {"position": 0.0, "resistance": 3.0},
        {"position": 50.0, "speed": 80},
        {"position": 99.0, "speed": 5},
    ]
    path = read_path(
        write(changed(NAMED_PATH, paths=[{"id": "x", "characteristic_sections": rows}]))
    )
    assert [section.grade for section in path.sections] == pytest.approx([3e-3, 3e-3])
    assert [section.speed_limit for section in path.sections] == pytest.approx([np.inf, 80 / 3.6])
    assert path.name == "x"


@pytest.mark.parametrize("version", ["2022.05", "2024.07"])
def test_rolling_stock_of_both_versions_is_the_same_train(write, version):
    train = read_train(write(changed(stock(RAILCAR), schema_version=version)))
    assert train.mass == 66e3


@pytest.mark.parametrize(
    ("content", "reader", "words"),
    [
        (
            stock(changed(RAILCAR, air_resistence=4.0)), read_train,
            "key 'vehicles[1].air_resistence' is unknown and passed over; did you mean 'air_resistance'?",
        ),
        (
            stock(*(changed(RAILCAR, id=f"R{k}", masss=1.0) for k in range(3))), read_train,
            "key 'vehicles[1].masss' and 2 more like it is unknown and passed over; did you mean 'mass'?",
        ),
        (changed(PATH, path=1), read_path, "key 'path' is unknown and passed over; did you mean 'paths'?"),
        (
            changed(PATH, paths=[*PATH["paths"], PATH["paths"][0] | {"id": "Rückweg"}]), read_path,
            "holds 2 paths; the first, 'p1', is taken, not 'Rückweg'",
        ),
        (
            changed(stock(RAILCAR, formation=["R1"]), trains=[
                {"name": "n", "id": str(k), "formation": ["R1"]} for k in range(8)
            ]),
            read_train, "holds 8 trains; the first, '0', is taken, not '1', '2', '3', '4', '5' ...",
        ),
        (
            stock(RAILCAR, WAGON, formation=["R1", "W"]), read_rolling_stock,
            "no vehicle of the train has the key 'a_braking'; taken as -0.225 m/s2, the format's usual one for a "
            "train with freight wagons",
        ),
        (
            stock(RAILCAR, COACH, formation=["R1", "C1"]), read_rolling_stock,
            "taken as -0.375 m/s2, the format's usual one for a train without freight wagons",
        ),
        (
            stock(changed(RAILCAR, a_braking=-0.5, speed_limit=70.0)), read_rolling_stock,
            "tractive_effort of vehicle 'R1' ends at 50 km/h; its last effort holds up to the train's 70 km/h",
        ),
    ],
)  # fmt: skip
def test_what_a_file_says_in_vain_or_leaves_open_is_told_in_one_line(write, content, reader, words):
    with pytest.warns(FileWarning) as told:
        reader(write(content))
    (message,) = [str(one.message) for one in told]
    assert words in message
    assert "\n" not in message


def test_names_may_have_umlauts(write):
    line = changed(PATH, paths=[PATH["paths"][0] | {"name": "Zürich–Göschenen", "id": "Größe"}])
    assert read_path(write(line)).name == "Zürich–Göschenen"
    train = stock(changed(RAILCAR, id="Ü", name="Müngersdorf"), formation=["Ü", "Ü"])
    assert read_train(write(train)).mass == 132e3


def test_loads_weigh_on_what_is_drawn_by_the_train_s_mean_factor(write):
    given = [changed(RAILCAR, a_braking=-0.5), changed(WAGON, rotation_mass=1.03)]
    path = write(stock(*given, formation=["R1", "W", "W"]))
    empty, full = (read_rolling_stock(path, share).train for share in (0.0, 1.0))
    per_mille = GRAVITY * 120.0  # of the load
    assert full.resistance[0] - empty.resistance[0] == pytest.approx(1.5 * per_mille)
    assert full.resistance[1] == empty.resistance[1]
    added = full.resistance[2] - empty.resistance[2]
    assert added == pytest.approx(4.0 * per_mille / (100 / 3.6) ** 2)
    factor = (1.1 * 66 + 2 * 1.03 * 22) / (66 + 44)
    for train in (empty, full):
        assert train.rotating_mass == pytest.approx((factor - 1.0) * train.mass)


def test_factors_of_rotating_masses_are_those_of_the_format_where_none_is_given(write):
    bare = {key: value for key, value in RAILCAR.items() if key != "rotation_mass"}
    train = read_train(write(stock(bare, COACH, formation=["R1", "C1"])))
    assert train.rotating_mass == pytest.approx(0.09 * 66e3 + 0.06 * 50e3)


def test_a_train_without_traction_is_refused(write):
    with pytest.raises(StudyError, match="no vehicle of the train has traction"):
        read_train(write(stock(COACH)))


def test_a_line_of_many_sections_is_read(write):
    rows = [[-9e5 + 25.0 * k, 20 + 10 * (k % 9), (k % 7) - 3.0] for k in range(8001)]
    content = changed(PATH, paths=[PATH["paths"][0] | {"characteristic_sections": rows}])
    path = read_path(write(json.dumps(content)))  # YAML as well
    assert len(path.sections) == 8000
    assert path.span == (-9e5, -7e5)


@pytest.mark.parametrize(
    ("sections", "words"),
    [
        ([[0, 80, 0]], "characteristic_sections"),
        ([[0, 80, 0], [0, 80, 1]], "characteristic_sections[2]: start 0 m must lie beyond"),
        ([[0, 0, 0], [9, 80, 1]], "characteristic_sections[1]: speed limit 0 km/h must exceed 0"),
        ([[0, 80, float("inf")], [9, 80, 1]], "finite"),
    ],
)
def test_a_faulty_line_file_is_refused(write, sections, words):
    content = changed(PATH, paths=[{"name": "n", "id": "i", "characteristic_sections": sections}])
    with pytest.raises(StudyError) as error:
        read_path(write(content))
    assert words in str(error.value)


def test_the_event_moves_to_the_steepest_climb(write):
    line, train = write(PATH, "hills.yaml"), write(stock(RAILCAR), "car.yaml")
    scenario = with_real_input(load_scenario("gradient-start"), line, train)
    event = scenario.event()
    assert scenario.name == "gradient-start+hills+car"
    assert "400 m to 900 m, 12.5 per mille" in scenario.title
    assert event.initial_position == 400.0
    assert event.model.train.mass == pytest.approx(66e3)
    assert event.model.line.grades == pytest.approx((0.0, 0.0125, -0.004))


def test_the_hash_follows_the_content_of_the_files(write):
    scenario = load_scenario("gradient-start")
    one = with_real_input(scenario, write(PATH, "a.yaml"), None)
    same = with_real_input(scenario, write(PATH, "b.yaml"), None)
    assert one.hash() == same.hash()
    write(changed(PATH, note="another"), "b.yaml")
    assert one.hash() != same.hash()


def test_a_train_of_ones_own_does_not_take_on_the_scenarios_loads(write):
    with pytest.raises(StudyError, match="choose another --scenario"):
        with_real_input(load_scenario("uneven-load"), None, write(stock(RAILCAR)))


def test_a_scenario_file_can_name_line_and_train_beside_it(write, write_scenario):
    write(PATH, "hills.yaml"), write(stock(RAILCAR), "car.yaml")
    text = write_scenario.short + '\n[line]\nfile = "hills.yaml"\n'
    event = load_scenario(write_scenario(text, ("commuter-8car", "car.yaml"))).event()
    assert event.model.train.mass == pytest.approx(66e3)
    assert event.model.line.stations == (0.0, 400.0, 900.0)
