"""Proves the safety argument of the check ``strict``, lemma by lemma, for a config's settings.

    python -m verification.prove                      # the default settings
    python -m verification.prove --config FILE.toml   # other settings

``drl_av/safety/strict.py`` states the argument. Z3 proves each lemma over exact real numbers, for
every speed and gap. A last step bounds the effect of rounding. The exit status is 1 if a lemma
fails; the argument then does not cover these settings.
"""

import sys
import time
from collections.abc import Iterator
from typing import NamedTuple

from drl_av.config import Config, load_config
from verification.program import Program, run_program

try:
    from verification.proofs import followers, following, lane_changes
    from verification.proofs.argument import Argument, argument
    from verification.proofs.lemma import Lemma, Model, UndecidedError, counterexample
    from verification.proofs.rounding import rounding_m
except ImportError as missing:
    sys.exit(f"prove: {missing}: pip install 'drl-av[verify]'.")

LEMMAS = (*following.LEMMAS, *followers.LEMMAS, *lane_changes.LEMMAS)
WIDTH = max(len(lemma.name) for lemma in LEMMAS)


class Result(NamedTuple):
    """The result of the attempt to prove a lemma."""

    name: str
    says: str
    """The lemma in words."""
    seconds: float
    model: Model | None
    """A counterexample; None if the lemma is proved."""

    def __str__(self) -> str:
        verdict = "proved " if self.model is None else "REFUTED"
        return f"{self.name:{WIDTH}}  {verdict}  {self.seconds:6.2f} s  {self.says}"


def prove(config: Config) -> Iterator[Result]:
    """Check each lemma with Z3, and then the effect of rounding; yield each result.

    Raises:
        ConfigError: the lemmas do not apply to these settings.
        UndecidedError: Z3 neither proves nor refutes a lemma within 120 s for each claim.
    """
    numbers = argument(config)
    for lemma in LEMMAS:
        begun_s = time.monotonic()
        model = refuted(lemma, numbers)
        yield Result(lemma.name, lemma.says, time.monotonic() - begun_s, model)
    yield rounding(config, numbers)


def refuted(lemma: Lemma, numbers: Argument) -> Model | None:
    """Return a counterexample to a lemma, or None if Z3 proves all its claims.

    Raises UndecidedError, which names the lemma, if Z3 refutes no claim but cannot decide one.
    """
    undecided = None
    for claim in lemma.claims(numbers):
        try:
            if (model := counterexample(claim)) is not None:
                return model
        except UndecidedError as error:
            undecided = error
    if undecided is not None:
        raise UndecidedError(f"The lemma {lemma.name} stays open: {undecided}")
    return None


def rounding(config: Config, numbers: Argument) -> Result:
    """Check that ``strict.clearance_m`` exceeds the effect of rounding; return the result."""
    begun_s = time.monotonic()
    off_m = rounding_m(config, numbers)
    says = (
        f"Rounding moves a comparison of the check by less than {float(off_m):.1e} m, which "
        f"strict.clearance_m, {float(numbers.clearance_m):g}, covers."
    )
    covered = off_m < numbers.clearance_m
    model = {"rounding_m": off_m, "clearance_m": numbers.clearance_m}
    return Result("rounding", says, time.monotonic() - begun_s, None if covered else model)


def main() -> int:
    parser = Program(__doc__)
    parser.add_argument("--config", help="a TOML file of settings")
    arguments = parser.parse_args()
    failed = []
    for result in prove(load_config(arguments.config)):
        print(result, flush=True)
        failed += [result] if result.model is not None else []
    for result in failed:
        numbers = [f"{name} {float(value):.6g}" for name, value in (result.model or {}).items()]
        text = f"the lemma {result.name} fails, for example at {', '.join(numbers)}."
        print(f"These settings are not covered: {text}", file=sys.stderr)
    return 1 if failed else 0


if __name__ == "__main__":
    run_program(main)
