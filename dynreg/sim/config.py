"""A simulator's configuration: robot, parameter values, effects."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from dynreg.errors import UsageError, quoted

if TYPE_CHECKING:
    import numpy as np

    from dynreg.sim.effects import Terms
    from dynreg.sim.robot import Robot


@dataclass(frozen=True)
class SimConfig:
    """One simulator. `values` by parameter name, in the parameters' units; `effects` by key with their values."""

    robot: str
    robot_name: str
    values: Mapping[str, float]
    effects: Mapping[str, Mapping[str, float]] = field(default_factory=dict)

    @property
    def id(self) -> str:
        """Content hash, 64 hexadecimal digits."""
        return hashlib.sha256(json.dumps(self.as_dict(), sort_keys=True).encode()).hexdigest()

    def as_dict(self) -> dict[str, Any]:
        """Plain JSON data."""
        return {
            "robot": self.robot,
            "robot_name": self.robot_name,
            "values": {k: float(v) for k, v in self.values.items()},
            "effects": {k: dict(v) for k, v in self.effects.items()},
        }

    @classmethod
    def of(
        cls, robot: "Robot", values: "np.ndarray", effects: Mapping[str, Mapping[str, float]] | None = None
    ) -> "SimConfig":
        """The configuration of a robot with parameters (P,)."""
        return cls(robot.hash, robot.name, robot.space.as_dict(values), effects or {})

    @classmethod
    def from_dict(cls, document: Mapping[str, Any]) -> "SimConfig":
        """The configuration in a stored simulator, whatever else (its lineage) the document holds."""
        return cls(
            document["robot"], document["robot_name"], document["values"], document.get("effects") or {}
        )


def terms_of(config: SimConfig, robot: "Robot") -> "Terms":
    """The effects of a configuration of `robot` as the terms of one simulator, for `rollout(..., terms=)`.

    A shape that has no value takes its typical one, and names of parameters that a version of dynreg before this one
    stored are understood. Raises UsageError for an unknown effect, or values that are not those of its parameters.
    """
    import numpy as np

    from dynreg.sim.effects import Terms, term

    terms, rows = [], []
    for key, values in config.effects.items():
        found = term(key)
        values = found.effect.told(robot, found.at, values)
        names = [p.name for p in found.effect.parameters]
        if sorted(values) != sorted(names):
            raise UsageError(
                f"effect {key!r} with values for {quoted(sorted(values))}",
                expected=f"one for each of {quoted(names)}",
                do="see `dynreg effects`",
            )
        terms.append(found)
        rows.append(np.array([[float(values[name]) for name in names]]))
    return Terms(tuple(terms), tuple(rows))


def effects_of(terms: "Terms | None") -> dict[str, dict[str, float]]:
    """{key: {parameter: value}} of the terms of one simulator, as a configuration has them: `terms_of` turned round."""
    if terms is None:
        return {}
    return {
        term.key: {p.name: float(v) for p, v in zip(term.effect.parameters, row[0], strict=True)}
        for term, row in zip(terms.terms, terms.values, strict=True)
    }
