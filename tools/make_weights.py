#!/usr/bin/env python
"""Learn weights by stages 1 and 2 from `right_turns/train`: `closed_loop`, or `ma_sst_ddpg` by the paper's method.

    tools/make_weights.py [-o out/weights] [--seed 4] [--install]                    # closed_loop
    tools/make_weights.py --paper --hidden 256 --layers 2 [-o out/paper] [--install]   # ma_sst_ddpg
    tools/make_weights.py --paper [-o out/paper] [--seed 4 5 6 7 8]                  # its seeds at width 64

A run that is stopped goes on with the same command. A seed is that of stage 1, and of learner, world and policies in
stage 2; equal seeds give equal files. `--install` puts the last weights of stage 2 into the package. `--paper` trains
by `params/paper_stage1.yaml` and `paper_stage2.yaml`, each seed in a folder. Some eight minutes of one core; by the
paper's method five at width 64, and 36 at its own two layers of 256.
"""

import argparse
import shutil
import subprocess
import sys
from pathlib import Path

from vpsci_ros.errors import VpsciError

ROOT = Path(__file__).parents[1]
NODES = ("learner", "world_simulator", "vehicle_policy", "pedestrian_policy")  # with a seed in stage 2
MODELS = ROOT / "vpsci_ros" / "models"
SHIPPED = {False: ("closed_loop", 64, 1), True: ("ma_sst_ddpg", 256, 2)}  # by --paper: name, hidden, layers


def main() -> int:
    """Make the weights; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path)
    parser.add_argument("--seed", type=int, nargs="+", default=[4])
    parser.add_argument("--paper", action="store_true", help="by the paper's method, in its scenes")
    parser.add_argument("--hidden", type=int, default=64, help="width of the networks")
    parser.add_argument("--layers", type=int, default=1, help="of the networks")
    parser.add_argument("--install", action="store_true", help="copy the weights into the package")
    given = parser.parse_args()
    if given.install and len(given.seed) > 1:
        parser.error("--install: expected one seed")
    name, *size = SHIPPED[given.paper]
    if given.install and [given.hidden, given.layers] != size:
        wanted, got = f"--hidden {size[0]} --layers {size[1]}", f"{given.hidden} and {given.layers}"
        parser.error(f"--install: {name} has {wanted}; got {got}")
    output = given.output or Path("out", "paper" if given.paper else "weights")
    files = ("paper_stage1", "paper_stage2") if given.paper else ("stage1_pretrain", "stage2_online")
    shape = [f"learner.hidden={given.hidden}", f"learner.layers={given.layers}"]
    try:
        for seed in given.seed:
            folder = output / f"seed_{seed}" if given.paper or len(given.seed) > 1 else output
            pretrained, refined = (folder / stage for stage in ("pretrain", "refine"))
            learn("pretrain", files[0], pretrained, [f"learner.seed={seed}", *shape])
            start = f"learner.weights={pretrained / 'pretrained.safetensors'}"
            learn("refine", files[1], refined, [start, *(f"{node}.seed={seed}" for node in NODES)])
        if given.install:
            print(f"installed: {shutil.copy(refined / 'refined.safetensors', MODELS / f'{name}.safetensors')}")
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
