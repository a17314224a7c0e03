"""PPO on the vector environment through Gymnasium alone, without an adapter.

python train_ppo.py

After `ppo_continuous_action.py` of CleanRL (S. Huang et al., JMLR 23, 2022). Needs
`pip install torch`. `cc-mujoco play wrist --controller` plays the policy.
"""

import gymnasium
import matplotlib.pyplot as plt
import numpy as np
import torch
from gymnasium.wrappers.vector import NormalizeObservation, RecordEpisodeStatistics
from torch.distributions import Normal
from torch.nn import Linear, Parameter, Sequential, Tanh

from cc_mujoco.control import Network, write_policy

ENVS, STEPS, BATCH, BATCHES, RATE = 64, 64, 1024, 20, 1e-3
GAMMA, LAMBDA, CLIP = 0.95, 0.9, 0.2
WRIST = {"hold": 5, "history": 4, "randomise": {"friction": (0.05, 0.2)}}


def train(updates=30, path="policy.safetensors"):
    """Train and write a policy; return steps and mean returns of the episodes."""
    torch.manual_seed(0)
    torch.set_num_threads(1)
    name = "cc_mujoco:cc_mujoco/WristHandle-v1"
    wrist = gymnasium.make_vec(name, ENVS, duration=1.0, **WRIST)
    envs = NormalizeObservation(RecordEpisodeStatistics(wrist))
    size, steps, returns = wrist.single_observation_space.shape[0], [], []
    actor, critic = (
        Sequential(Linear(size, 64), Tanh(), Linear(64, 64), Tanh(), Linear(64, 1))
        for _ in range(2)
    )
    spread = Parameter(torch.tensor([-1.0]))
    learnt = [*actor.parameters(), *critic.parameters(), spread]
    optimiser = torch.optim.Adam(learnt, RATE)
    now, over = torch.tensor(envs.reset(seed=0)[0]), torch.zeros(ENVS)
    for update in range(updates):
        rows = []
        for step in range(STEPS):
            with torch.no_grad():
                law = Normal(actor(now), spread.exp())
                action = law.sample()
            after, *rest, info = envs.step(action.numpy())
            reward, failed, ended = (torch.tensor(x).float() for x in rest)
            rows.append((now, action, law.log_prob(action), reward, failed, over))
            now, over = torch.tensor(after), torch.maximum(failed, ended)
            if "episode" in info:
                steps.append(ENVS * (STEPS * update + step))
                returns.append(info["episode"]["r"][info["_episode"]].mean())
        *data, gained, failed, fresh = map(torch.stack, zip(*rows, strict=True))
        with torch.no_grad():
            values = critic(torch.cat((data[0], now[None])))[..., 0]
        # A step after the last of an episode begins the next: its action is ignored.
        going = 1.0 - torch.cat((fresh[1:], over[None]))
        errors = gained + GAMMA * values[1:] * (1.0 - failed) - values[:-1]
        better, onward = torch.zeros_like(errors), torch.zeros(ENVS)
        for t in reversed(range(STEPS)):
            better[t] = onward = errors[t] + GAMMA * LAMBDA * going[t] * onward
        data += better + values[:-1], (better - better.mean()) / better.std()
        data = [x[fresh == 0.0] for x in data]
        for own in torch.randint(len(data[0]), (BATCHES, BATCH)):
            seen, action, chance, aim, better = (x[own] for x in data)
            law = Normal(actor(seen), spread.exp())
            ratio = (law.log_prob(action) - chance).exp()[:, 0]
            near = ratio.clamp(1.0 - CLIP, 1.0 + CLIP)
            gain = torch.min(ratio * better, near * better).mean()
            loss = (critic(seen)[:, 0] - aim).square().mean() - gain
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
    normal = envs.obs_rms.mean, np.sqrt(envs.obs_rms.var + 1e-8)
    write_policy(path, Network.of_layers(actor, *normal), wrist.exo.observed)
    return steps, returns


if __name__ == "__main__":
    steps, returns = train()
    print(*(f"{mean:.3f}" for mean in returns))
    plt.plot(steps, returns)
    plt.savefig("train_ppo.png")
