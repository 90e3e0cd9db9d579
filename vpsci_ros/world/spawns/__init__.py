"""The spawns: where vehicle and pedestrians are as an episode begins, a file and a row of `TABLE` each.

`mixed` has neither: it is the paper's in even episodes of a scenario and that of right turns in odd ones. Its even
episodes have the rules of section 3.2 (`PAPERS_GAIN` and beside it), the odd ones those of the configuration.

In reading order:

* `right_turns`: the spawn `right_turns`: up to a second before a recorded onset, with the recorded motion until then
* `human`: the spawn `human`: both agents begin one to two seconds before the drawn onset of a conflict
* `paper`: the spawn of section 3.2 of the paper
* `approach`: the motion of the rule-based pair with the spawns `right_turns` and `human`, which draw driver and walker
"""

from dataclasses import dataclass

from vpsci_ros.safety.compiled import Kernel
from vpsci_ros.world.compiled import choice, inlined, kernel
from vpsci_ros.world.spawns import human, paper, right_turns

# the rules of section 3.2 that even episodes of a `mixed` world have: the gain of (21)-(24), and in seconds the end of
# an episode and the time without danger to the hand-back ("overridden upon activation"); nothing but (18) steers
PAPERS_GAIN, PAPERS_TIME, PAPERS_RELEASE = 0.5, 10.0, 0.5


@dataclass(frozen=True)
class Spawn:
    """A spawn: kernels of EPISODE records, with their SCENARIO `row` of `Tables`.

    :ivar name: a value of `WorldConfig.spawn`.
    :ivar begin: (episode, row, tables, seed, period): places vehicle and first pedestrian, as the uint64 `seed` draws
        them; returns the time `drives` [s] that the car needs to the crossing. `period` [s] is a tick's.
    :ivar join: (episode, leader, row, tables, seed, drives): places a further pedestrian beside the first, `leader`.
    :ivar put: (episode, row, tables, s): puts a pedestrian at arc length `s` [m] of its route.
    :ivar near_goal: the vehicle's goal is at most `PAPERS_GOAL` beyond the crossing.
    :ivar recorded: the two approach each other as recorded people do, by what these kernels draw (`approach`).
    """

    name: str
    begin: Kernel
    join: Kernel
    put: Kernel
    near_goal: bool = False
    recorded: bool = False


TABLE = (
    Spawn("right_turns", right_turns.begin, right_turns.join, right_turns.put, recorded=True),
    Spawn("human", human.begin, human.join, human.put, recorded=True),
    Spawn("paper", paper.begin, paper.join, paper.put, near_goal=True),
)
MIXED = -1  # no row
SPAWNS = {spawn.name: index for index, spawn in enumerate(TABLE)} | {"mixed": MIXED}
RIGHT_TURNS, PAPER = SPAWNS["right_turns"], SPAWNS["paper"]
_BEGIN = choice({index: spawn.begin for index, spawn in enumerate(TABLE)})
_JOIN = choice({index: spawn.join for index, spawn in enumerate(TABLE)})
_PUT = choice({index: spawn.put for index, spawn in enumerate(TABLE)})
_RECORDED = tuple(spawn.recorded for spawn in TABLE)


@inlined
def spawn_of(which, episode):  # type: ignore[no-untyped-def]
    """Return the index in `TABLE` of the spawn by which this EPISODE record begins, which is not `mixed`."""
    if which != MIXED:
        return which
    return PAPER if episode.episode % 2 == 0 else RIGHT_TURNS


@inlined
def as_recorded(which, episode):  # type: ignore[no-untyped-def]
    """Whether driver and walker of this EPISODE record approach each other as recorded people do."""
    return _RECORDED[spawn_of(which, episode)]


@inlined
def by_papers_rules(settings, episode):  # type: ignore[no-untyped-def]
    """Whether this EPISODE record of a mixed world has the rules of section 3.2."""
    return settings.spawn == MIXED and episode.episode % 2 == 0


@inlined
def gain_of(settings, episode):  # type: ignore[no-untyped-def]
    """Return the share of a policy's or a command's acceleration that the pedestrian executes, (21)-(24)."""
    return PAPERS_GAIN if by_papers_rules(settings, episode) else settings.pedestrian_gain


@inlined
def keeps_lane(settings, episode):  # type: ignore[no-untyped-def]
    """Whether the acceleration that keeps the lane is added to that of a policy's vehicle."""
    return settings.lane_following and not by_papers_rules(settings, episode)


@inlined
def limit_of(settings, episode):  # type: ignore[no-untyped-def]
    """Return the ticks after which this EPISODE record times out."""
    return settings.papers_ticks if by_papers_rules(settings, episode) else settings.episode_ticks


@inlined
def release_of(settings, episode):  # type: ignore[no-untyped-def]
    """Return the ticks without danger after which control is given back."""
    return settings.papers_release_ticks if by_papers_rules(settings, episode) else settings.release_ticks


@kernel
def begin(which, episode, row, tables, seed, period):  # type: ignore[no-untyped-def]
    """Place vehicle and first pedestrian at the spawn; return the car's time to the crossing [s], 0 for `paper`."""
    return _BEGIN(spawn_of(which, episode), episode, row, tables, seed, period)


@kernel
def join(which, episode, leader, row, tables, seed, drives):  # type: ignore[no-untyped-def]
    """Put a further pedestrian where it is at the spawn; the car of `leader` needs `drives` [s] to the crossing."""
    _JOIN(spawn_of(which, episode), episode, leader, row, tables, seed, drives)


@kernel
def put(which, episode, row, tables, s):  # type: ignore[no-untyped-def]
    """Put a pedestrian at arc length `s` [m] of its route."""
    _PUT(spawn_of(which, episode), episode, row, tables, s)
