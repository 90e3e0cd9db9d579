"""A run goes on with its own work only, and says in one sentence why something is not its own."""

import pytest

from vpsci_ros.errors import InvalidInput
from vpsci_ros.runs.identity import require_same

MINE = {"seed": 3, "learner": {"rates": (0.1, 0.2), "stage": "refine"}}


def test_what_json_cannot_tell_apart_is_the_same_run() -> None:
    require_same("out", {"seed": 3, "learner": {"rates": [0.1, 0.2], "stage": "refine"}, "unit": 4}, MINE)


@pytest.mark.parametrize(
    ("found", "said"),
    [
        ({"seed": 4}, "seed = 4, and this one has 3"),
        ({"learner": {"rates": [0.1, 0.2], "stage": "x"}}, r"learner\.stage = 'x', and this one has 'refine'"),
        ({"learner": MINE["learner"] | {"rates": [0.1, 0.2], "old": 1}}, r"learner\.old = 1, and this one has None"),
        ({"learner": "a" * 1000}, r"learner = 'a{199}\.\.\., and this one"),
        ({"learner": "5e" * 32}, r"learner = SHA-256 5e5e5e5e\.\.\., and this one"),
    ],
)
def test_the_first_difference_is_named_with_both_values(found, said) -> None:
    message = rf"^out: holds a dataset with {said}.*; choose another output folder, or delete it to start again$"
    with pytest.raises(InvalidInput, match=message):
        require_same("out", MINE | found, MINE, "holds a dataset")
