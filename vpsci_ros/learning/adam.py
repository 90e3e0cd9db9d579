"""Adam as torch has it, without the compiler that torch imports for it."""

import inspect

import torch
from torch.optim import Optimizer


class Adam(torch.optim.Adam):
    """torch's Adam, bit for bit, for processes that compile no network.

    torch wraps these methods so that its compiler leaves them out, and imports the compiler at the first call. That
    import takes longer than torch's own.
    """

    add_param_group = inspect.unwrap(Optimizer.add_param_group)
    zero_grad = inspect.unwrap(Optimizer.zero_grad)
    state_dict = inspect.unwrap(Optimizer.state_dict)
    load_state_dict = inspect.unwrap(Optimizer.load_state_dict)
    step = torch.no_grad()(inspect.unwrap(torch.optim.Adam.step))
