"""The environment of Gymnasium: its interface, its copies, and that its episodes are the runs of this project."""

import copy
import pickle

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from alloc.evaluation.metrics import evaluate
from alloc.run.simulation import simulate
from alloc.schema.errors import InputError
from studies import StudyError
from studies.files.scenario_files import load_scenario
from studies.gymnasium_environment import PRICE, ReadhesionEnvironment, play_event


def short(name):
    """The first seconds of a scenario, in which wheels slip."""
    return load_scenario(name).changed(duration_s=8.0)


def play(env, agent, info=None, steps=10_000):
    """Observations and rewards until the event ends, or of so many steps; the agent gets what is said beside them."""
    told, end = [], False
    while not end and len(told) < steps:
        seen, reward, _, end, info = env.step(np.clip(agent(info), 0.0, 1.0))
        told.append((*seen, reward))
    return np.array(told)


@pytest.mark.parametrize("given", [{}, {"units": [1], "others": "none"}, {"scenario": "wet-stop"}])
def test_gymnasium_accepts_it(given):
    check_env(gymnasium.make("readhesion/train-v0", **given).unwrapped)  # its pictures too
    for units in (np.array([0]), range(1), (0,), 0):
        assert ReadhesionEnvironment(units=units).units == [0]


@pytest.mark.parametrize("name", ["wet-start", "wet-stop"])
def test_an_agent_that_does_as_a_controller_makes_its_run_and_is_paid_for_it(name):
    env = ReadhesionEnvironment(short(name), others="perturb-observe")
    _, info = env.reset(options={"event_seed": 2})
    total = play(env, lambda info: info["others"], info)[:, -1].sum()
    assert play_event(env, 2) == pytest.approx(total, rel=1e-12)
    run = env.simulation.recorded()
    own = simulate(env.scenario.event(2), "cooperative", "perturb-observe")
    for variable in ("speed", "rim_speed", "torque_command", "rail_force"):
        np.testing.assert_allclose(run[variable], own[variable], rtol=1e-9, atol=1e-9)
    plan = np.abs(run["driver_command"].values) * run.attrs["train_mass"]
    force = np.sign(run["driver_command"].values) * run["rail_force"].values.sum(axis=1)
    share = np.clip(force, 0.0, plan).sum() / plan.sum()
    assert total == pytest.approx(
        share - PRICE * evaluate(run)["damage"], abs=1e-4
    )  # the record lacks the last period


@pytest.mark.parametrize("again", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_a_copy_goes_on_as_the_original_does(again):
    env = ReadhesionEnvironment(short("wet-start"), units=[2])
    assert again(env).reset(seed=4)[1]["event_seed"] == env.reset(seed=4)[1]["event_seed"]
    play(env, lambda _: [0.9], steps=300)
    other = again(env)
    np.testing.assert_array_equal(play(other, lambda _: [0.8]), play(env, lambda _: [0.8]))
    assert other.reset()[1]["event_seed"] == env.reset()[1]["event_seed"]


def test_a_picture_shows_the_instant_and_a_copy_the_same():
    env = ReadhesionEnvironment(short("wet-start"), units=[1], render_mode="rgb_array")
    env.reset(seed=4)
    first = env.render()
    play(env, lambda _: [1.0], steps=300)
    assert first.shape == (240, 640, 3)
    assert (env.render() != first).any()
    np.testing.assert_array_equal(copy.deepcopy(env).render(), env.render())


def test_what_cannot_be_is_said():
    wrong = [{"units": one} for one in ([8], [-1], [0.0], [1, 1], [], True, "0")]
    for given in (*wrong, {"others": "mcp"}, {"rule": "oracle"}, {"scenario": 5}):
        with pytest.raises(InputError, match=str(*given.values()).strip("[]") or "distinct"):
            ReadhesionEnvironment(**given)
    env = ReadhesionEnvironment(short("wet-start"), units=[0])
    for actions in ([0.5], [np.nan], [1.1], [0.0, 0.0]):
        with pytest.raises(StudyError, match=r"call reset first|give 1 numbers from 0 to 1"):
            env.step(np.array(actions))
        env.reset()
