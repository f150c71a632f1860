"""A simulator's configuration: robot, parameter values, effects."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class SimConfig:
    """One simulator. `values` by parameter name, in the parameters' units; `effects` by id with their values."""

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
