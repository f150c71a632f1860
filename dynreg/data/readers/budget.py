"""The resources that one log has used so far, compared with the limits."""

from collections import Counter

from dynreg.errors import LogError
from dynreg.limits import limits, refuse, variable


class Budget:
    """Counts what is read of one log, and refuses it past a limit.

    A count is kept while the log is read, for what a file says of itself may be wrong.
    """

    def __init__(self, name: str):
        self.name = name
        self._limits = limits()
        self._spent: Counter[str] = Counter()

    def allowed(self, limit: str) -> int:
        """What the limit allows."""
        return getattr(self._limits, limit)

    def spend(self, limit: str, amount: int = 1) -> None:
        """Count `amount` more of what the limit bounds; LogError past it."""
        self._spent[limit] += amount
        if self._spent[limit] > self.allowed(limit):
            self.refuse(limit, self._spent[limit])

    def check(self, limit: str, amount: int) -> None:
        """LogError where `amount` alone is past the limit."""
        if amount > self.allowed(limit):
            self.refuse(limit, amount)

    def past(self, limit: str, amount: int) -> str:
        """Says that `amount` is past the limit, where what lies there is left out and the rest is read."""
        return f"{amount} {limit.replace('_', ' ')}, of which {variable(limit)} allows {self.allowed(limit)}"

    def refuse(self, limit: str, amount: int) -> None:
        """Raise the LogError that names the limit."""
        refuse(
            LogError, f"{self.name!r} asks for more {limit.replace('_', ' ')} than are read", amount, limit
        )
