"""Configuration of a run: the sections of a parameter file, and the parameters that several nodes share."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

from vpsci_ros.errors import InvalidInput
from vpsci_ros.parameters import parameter, pick

T = TypeVar("T")


@dataclass(frozen=True)
class PeerConfig:
    """The nodes that a node waits for before it publishes; every node has this parameter."""

    peers: list[str] = parameter([], "names of the nodes to wait for; empty: only those whose messages this node needs")


@dataclass(frozen=True)
class PatienceConfig:
    """How long a run may take without progress."""

    progress_timeout: float = parameter(
        60.0,
        "wall time without progress after which the run fails",
        unit="s",
        low=1.0,
        high=86400.0,
    )


@dataclass(frozen=True)
class RunConfig:
    """The episodes that a run simulates, and how many in parallel."""

    seed: int = parameter(
        1,
        "seed of spawns, numbers and kinds of pedestrians; policies and learner have a `seed` of their own",
        low=0,
        high=2**63 - 1,
    )
    scenarios: list[int] = parameter(
        [1, 2, 3, 4, 5, 6, 7, 8],
        "scenarios to run: 1 to 8 (Table 6), 101 to 104 (docs/world.md), and those of scenario_files",
        low=1,
        high=255,
    )
    scenario_files: list[str] = parameter([], "YAML files of your own scenarios (docs/extending.md)")
    episodes: int = parameter(8, "episodes to simulate in each scenario", low=1, high=4_000_000_000)
    first_episode: int = parameter(0, "number of the first episode of each scenario", low=0, high=4_000_000_000)
    only: list[int] = parameter(
        [],
        "simulate only these pairs: [1, 17, 8, 40] are episode 17 of scenario 1 and 40 of scenario 8",
        low=0,
        high=2**32 - 1,
    )
    batch: int = parameter(16, "episodes simulated in parallel", low=1, high=65536)

    def __post_init__(self) -> None:
        if not self.scenarios or len(set(self.scenarios)) < len(self.scenarios):
            raise InvalidInput(f"scenarios must name at least one scenario, each once, got {self.scenarios}")
        if self.first_episode + self.episodes > 2**32:
            raise InvalidInput(
                f"first_episode + episodes = {self.first_episode + self.episodes} exceeds 2^32, the largest number"
            )
        self._require_pairs()

    def _require_pairs(self) -> None:
        if len(self.only) % 2:
            raise InvalidInput(f"only must hold a scenario and a number for each episode, got {len(self.only)} values")
        last: dict[int, int] = {}
        for scenario, episode in zip(self.only[::2], self.only[1::2], strict=True):
            if scenario not in self.scenarios:
                raise InvalidInput(f"only names scenario {scenario}, but scenarios are {self.scenarios}")
            if episode <= last.get(scenario, -1):
                raise InvalidInput(
                    f"only must name each episode once, those of a scenario by rising number; got episode {episode} of "
                    f"scenario {scenario} after {last[scenario]}"
                )
            last[scenario] = episode

    def queue(self) -> Iterator[tuple[int, int]]:
        """Yield (scenario, episode): the pairs of `only`, or else each episode number in all scenarios in turn."""
        if self.only:
            yield from zip(self.only[::2], self.only[1::2], strict=True)
            return
        for episode in range(self.first_episode, self.first_episode + self.episodes):
            for scenario in self.scenarios:
                yield scenario, episode

    @property
    def total(self) -> int:
        """The number of episodes of `queue`."""
        return len(self.only) // 2 or len(self.scenarios) * self.episodes


@dataclass(frozen=True)
class Sections:
    """The values set by a parameter file or a caller; every other parameter has its default.

    :ivar values: section -> name of a parameter, with dots for those of groups -> value.
    """

    values: Mapping[str, Mapping[str, Any]]

    def get(self, kind: type[T], section: str) -> T:
        """Return an instance of the configuration class `kind` with the values of a section.

        :raises InvalidInput: a value of another type or out of range, or values that contradict each other.
        """
        return pick(kind, self.values.get(section, {}), section)

    def changed(self, section: str, values: Mapping[str, Any]) -> "Sections":
        """Return the sections with these values set in one section."""
        return Sections({**self.values, section: {**self.values.get(section, {}), **values}})
