#!/usr/bin/env python
"""Learn `ma_sst_ddpg`: stages 1 and 2, right turns of part train.

    tools/make_weights.py [-o out/weights] [--seed 4] [--install]

A run that is stopped goes on with the same command. `--seed` is that of stage 1, and of learner, world and policies in
stage 2; the default is that of the shipped weights. `--install` puts the last weights of stage 2 into the package. Some
ten minutes of one core.
"""

import argparse
import shutil
import subprocess
import sys
from pathlib import Path

from vpsci_ros.errors import VpsciError

ROOT = Path(__file__).parents[1]
NODES = ("learner", "world_simulator", "vehicle_policy", "pedestrian_policy")  # with a seed in stage 2
SHIPPED = ROOT / "vpsci_ros" / "models" / "ma_sst_ddpg.safetensors"


def main() -> int:
    """Make the weights; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("out", "weights"))
    parser.add_argument("--seed", type=int, default=4)
    parser.add_argument("--install", action="store_true", help="copy the weights into the package")
    given = parser.parse_args()
    pretrained, refined = (given.output / name for name in ("pretrain", "refine"))
    second = [f"{node}.seed={given.seed}" for node in NODES]
    try:
        learn("pretrain", "stage1_pretrain", pretrained, [f"learner.seed={given.seed}"])
        start = f"learner.weights={pretrained / 'pretrained.safetensors'}"
        learn("refine", "stage2_online", refined, [start, *second])
        if given.install:
            print(f"installed: {shutil.copy(refined / 'refined.safetensors', SHIPPED)}")
    except VpsciError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    return 0


def learn(command: str, params: str, folder: Path, settings: list[str]) -> None:
    """Run `vpsci pretrain` or `vpsci refine` into `folder`.

    :raises VpsciError: it failed; it has said why.
    """
    words = [sys.executable, "-m", "vpsci_ros.cli", command, "--params", str(ROOT / "params" / f"{params}.yaml")]
    words += ["-o", str(folder), *(word for setting in settings for word in ("--set", setting))]
    status = subprocess.run(words, check=False).returncode
    if status:
        raise VpsciError(f"vpsci {command} ended with {status}")


if __name__ == "__main__":
    sys.exit(main())
