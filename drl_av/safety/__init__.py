"""The safety checks; ``registry`` lists them by name."""

from drl_av.safety.registry import CHECKS, ActionMask, action_mask, mask_of, named_check

__all__ = ["CHECKS", "ActionMask", "action_mask", "mask_of", "named_check"]
