#!/usr/bin/env python
"""Make the shipped stochastic weights: stage 1 from recorded near misses, and stage 2 after it.

    tools/make_weights.py [--data ../shared/data] [-o out/weights] [--install]
    tools/make_weights.py --ma-sst-ddpg [-o out/ma_sst_ddpg] [--install]

Learns from the right turns that the package ships and, where DATA holds vci_dut/ and vci_citr/, from the campus too;
without them the weights know right turns alone, and what is printed says so. Clips on which choices are made are held
out (`held_out_clips` in params/stage1_pretrain.yaml). A run that is stopped goes on with the same command.
`--install` puts both files beside the package's others.

With `--ma-sst-ddpg` the paper's own algorithm makes `ma_sst_ddpg`, from the right turns of part train: 25 minutes of
one core. Deviations of (14)-(15) are at least 0.9 m/s, for the rewards of Table 3 to come out (docs/paper.md).
"""

import argparse
import shutil
import subprocess
import sys
from pathlib import Path

from vpsci_ros.errors import VpsciError

ROOT = Path(__file__).parents[1]
MODELS = ROOT / "vpsci_ros" / "models"
CAMPUS = {"vci_dut": "vci-dut", "vci_citr": "vci-citr"}  # folder -> format
OWN = [("pretrain", "stage1_pretrain", "pretrained", []), ("refine", "stage2_online", "refined", [])]
PAPER = [
    ("pretrain", "paper_stage1", "pretrained", ["learner.rewards.least_speed_deviation=0.9"]),
    ("refine", "paper_stage2", "refined", []),
]


def main() -> int:
    """Make the weights; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, default=ROOT / ".." / "shared" / "data", help="folder of recordings")
    parser.add_argument("-o", "--output", type=Path, help="default: out/weights, or out/ma_sst_ddpg")
    parser.add_argument("--ma-sst-ddpg", action="store_true", help="make these weights, by the paper's algorithm")
    parser.add_argument("--install", action="store_true", help="copy the weights into the package")
    given = parser.parse_args()
    output = given.output or Path("out", "ma_sst_ddpg" if given.ma_sst_ddpg else "weights")
    output.mkdir(parents=True, exist_ok=True)
    try:
        near_misses = ["right_turns/train"] if given.ma_sst_ddpg else ["right_turns", *campus(given.data, output)]
        print(f"learning from {' and '.join(near_misses)}", flush=True)
        made = {}
        for command, params, name, settings in PAPER if given.ma_sst_ddpg else OWN:
            start = [f"learner.weights={made['pretrained']}"] if made else []
            made[name] = output / command / f"{name}.safetensors"
            learn(command, params, output / command, near_misses, settings + start)
        if given.ma_sst_ddpg:
            made = {"ma_sst_ddpg": made["refined"]}
        if given.install:
            for name, weights in made.items():
                print(f"installed: {shutil.copy(weights, MODELS / f'{name}.safetensors')}")
    except VpsciError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    return 0


def campus(data: Path, folder: Path) -> list[str]:
    """Import the campus recordings in `data`; return the table's path, or nothing where there are none."""
    missing = [name for name in CAMPUS if not (data / name).is_dir()]
    if missing:
        print(f"{data}: no {' and no '.join(missing)}; learning from right turns alone")
        return []
    table = folder / "campus.parquet"
    if not table.exists():
        formats = [word for form in CAMPUS.values() for word in ("--format", form)]
        vpsci("import", *(str(data / name) for name in CAMPUS), *formats, "-o", str(table))
    return [str(table)]


def learn(command: str, params: str, folder: Path, near_misses: list[str], settings: list[str]) -> None:
    """Run `vpsci pretrain` or `vpsci refine` into `folder`."""
    tables = [word for table in near_misses for word in ("--near-misses", table)]
    chosen = [word for setting in settings for word in ("--set", setting)]
    vpsci(command, "--params", str(ROOT / "params" / f"{params}.yaml"), "-o", str(folder), *tables, *chosen)


def vpsci(*words: str) -> None:
    """Run a command of the package.

    :raises VpsciError: it failed; it has said why.
    """
    command = [sys.executable, "-m", "vpsci_ros.cli", *words]
    status = subprocess.run(command, check=False).returncode
    if status:
        raise VpsciError(f"vpsci {words[0]} ended with {status}")


if __name__ == "__main__":
    sys.exit(main())
