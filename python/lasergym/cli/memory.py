"""How much memory many environments take, measured in a process of their own."""

import json
import subprocess
import sys
from dataclasses import dataclass

__all__ = ["MemoryUse", "memory_of"]

_PROGRAM = """
import json, sys
import gymnasium as gym
import lasergym
def peak_mb():
    with open("/proc/self/status") as status:
        kib = next(line.split()[1] for line in status if line.startswith("VmHWM:"))
    return int(kib) * 1024 / 1e6
before_mb = peak_mb()
envs = gym.make_vec("lasergym/RandomShape-v0", num_envs=int(sys.argv[1]), copy=False)
envs.reset(seed=0)
envs.action_space.seed(0)
for _ in range(3):
    envs.step(envs.action_space.sample())
print(json.dumps([before_mb, peak_mb()]))
"""


@dataclass(frozen=True)
class MemoryUse:
    """Memory of a process that resets and steps environments.

    Attributes:
        num_envs: Number of environments (RandomShape, ``copy=False``).
        peak_mb: Largest resident memory of the whole process, MB.
        imports_mb: The same before the environments were made, MB.
    """

    num_envs: int
    peak_mb: float
    imports_mb: float


def memory_of(num_envs: int) -> MemoryUse | None:
    """Measures a reset and three steps of ``num_envs`` environments; None except on Linux."""
    finished = subprocess.run(
        [sys.executable, "-c", _PROGRAM, str(num_envs)], capture_output=True, text=True, check=False
    )
    if finished.returncode != 0:
        return None
    imports_mb, peak_mb = json.loads(finished.stdout)
    return MemoryUse(num_envs, peak_mb, imports_mb)
