"""Export of plans: the timed commands that `navigate` found, as a file for a robot."""

from pathlib import Path

from dynreg.errors import AmbiguousError, NoMatchError, UsageError
from dynreg.registry import Registry
from dynreg.results.navigation import Navigation
from dynreg.verbs.written import write_new

KIND = "navigation"


def is_plan(registry: Registry, ref: str) -> bool:
    """Whether a ref names a stored plan. Raises NoMatchError where it names several things."""
    try:
        _, identity = registry.resolve(ref, ("result",))
    except AmbiguousError:
        raise
    except NoMatchError:
        return False
    return registry.result(identity).kind == KIND


def export_plan(registry: Registry, ref: str, path: Path) -> Navigation:
    """Write the commands of a stored plan to a new CSV file, and return the plan.

    A row is a command: when it begins [s], how long it holds [s], and the robot's own actions. The last row stops the
    robot. Raises NoMatchError where no result is called so, UsageError for one of another kind, or a name that is taken
    or cannot be written.
    """
    _, identity = registry.resolve(ref, ("result",))
    stored = registry.result(identity)
    if stored.kind != KIND:
        raise UsageError(
            f"result {ref!r} is of kind {stored.kind!r}",
            expected="a plan of `dynreg navigate`",
            do="see `dynreg list --kind result`",
        )
    plan = Navigation.model_validate(stored.document)
    write_new(path, plan.csv.encode())
    return plan
