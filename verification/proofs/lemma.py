"""What a lemma is, and how Z3 proves or refutes it."""

from collections.abc import Callable, Iterator, Sequence
from fractions import Fraction
from typing import Any, NamedTuple

import z3

from drl_av.errors import DrlAvError
from verification.proofs.argument import Argument

Term = Any
"""A number or a truth of Z3."""
TIMEOUT_S = 120


class UndecidedError(DrlAvError):
    """Z3 found neither a proof nor a counterexample in time."""


class Claim(NamedTuple):
    """One of the statements that a lemma consists of: what is known, and what follows."""

    known: list[Term]
    goal: Term
    names: dict[str, Term]
    """What a counterexample gives the values of."""


class Problem:
    """Unknown numbers, and what is known of them."""

    def __init__(self) -> None:
        self._known: list[Term] = []
        self._names: dict[str, Term] = {}

    def unknown(self, name: str, low: Term = None, high: Term = None) -> Term:
        """A real number within bounds, inclusive."""
        term = self._names[name] = z3.Real(name)
        self.assume(*([] if low is None else [term >= low]))
        self.assume(*([] if high is None else [term <= high]))
        return term

    def assume(self, *facts: Term) -> None:
        """Know more."""
        self._known.extend(facts)

    def largest(self, terms: Sequence[Term]) -> Term:
        """The largest of some numbers."""
        term = z3.FreshReal()
        self.assume(*(term >= each for each in terms), z3.Or([term <= each for each in terms]))
        return term

    def smallest(self, terms: Sequence[Term]) -> Term:
        """The smallest of some numbers."""
        return -self.largest([-each for each in terms])

    def floor(self, number: Term) -> Term:
        """The largest whole number up to a number."""
        whole = z3.FreshInt()
        self.assume(whole <= number, number < whole + 1)
        return z3.ToReal(whole)

    def ceil(self, number: Term) -> Term:
        """The smallest whole number from a number on."""
        return -self.floor(-number)

    def follows(self, *goals: Term) -> Claim:
        """The claim that all of these follow from what is known so far."""
        return Claim(list(self._known), z3.And(*goals), dict(self._names))


class Lemma(NamedTuple):
    """A part of the argument."""

    name: str
    says: str
    """In one sentence."""
    claims: Callable[[Argument], Iterator[Claim]]


Model = dict[str, Fraction]
"""The numbers of a counterexample by name, SI units."""


def counterexample(claim: Claim, *also: Term) -> Model | None:
    """Numbers for which what is known holds and the goal does not; None without any.

    ``also`` narrows those looked for.

    Raises:
        UndecidedError: Z3 found neither a proof nor a counterexample in time.
    """
    solver = z3.Solver()
    solver.set("timeout", 1000 * TIMEOUT_S)
    solver.add(*claim.known, *also, z3.Not(claim.goal))
    answer = solver.check()
    if answer == z3.unsat:
        return None
    if answer == z3.unknown:
        raise UndecidedError(
            f"Z3 neither proves nor refutes a claim in {TIMEOUT_S} s: take a longer "
            "simulation.step_length_s, which makes fewer cases."
        )
    model = solver.model()
    return {
        name: Fraction(str(model.eval(term, model_completion=True)))
        for name, term in claim.names.items()
    }
