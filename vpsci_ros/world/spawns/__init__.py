"""The spawns: where vehicle and pedestrians are as an episode begins, a file for each name in `SPAWNS`.

`mixed` has no file: it is the paper's in even episodes of a scenario and that of right turns in odd ones. Its even
episodes have the rules of section 3.2 (`config.PAPERS_GAIN` and beside it), the odd ones those of the configuration.

A spawn has three functions of EPISODE records. `begin` draws the vehicle and the first pedestrian and returns the time
[s] that the car needs to the crossing; `join` draws a further pedestrian, by that time; `put` puts a pedestrian at an
arc length of its route [m]. The functions here call those of the spawn with index `which`.

In reading order:

* `right_turns`: the spawn `right_turns`: up to a second before a recorded onset, with the recorded motion until then
* `human`: the spawn `human`: both agents begin one to two seconds before the drawn onset of a conflict
* `paper`: the spawn of section 3.2 of the paper
* `approach`: the motion of the rule-based pair with the spawns `right_turns` and `human`, which draw driver and walker
"""

from vpsci_ros.world.compiled import inlined, kernel
from vpsci_ros.world.spawns import human, paper, right_turns
from vpsci_ros.world.world_config import PAPERS_GAIN, SPAWNS

RIGHT_TURNS, HUMAN, PAPER, MIXED = (SPAWNS.index(name) for name in ("right_turns", "human", "paper", "mixed"))


@inlined
def spawn_of(which, episode):  # type: ignore[no-untyped-def]
    """Return the index in `SPAWNS` of the spawn by which this EPISODE record begins, which is not `mixed`."""
    if which != MIXED:
        return which
    return PAPER if episode.episode % 2 == 0 else RIGHT_TURNS


@inlined
def as_recorded(which, episode):  # type: ignore[no-untyped-def]
    """Whether driver and walker of this EPISODE record approach each other as recorded people do."""
    return spawn_of(which, episode) != PAPER


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
    which = spawn_of(which, episode)
    if which == RIGHT_TURNS:
        return right_turns.begin(episode, row, tables, seed, period)
    if which == HUMAN:
        return human.begin(episode, row, tables, seed, period)
    return paper.begin(episode, row, tables, seed, period)


@kernel
def join(which, episode, leader, row, tables, seed, drives):  # type: ignore[no-untyped-def]
    """Put a further pedestrian where it is at the spawn; the car of `leader` needs `drives` [s] to the crossing."""
    which = spawn_of(which, episode)
    if which == RIGHT_TURNS:
        right_turns.join(episode, leader, row, tables, seed, drives)
    elif which == HUMAN:
        human.join(episode, leader, row, tables, seed, drives)
    else:
        paper.join(episode, leader, row, tables, seed, drives)


@kernel
def put(which, episode, row, tables, s):  # type: ignore[no-untyped-def]
    """Put a pedestrian at arc length `s` [m] of its route."""
    which = spawn_of(which, episode)
    if which == RIGHT_TURNS:
        right_turns.put(episode, row, tables, s)
    elif which == HUMAN:
        human.put(episode, row, tables, s)
    else:
        paper.put(episode, row, tables, s)
