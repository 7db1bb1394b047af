"""A loss that torch compiles: the first minibatches take minutes, the others less time.

loss=clip_ppo_compiled                          # on the command line
"""

from collections.abc import Callable
from typing import Any

import torch


def compiled(*networks: Any, loss: Callable[..., Any], **options: Any) -> Any:
    """Make a loss and let torch compile it.

    Args:
        networks: that it is a loss of.
        loss: makes it.
        options: further ones of the loss.
    """
    return torch.compile(loss(*networks, **options))
