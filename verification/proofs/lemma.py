"""Defines lemmas and claims, and proves or refutes a claim with Z3."""

from collections.abc import Callable, Iterator, Sequence
from fractions import Fraction
from typing import Any, NamedTuple

import z3

from drl_av.errors import DrlAvError
from verification.proofs.argument import Argument

Term = Any
"""A real number or a truth value of Z3."""
TIMEOUT_S = 120


class UndecidedError(DrlAvError):
    """Raised if Z3 finds neither a proof nor a counterexample in TIMEOUT_S seconds."""


class Claim(NamedTuple):
    """A statement for Z3 to prove: ``goal`` follows from the facts ``known``."""

    known: list[Term]
    goal: Term
    names: dict[str, Term]
    """The unknown numbers by name; a counterexample gives their values."""


class Problem:
    """Collects the unknown numbers of a claim, and the known facts about them."""

    def __init__(self) -> None:
        self._known: list[Term] = []
        self._names: dict[str, Term] = {}

    def unknown(self, name: str, low: Term = None, high: Term = None) -> Term:
        """Add an unknown real number and return it; the bounds, if given, are inclusive."""
        term = self._names[name] = z3.Real(name)
        self.assume(*([] if low is None else [term >= low]))
        self.assume(*([] if high is None else [term <= high]))
        return term

    def assume(self, *facts: Term) -> None:
        """Add known facts."""
        self._known.extend(facts)

    def largest(self, terms: Sequence[Term]) -> Term:
        """Return a new number that is known to be the largest of ``terms``."""
        term = z3.FreshReal()
        self.assume(*(term >= each for each in terms), z3.Or([term <= each for each in terms]))
        return term

    def smallest(self, terms: Sequence[Term]) -> Term:
        """Return a number that is known to be the smallest of ``terms``."""
        return -self.largest([-each for each in terms])

    def floor(self, number: Term) -> Term:
        """Return a number that is known to be ``number`` rounded down."""
        whole = z3.FreshInt()
        self.assume(whole <= number, number < whole + 1)
        return z3.ToReal(whole)

    def ceil(self, number: Term) -> Term:
        """Return a number that is known to be ``number`` rounded up."""
        return -self.floor(-number)

    def follows(self, *goals: Term) -> Claim:
        """Return the claim that all ``goals`` follow from the facts added so far."""
        return Claim(list(self._known), z3.And(*goals), dict(self._names))


class Lemma(NamedTuple):
    """A lemma of the safety argument of ``strict``: name, statement, and the claims for Z3."""

    name: str
    says: str
    """The statement in one sentence."""
    claims: Callable[[Argument], Iterator[Claim]]
    """Function that returns the claims which together prove the lemma for given numbers."""


Model = dict[str, Fraction]
"""The numbers of a counterexample by name, SI units."""


def counterexample(claim: Claim, *also: Term) -> Model | None:
    """Let Z3 search for numbers with which the known facts and ``also`` hold, but not the goal.

    Returns None if there are no such numbers; the claim is then proved.

    Raises:
        UndecidedError: Z3 finds neither a proof nor a counterexample in TIMEOUT_S seconds.
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
