"""Types of command-line arguments: what is no such number is bad usage."""

import argparse
import math
from collections.abc import Callable


def positive(text: str) -> float:
    number = float(text)
    if not 0 < number < math.inf:
        raise argparse.ArgumentTypeError(f"{text} is not a positive number")
    return number


positive.__name__ = "number"


def whole(low: int) -> Callable[[str], int]:
    def parse(text: str) -> int:
        number = int(text)
        if number < low:
            raise argparse.ArgumentTypeError(f"{number} is less than {low}")
        return number

    parse.__name__ = "whole number"
    return parse
