"""The optimiser Adam of torch, without the import of torch's compiler."""

import inspect

import torch
from torch.optim import Optimizer


class Adam(torch.optim.Adam):
    """Adam, bit-identical to torch's, for processes that compile no network.

    torch wraps these methods so that its compiler leaves them out, and imports the compiler at the first call. That
    import takes longer than torch's own.
    """

    add_param_group = inspect.unwrap(Optimizer.add_param_group)
    zero_grad = inspect.unwrap(Optimizer.zero_grad)
    state_dict = inspect.unwrap(Optimizer.state_dict)
    load_state_dict = inspect.unwrap(Optimizer.load_state_dict)
    step = torch.no_grad()(inspect.unwrap(torch.optim.Adam.step))
