"""Converts the text of command line arguments; a wrong value is bad usage (exit status 2)."""

import argparse
from collections.abc import Callable


def rate(text: str) -> float:
    number = float(text)
    if not 0.01 <= number <= 1000:
        raise argparse.ArgumentTypeError(f"{text} is not from 0.01 to 1000")
    return number


rate.__name__ = "number"


def int_at_least(low: int) -> Callable[[str], int]:
    def parse(text: str) -> int:
        number = int(text)
        if number < low:
            raise argparse.ArgumentTypeError(f"{number} is less than {low}")
        return number

    parse.__name__ = "whole number"
    return parse
