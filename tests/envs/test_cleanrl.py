"""CleanRL's scripts with one argument changed, and policies of PyTorch networks.

`scripts/test_peers cleanrl` has CleanRL 1.2. Its wrappers are Gymnasium's of before
1.0, where `TransformObservation` did without the space of the observations.
"""

from __future__ import annotations

import importlib.util
import runpy
import sys
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

import cc_mujoco  # noqa: F401, registers the environments
from cc_mujoco.control import Network, controller, read_policy
from cc_mujoco.errors import CableError

torch = pytest.importorskip("torch")
if importlib.util.find_spec("cleanrl") is None:
    pytest.skip("CleanRL is not installed", allow_module_level=True)

from cc_mujoco.envs import save_policy  # noqa: E402

torch.set_num_threads(1)
WRIST = "cc_mujoco/WristHandle-v1"
CLIPS = "np.clip(obs, -10, 10)"


def script(name: str) -> Path:
    """Return a file of CleanRL."""
    spec = importlib.util.find_spec("cleanrl")
    assert spec is not None and spec.submodule_search_locations is not None
    return Path(next(iter(spec.submodule_search_locations)), f"{name}.py")


def trained(folder: Path, monkeypatch: pytest.MonkeyPatch, envs: int) -> dict[str, Any]:
    """Run CleanRL's PPO; return its variables at the end."""
    text = script("ppo_continuous_action").read_text("utf-8")
    assert text.count(f"{CLIPS})") == 1
    path = folder / "ppo.py"
    path.write_text(text.replace(f"{CLIPS})", f"{CLIPS}, None)"), "utf-8")
    monkeypatch.chdir(folder)
    counts = {"num-envs": envs, "num-steps": 64, "total-timesteps": 256 * envs}
    words = [f"--{name}={value}" for name, value in counts.items()]
    monkeypatch.setattr(sys, "argv", [str(path), f"--env-id={WRIST}", *words])
    return runpy.run_path(str(path), run_name="__main__")


