"""How many near misses of a place make a bank that beats the other place's.

    vpsci import vci_dut vci_citr --format vci-dut --format vci-citr -o campus.parquet
    python benchmarks/own_near_misses.py campus.parquet [--counts 20 60 150] [--draws 3]

Two places, each once with near misses of its own and the other one as the shipped source: right turns and the campus.
A draw takes clips of a place in a random order until there are N near misses with 3 s recorded after their onset. Its
bank is made by `vpsci people` with and without `--with` the other place, and is scored on the clips of the place that
the shipped bank has left out. Printed: the energy score as a share of constant velocity's, the mean over the draws,
with 95% intervals by the clips that are scored, and the least and the greatest draw; `paired` divides by the shipped
source alone. Two CPU minutes.
"""

import argparse
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vpsci_ros.data.near_misses import read_near_misses, write_near_misses
from vpsci_ros.evaluation.onsets import find_onsets
from vpsci_ros.evaluation.roll_out_scores import energy_score
from vpsci_ros.evaluation.simulators import fading, policy, residual_sampler, tracked
from vpsci_ros.evaluation.statistics import cluster_counts, interval
from vpsci_ros.policy.bank import Bank
from vpsci_ros.policy.make_bank import bank_of_tables
from vpsci_ros.policy.policy_file import load_policy

ROLL_OUTS = 8  # an onset; the energy score does not depend on how many, only its noise does

Floats = NDArray[np.float64]


def held_out(table: pl.DataFrame, clips: Sequence[str]) -> tuple[pl.DataFrame, pl.DataFrame]:
    """Return the near misses of other clips and those of `clips`, "source/clip"."""
    inside = pl.concat_str("source", "clip", separator="/").is_in(list(clips))
    return table.filter(~inside), table.filter(inside)


def drawn(table: pl.DataFrame, count: int, seed: int) -> pl.DataFrame:
    """Return `count` near misses with 3 s after their onset: of clips in a random order, all of each but the last."""
    onsets = find_onsets(table)
    names = np.random.default_rng(seed).permutation(np.unique(onsets.clip.astype(str)))
    place = {name: number for number, name in enumerate(names)}
    order = np.argsort([place[name] for name in onsets.clip], kind="stable")
    if count > len(order):
        raise SystemExit(f"expected at least {count} near misses with 3 s after their onset, got {len(order)}")
    return table.filter(pl.col("interaction").is_in(onsets.number[order[:count]]))


class Place:
    """One place: its own near misses, and the onsets that are scored.

    :ivar own: near misses of the clips that the shipped bank has not left out.
    :ivar onsets: those of the clips it has left out.
    """

    def __init__(self, name: str, table: pl.DataFrame, left_out: Sequence[str]) -> None:
        self.name = name
        self.own, scored = held_out(table, left_out)
        self.onsets = find_onsets(scored)
        self.middle = tracked(self.onsets)
        self._control = energy_score(self.middle, self.onsets.recorded)
        self._draws = cluster_counts(self.onsets.units.labels, 0)

    def by_bank(self, bank: Bank, seed: int, people: str = "") -> Floats:
        """Return the energy score of each onset, float64[n] [m], where this bank acts."""
        return energy_score(policy(bank, seed, ROLL_OUTS, people)(self.onsets), self.onsets.recorded)

    def by_sampler(self, table: pl.DataFrame) -> Floats:
        """Return the same of the control that borrows residuals of the near misses `table`."""
        library = find_onsets(table)
        made = residual_sampler(self.onsets, library, fading(self.onsets), fading(library))
        return energy_score(made, self.onsets.recorded)

    def row(self, what: str, scores: Sequence[Floats], beside: Floats | None = None) -> None:
        """Print the mean over draws, each float64[n], of constant velocity's, and of `beside` where that is given."""
        mean, texts = np.mean(scores, axis=0), []
        for other in (self._control, beside):
            if other is not None:
                low, high = interval((self._draws @ mean) / (self._draws @ other))
                texts.append(f"{mean.mean() / other.mean():.3f} [{low:.3f}, {high:.3f}]")
        each = [float(one.mean() / self._control.mean()) for one in scores]
        spread = f" (draws {min(each):.3f} to {max(each):.3f})" if len(each) > 1 else ""
        print(f"  {what:<34}{texts[0]}{spread}" + (f"; paired {texts[1]}" if texts[1:] else ""), flush=True)


def measure(here: Place, there: Place, counts: Sequence[int], draws: int) -> None:
    """Print the table of one place, `here`, with the other one as the shipped source."""
    print(f"{here.name}: {len(here.onsets)} onsets of {here.onsets.units.text}, shipped: {there.name}")
    with tempfile.TemporaryDirectory() as name:
        mine, theirs = Path(name) / "mine.parquet", Path(name) / "theirs.parquet"
        write_near_misses(there.own, theirs)
        shipped = here.by_bank(bank_of_tables([theirs]), 0)
        here.row("shipped alone", [shipped])
        here.row("  sampler of the same", [here.by_sampler(there.own)])
        for count in [*counts, 0]:
            rows: dict[str, list[Floats]] = {}
            for seed in range(draws if count else 1):
                own = drawn(here.own, count, seed) if count else here.own
                write_near_misses(own, mine)
                rows.setdefault("alone", []).append(here.by_bank(bank_of_tables([mine]), seed))
                both = bank_of_tables([mine], others=[theirs])
                rows.setdefault("with the other place", []).append(here.by_bank(both, seed))
                rows.setdefault("  sampler of the same own", []).append(here.by_sampler(own))
            number = count or len(find_onsets(here.own))
            for what, scores in rows.items():
                here.row(f"{number} {what}" if what[0] != " " else what, scores, shipped)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("campus", type=Path, help="near misses of VCI-DUT and VCI-CITR")
    parser.add_argument("--counts", type=int, nargs="+", default=[20, 60, 150], help="near misses of one's own")
    parser.add_argument("--draws", type=int, default=3)
    arguments = parser.parse_args()
    shipped = load_policy("people")
    left_out = shipped.facts["data"]["held_out_clips"]
    turns = Place("right turns", read_near_misses("right_turns"), left_out)
    campus = Place("campus", read_near_misses(arguments.campus), left_out)
    for here, there in ((campus, turns), (turns, campus)):
        measure(here, there, arguments.counts, arguments.draws)


if __name__ == "__main__":
    main()
