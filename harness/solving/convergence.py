"""How a method's iteration ended."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Convergence:
    """How an iteration ended: the number of iterations, the largest residual, the tolerance (None: it has none)."""

    iterations: int
    residual: float
    tolerance: float | None

    @property
    def met(self) -> bool:
        """Whether the residual is below the tolerance."""
        return self.tolerance is not None and self.residual < self.tolerance

    def __str__(self) -> str:
        text = f"{self.iterations} iterations, residual {self.residual:.2g}"
        if self.tolerance is None:
            return text
        return f"{text}, {'below' if self.met else 'NOT below'} the tolerance {self.tolerance:.2g}"
