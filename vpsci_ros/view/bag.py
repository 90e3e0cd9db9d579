"""Episodes of a recorded graph, or of a simulation while it runs: gathered from its ticks."""

from collections.abc import Collection, Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.bags.episodes import bag_episodes
from vpsci_ros.bags.reader import Bag
from vpsci_ros.bags.run_record import bag_run
from vpsci_ros.bags.ticks import read_bag
from vpsci_ros.errors import InvalidInput
from vpsci_ros.view.episodes import Episode, Floats, Size, Source, judged, most_critical, named, spread
from vpsci_ros.view.grounds import scenario_names
from vpsci_ros.world import Scenario
from vpsci_ros.world.scenario import own_scenarios
from vpsci_ros.world.sharing import episode_rows
from vpsci_ros.world.state import ENDED, OUTCOME_NAMES

Key = tuple[int, int]
_STATE = ["vehicle_x", "vehicle_y", "vehicle_heading", "vehicle_speed", "vehicle_curvature",
          "pedestrian_x", "pedestrian_y", "pedestrian_vx", "pedestrian_vy"]  # fmt: skip


def bag_source(path: Path, limit: int, wanted: Sequence[str] = (), *, recover: bool = False) -> Source:
    """Return episodes that ended in a bag, named SCENARIO:NUMBER.

    :param recover: take what is whole of a bag that was not closed or is damaged.
    :raises InvalidInput: no bag, a damaged one, none of a vehicle and a pedestrian, or none of a wanted name.
    """
    found = {episode.name: episode.key for episode in bag_episodes(Bag(path, recover=recover), recover=recover)}
    if not found:
        raise InvalidInput(f"{path}: not one episode ended while it was recorded, so there is nothing to show")
    names = list(found)
    rows = named(names, wanted, str(path)) if wanted else spread(len(names), limit)
    period = next(read_bag(path, recover=recover)).period
    ticks = ((tick.state, tick.curvttc) for tick in read_bag(path, recover=recover))
    own = own_scenarios(bag_run(Bag(path, recover=recover)).own_scenarios, str(path))
    episodes = list(episodes_of(ticks, period, {found[names[row]] for row in rows}, own))
    return Source(path.resolve().stem, f"{path.resolve().stem} (bag)", period, episodes, len(names), own)


def episodes_of(
    ticks: Iterable[tuple[NDArray[np.void], Floats]],
    period: float,
    wanted: Collection[Key] | None = None,
    own: Sequence[Scenario] = (),
) -> Iterator[Episode]:
    """Yield episodes as they end, those of these keys (None: all); no tick is taken after the last wanted one.

    :param ticks: state EPISODE[B] and CurvTTC float64[B] [s] of each tick.
    :param period: time from one tick to the next [s].
    :param own: scenarios of one's own among them.
    """
    places = scenario_names(own)
    open_now: dict[Key, list[list[list[float]]]] = {}
    left = None if wanted is None else set(wanted)
    for state, curvttc in ticks:
        for rows in episode_rows(state):
            record = state[rows[0]]
            key = int(record["scenario"]), int(record["episode"])
            if left is not None and key not in left:
                continue
            pairs = [[*map(float, state[_STATE][i]), float(curvttc[i]), float(state["controlled"][i])] for i in rows]
            open_now.setdefault(key, []).append(pairs)
            if record["status"] == ENDED:
                place = places.get(key[0], f"scenario {key[0]}")
                outcome = OUTCOME_NAMES[record["outcome"]]
                yield _episode(key, place, np.array(open_now.pop(key)).transpose(1, 0, 2), outcome, period)
                if left is not None:
                    left.remove(key)
        if left is not None and not left:
            return


def _episode(key: Key, place: str, pairs: Floats, outcome: str, period: float) -> Episode:
    values, others = most_critical(pairs)
    yielded, marks = judged(values, period, Size())
    name = f"{key[0]}:{key[1]}"
    return Episode(name, place, key[0], outcome, yielded, values, Size(), marks, others)