@pytest.mark.parametrize("count", [1, 3])
def test_its_ppo_trains_and_its_policy_acts_as_its_agent(
    count: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = trained(tmp_path, monkeypatch, count)
    agent, envs = run["agent"], run["envs"]
    assert run["global_step"] == 256 * count
    assert all(torch.isfinite(p).all() for p in agent.parameters())
    path = tmp_path / "policy.safetensors"
    save_policy(agent, path, envs)
    network, observed = read_policy(path)
    env = gymnasium.make(WRIST).unwrapped
    assert observed == env.exo.observed  # type: ignore[attr-defined]
    moments = [one.get_wrapper_attr("obs_rms") for one in envs.envs]
    counts = np.array([each.count for each in moments])
    seen = np.random.default_rng(0).normal(0.0, 2.0, (50, network.mean.size))
    if count == 1:
        normal = (seen - moments[0].mean) / np.sqrt(moments[0].var + 1e-8)
    else:  # moments of all observations
        first = np.average([m.mean for m in moments], axis=0, weights=counts)
        squares = [m.var + m.mean**2 for m in moments]
        second = np.average(squares, axis=0, weights=counts)
        normal = (seen - first) / np.sqrt(second - first**2 + 1e-8)
    with torch.no_grad():
        given = agent.double().actor_mean(torch.tensor(np.clip(normal, -10, 10)))
    assert (np.abs(normal) > 10.0).any()
    expected = np.clip(given.numpy(), -1.0, 1.0)
    assert network(seen) == pytest.approx(expected, abs=1e-6)
    controller(str(path), env.drive)  # type: ignore[attr-defined]


@pytest.mark.parametrize("name", ["sac", "td3", "ddpg"])
def test_actors_of_its_other_scripts_are_saved(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "gym", gymnasium)  # its name in SAC and TD3
    loaded = runpy.run_path(str(script(f"{name}_continuous_action")))
    envs = gymnasium.make_vec(WRIST, 1, vectorization_mode="sync")
    actor = loaded["Actor"](envs)
    path = tmp_path / "policy.safetensors"
    save_policy(actor, path, envs)
    network, _ = read_policy(path)
    seen = np.random.default_rng(0).normal(0.0, 2.0, (50, network.mean.size))
    shown = torch.tensor(seen, dtype=torch.float32)
    with torch.no_grad():
        # The last of three is the action at the mean.
        acts = actor.get_action(shown)[2] if name == "sac" else actor(shown)
    assert network(seen) == pytest.approx(acts.numpy(), abs=1e-6)
    with torch.no_grad():
        actor.action_scale *= 2.0
    with pytest.raises(CableError, match="this one acts otherwise"):
        save_policy(actor, path, envs)


def wrapped(*wrappers: Any, envs: Any = None) -> Any:
    """Return an environment in wrappers."""
    env = gymnasium.make(WRIST) if envs is None else envs
    for wrapper in wrappers:
        env = wrapper(env)
    return env


def clipped(far: float) -> Any:
    """Return a wrapper that clips observations."""
    return lambda env: gymnasium.wrappers.TransformObservation(
        env, lambda seen: np.clip(seen, -far, far), None
    )


def test_a_sequential_and_numpy_arrays_are_saved(tmp_path: Path) -> None:
    path = tmp_path / "policy.safetensors"
    env = wrapped(gymnasium.wrappers.NormalizeObservation, clipped(3.0), clipped(2.0))
    env.reset(seed=0)
    for _ in range(20):
        env.step(env.action_space.sample())
    layers = torch.nn.Linear(6, 5), torch.nn.ELU(), torch.nn.Linear(5, 1, bias=False)
    net = torch.nn.Sequential(*layers, torch.nn.Tanh()).double()
    save_policy(net, path, env)
    network, _ = read_policy(path)
    seen = np.random.default_rng(0).normal(size=(20, 6))
    moments = env.get_wrapper_attr("obs_rms")
    normal = np.clip((seen - moments.mean) / np.sqrt(moments.var + 1e-8), -2, 2)
    with torch.no_grad():
        expected = net(torch.tensor(normal)).numpy()
    assert network(seen) == pytest.approx(expected, abs=1e-6)
    weights = tuple(one.weight.detach().numpy() for one in layers[::2])
    biases = layers[0].bias.detach().numpy(), np.zeros(1)
    still = np.zeros(6), np.ones(6)
    save_policy(Network(weights, biases, "elu", True, *still), path, env)
    assert np.array_equal(read_policy(path)[0](seen), network(seen))
    with pytest.raises(CableError, match="two normalisations"):
        save_policy(read_policy(path)[0], path, env)


@pytest.mark.parametrize(
    ("model", "env", "words"),
    [
        (3, None, "takes a model of Stable-Baselines3.* not a int"),
        (torch.nn.Linear(6, 1), None, r"needs the environment that the Linear was"),
        (torch.nn.Linear(6, 1), wrapped(), "Sequential of Linear.*not Linear"),
        (torch.nn.Sequential(), wrapped(), "one kind of activation.*not nothing"),
        (
            torch.nn.Sequential(torch.nn.Linear(6, 2), torch.nn.Linear(2, 1)),
            wrapped(),
            "one kind of activation .* not Linear, Linear",
        ),
        (
            torch.nn.Sequential(
                torch.nn.Linear(6, 2), torch.nn.ELU(0.5), torch.nn.Linear(2, 1)
            ),
            wrapped(),
            "must have alpha = 1",
        ),
        (
            torch.nn.Sequential(torch.nn.Linear(5, 1)),
            wrapped(),
            "does not follow 6 numbers",
        ),
        (torch.nn.Sequential(torch.nn.Linear(6, 1)), 3, "trained on cc_mujoco"),
        (
            torch.nn.Sequential(torch.nn.Linear(6, 1)),
            wrapped(clipped(2.0), gymnasium.wrappers.NormalizeObservation),
            "cannot save through NormalizeObservation",
        ),
        (
            torch.nn.Sequential(torch.nn.Linear(6, 1)),
            wrapped(
                lambda env: gymnasium.wrappers.TransformObservation(
                    env, lambda seen: np.clip(2.0 * seen, -1.0, 1.0), None
                )
            ),
            "cannot save through TransformObservation",
        ),
    ],
)
def test_what_cannot_be_saved_is_one_sentence(
    model: Any, env: Any, words: str, tmp_path: Path
) -> None:
    with pytest.raises(CableError, match=words) as raised:
        save_policy(model, tmp_path / "policy.safetensors", env)
    assert str(raised.value).endswith(".")
    assert not list(tmp_path.iterdir())


def test_processes_cannot_be_looked_into(tmp_path: Path) -> None:
    envs = gymnasium.make_vec(WRIST, 2, vectorization_mode="async")
    net = torch.nn.Sequential(torch.nn.Linear(6, 1))
    with pytest.raises(CableError, match="processes of AsyncVectorEnv"):
        save_policy(net, tmp_path / "policy.safetensors", envs)
    envs.close()
