"""Derivatives written out, against differences and against autograd."""

import pytest

torch = pytest.importorskip("torch")

from vpsci_ros.policy.sst_step import StepWeights, recurrence, sst_step  # noqa: E402

ROWS, WIDTH, HEADS, WINDOW = 2, 4, 2, 3


def numbers(*shape):
    """Return normal numbers whose gradient is wanted, float64."""
    return torch.randn(*shape, dtype=torch.float64, requires_grad=True)


def test_gradient_of_a_step_is_that_of_differences():
    torch.manual_seed(0)
    square = WIDTH, WIDTH
    weights = StepWeights(
        numbers(WIDTH), numbers(*square), numbers(3 * WIDTH, WIDTH), numbers(*square), *(numbers(WIDTH) for _ in "123")
    )
    past = [numbers(ROWS, WIDTH) for _ in range(2 * (WINDOW - 1))]

    def step(x, h, gates, *rest):
        return sst_step(StepWeights(*rest[:7]), x, h, gates, list(rest[7:]))

    start = numbers(ROWS, WIDTH), numbers(ROWS, WIDTH), numbers(ROWS, WINDOW, HEADS)
    assert torch.autograd.gradcheck(step, (*start, *weights, *past))


def test_gradient_of_the_recurrence_is_that_of_differences():
    torch.manual_seed(0)
    assert torch.autograd.gradcheck(recurrence, (numbers(ROWS, 5, WIDTH), numbers(WIDTH)))


def test_recurrence_forgets_by_its_decay():
    driven = torch.tensor([[[1.0, 1.0], [0.0, 0.0], [2.0, 0.0]]])
    expected = [[1.0, 1.0], [0.5, 0.25], [2.25, 0.0625]]  # 0.5 * 0.5 + 2; 0.25 * 0.25
    assert recurrence(driven, torch.tensor([0.5, 0.25]))[0].tolist() == expected
