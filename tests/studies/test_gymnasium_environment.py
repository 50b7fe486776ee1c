"""The environment of Gymnasium: its interface, and that its episodes are the runs of this project."""

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from alloc.metrics import evaluate
from alloc.metrics.use import settled
from alloc.simulation import simulate
from studies.files.study_error import StudyError
from studies.peers.gymnasium_environment import FRICTION_WEIGHT, ReadhesionEnvironment
from studies.scenario.scenario import load_scenario


def played(env, agent, **reset):
    """Observations, return, and what was said beside each step of an episode; `agent` gets observation and info."""
    seen, info = env.reset(**reset)
    all_seen, told, total, end = [seen], [], 0.0, False
    while not end:
        seen, reward, ended, end, info = env.step(np.clip(agent(seen, info), 0.0, 1.0))
        assert not ended
        total += reward
        all_seen.append(seen)
        told.append(info)
    return np.array(all_seen), total, told


def shortened(name):
    """The first seconds of a shipped scenario, in which wheels slip."""
    return load_scenario(name).changed(duration_s=10.0)


def reserve(_, info):
    return info["reserve"]


@pytest.mark.parametrize(
    "given", [{}, {"units": [1], "others": "perturb-observe"}, {"scenario": "wet-stop"}], ids=str
)
def test_gymnasium_accepts_it(given):
    check_env(gymnasium.make("readhesion/train-v0", **given).unwrapped)


@pytest.mark.parametrize("scenario", ["wet-start", "wet-stop"])
def test_an_agent_that_does_as_a_controller_makes_that_controllers_run(scenario):
    """Perturb-observe as agent; from what it got follow the metrics of the run, and the return from these."""
    env = ReadhesionEnvironment(shortened(scenario), others="perturb-observe")
    seen, total, told = played(env, reserve, options={"event_seed": 2})
    run, own = env.recorded(), simulate(env.scenario.event(2), "greedy", "perturb-observe")
    for name in ("speed", "rim_speed", "torque_command", "rail_force"):
        np.testing.assert_allclose(run[name], own[name], rtol=1e-9, atol=1e-9)
    speed = seen[:-1, env.names.index("unit 0: speed")]
    np.testing.assert_array_equal(speed, run["reference_speed"], "a reading, not the truth")
    metrics, counted = evaluate(run), settled(run)
    effort, bound, work = (
        np.array([one[name] for one in told]) for name in ("effort", "bound", "friction_work")
    )
    assert effort[counted].sum() / bound[counted].sum() == pytest.approx(metrics["bound_use"])
    assert work[:-1].sum() == pytest.approx(metrics["damage"])
    asked = np.abs(run["driver_command"].values).sum() * run.attrs["train_mass"]
    assert total == pytest.approx(effort.sum() / asked - FRICTION_WEIGHT * work.sum())
    assert run.attrs["controller_failures"] == 0


def test_baselines_are_ordered():
    """No readhesion control wears the wheels, torque at random delivers little; a search is better than both."""
    env = ReadhesionEnvironment(shortened("wet-start"), units=[0], others="perturb-observe")
    generator = np.random.default_rng(3)
    agents = {
        "search": reserve,
        "all": lambda *_: np.ones(1),
        "random": lambda *_: generator.random(1),
    }
    returns = {
        name: played(env, agent, options={"event_seed": 1})[1] for name, agent in agents.items()
    }
    assert returns["search"] > max(returns["all"], returns["random"]) + 0.05


def test_a_seed_makes_an_event_and_an_agent_moves_its_own_units_alone(short):
    env = ReadhesionEnvironment(short, units=[2], others="none")
    halves = lambda *_: np.full(1, 0.5)  # noqa: E731
    first, again, other = (played(env, halves, seed=seed)[0] for seed in (5, 5, 6))
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)
    run = env.recorded()
    share = run["torque_factor"].values[20:]
    assert (share[:, 2] == 0.5).all()
    assert (np.delete(share, 2, axis=1) == 1.0).all()


def test_what_cannot_be_is_said(short):
    for given, word in (
        ({"units": [8]}, "units = (8,)"),
        ({"units": []}, "units = ()"),
        ({"others": "mpc"}, "others = 'mpc'"),
        ({"rule": "oracle"}, "rule 'oracle'"),
    ):
        with pytest.raises(StudyError) as error:
            ReadhesionEnvironment(short, **given)
        assert word in str(error.value)
    env = ReadhesionEnvironment(short, units=[0])
    with pytest.raises(StudyError, match="call reset first"):
        env.step(np.zeros(1))
    env.reset()
    for action in (np.array([np.nan]), np.array([1.1]), np.zeros(2)):
        with pytest.raises(StudyError, match="1 numbers from 0 to 1"):
            env.step(action)
    with pytest.raises(StudyError, match="has not ended"):
        env.recorded()
