"""What `robot.toml` may say, as pydantic models (the reference of the file format)."""

import math
from typing import Annotated, Literal

from pydantic import Field, Strict, field_validator, model_validator

from dynreg.sim.engine import ENGINES
from dynreg.sim.gait_tables import GaitTable, TaskTable
from dynreg.sim.table import Table

COMMANDS = 10_000_000  # of one simulator, in a population: 40 times those of the packaged robot that has most
SUBSTEPS = 100_000  # physics time steps in a command: more than a robot of 10 Hz at the shortest time step


class RobotTable(Table):
    """[robot]: `control_rate` [Hz] and physics `timestep` [s], or control = "timed".

    integrator : of the mujoco engine; by default the one that the MJCF model states.
    """

    name: str = Field(pattern=r"^[A-Za-z][A-Za-z0-9_\-]*$", max_length=100)
    model: str = "model.xml"
    engines: list[Literal[tuple(ENGINES)]] = Field(min_length=1)
    control_rate: float | None = Field(default=None, ge=0.01, le=100_000)
    control: Literal["rate", "timed"] = "rate"
    timestep: float = Field(ge=1e-6, le=0.05)
    integrator: Literal["euler", "implicitfast", "rk4"] | None = None
    title: str = ""
    source: str = ""

    @model_validator(mode="after")
    def _rate(self):
        if self.control == "rate" and self.control_rate is None:
            raise ValueError("control_rate is missing: give the rate of commands in Hz, or control = 'timed'")
        if self.control_rate is not None and 1 > SUBSTEPS * self.timestep * self.control_rate:
            raise ValueError(
                f"more than {SUBSTEPS} of a timestep of {self.timestep:g} s between two commands"
            )
        return self


class PositionDrive(Table):
    """torque = clip(gain (target - q) - rate_gain qd, +-torque_limit) - torque_limit / speed_limit qd.

    gain [N m/rad], rate_gain [N m s/rad], torque_limit [N m], speed_limit [rad/s, no-load].
    """

    type: Literal["position"]
    joint: str
    enable: str | None = None
    gain: float = Field(ge=0)
    rate_gain: float = Field(default=0.0, ge=0)
    torque_limit: float = Field(default=1e6, gt=0)
    speed_limit: float = Field(default=1e6, gt=0)


class TorqueDrive(Table):
    """torque = clip(gain command, +-torque_limit); gain [N m or N per unit of the command]."""

    type: Literal["torque"]
    joint: str
    enable: str | None = None
    gain: float = 1.0
    torque_limit: float = Field(default=1e6, gt=0)


class DutyServo(Table):
    """duty = clip(duty_gain gain (target - q), -1, 1); torque = kt / resistance (duty supply - kt qd).

    The control law of Dynamixel XL330 firmware: gain [1] is the P register, duty_gain [1/rad],
    kt [N m/A], resistance [ohm], supply [V] (the measured input where the log has it).
    """

    type: Literal["duty_servo"]
    joint: str
    enable: str | None = None
    gain: float = Field(ge=0)
    duty_gain: float = Field(gt=0)
    kt: float = Field(gt=0)
    resistance: float = Field(gt=0)
    supply: float = Field(gt=0)
    supply_input: str | None = None


class DcMotor(Table):
    """torque = clip(kt / resistance command, +-torque_limit) - kt^2 / resistance qd, command [V]."""

    type: Literal["dcmotor"]
    joint: str
    enable: str | None = None
    kt: float = Field(gt=0)
    resistance: float = Field(gt=0)
    torque_limit: float = Field(default=1e6, gt=0)


class VelocityDrive(Table):
    """rate of velocity = (gain command - velocity) / lag; gain [1], lag [s], at once where it is 0.

    For the kinematic and the unicycle engine; `joint` is a whole action name such as "base/speed_command", or a wheel
    of [base], whose command is a speed of rotation [rad/s]; the lags of both wheels count by their mean.
    """

    type: Literal["velocity"]
    joint: str
    enable: None = None
    gain: float = 1.0
    lag: float = Field(default=0.0, ge=0)


Drive = Annotated[
    PositionDrive | TorqueDrive | DutyServo | DcMotor | VelocityDrive, Field(discriminator="type")
]


class SignalTable(Table):
    """A named signal, its SI unit and what it can be."""

    name: str = Field(min_length=1)
    unit: str
    low: float | None = None
    high: float | None = None

    @model_validator(mode="after")
    def _order(self):
        if self.low is not None and self.high is not None and not self.low < self.high:
            raise ValueError(f"low {self.low} is not below high {self.high}")
        return self


class ActionTable(SignalTable):
    """[[actions]]: "<joint>/<kind>", in the order of the action vector.

    `optional` where real logs do not hold it: they can be ingested, but there is nothing to replay.
    """

    optional: bool = False


class ChannelTable(SignalTable):
    """[[channels]]: the state vector; noise [1 sigma] and quantum in the channel's unit.

    `zero` : 1 sigma by which a position's zero differs from episode to episode (set anew by hand at every start).
    """

    noise: float = Field(default=0.0, ge=0)
    quantum: float = Field(default=0.0, ge=0)
    zero: float = Field(default=0.0, ge=0)
    weight: float = Field(default=1.0, ge=0)


class InputTable(SignalTable):
    """[[inputs]]: measured exogenous signals; `nominal` is used where a log lacks an optional one."""

    optional: bool = False
    nominal: float = 0.0


class SettingTable(Table):
    """[[settings]]: known constants of an episode; `values` are those that excitation covers.

    `trial` : those that the commands for a diagnosis alternate between (a known mass added, for one).
    """

    name: str
    unit: str
    nominal: float
    values: list[float] = Field(default_factory=list)
    trial: list[float] = Field(default_factory=list)
    sets: list[str] = Field(min_length=1)


class ParameterTable(Table):
    """[[parameters]]: what differs between simulators of a population."""

    name: str = Field(pattern=r"^[A-Za-z][A-Za-z0-9_]*$")
    unit: str
    nominal: float
    low: float
    high: float
    scale: Literal["linear", "log"] = "linear"
    tolerance: float = Field(default=math.inf, gt=0, allow_inf_nan=True)
    known: bool = False
    sets: list[str] = Field(min_length=1)

    @model_validator(mode="after")
    def _range(self):
        if not self.low < self.high:
            raise ValueError(f"low {self.low} is not below high {self.high}")
        if not self.low <= self.nominal <= self.high:
            raise ValueError(f"nominal {self.nominal} lies outside [{self.low}, {self.high}]")
        if self.scale == "log" and self.low <= 0:
            raise ValueError(f"a log scale needs low > 0, not {self.low}")
        return self


class BaseTable(Table):
    """[base]: a base on two driven wheels, the joints `left` and `right`; actions are "<wheel>/velocity_command".

    With vl, vr what the commands ask of the wheels on the ground [m/s], v the base's speed and w its yaw rate:
    speed_lag v' = (vl + vr) / 2 - speed_drag v + centrifugal w^2,
    yaw_lag w' = (vr - vl) / track - yaw_drag w - coupling v w.

    wheel_radius, track [m] between the wheels; speed_lag, yaw_lag [s]; speed_drag, yaw_drag [1]; centrifugal
    [m*s/rad^2] and coupling [s/m], which only the unicycle engine has.
    """

    left: str
    right: str
    wheel_radius: float = Field(gt=0)
    track: float = Field(gt=0)
    speed_lag: float = Field(default=0.0, ge=0)
    yaw_lag: float = Field(default=0.0, ge=0)
    centrifugal: float = 0.0
    speed_drag: float = Field(default=1.0, gt=0)
    coupling: float = 0.0
    yaw_drag: float = Field(default=1.0, gt=0)


class ResetTable(Table):
    """[reset]: the keyframe an episode starts from and how long [s] it may settle there."""

    keyframe: str | None = None
    settle: float = Field(default=0.0, ge=0, le=60)


class FallTable(Table):
    """[fall]: the robot has fallen when its base tilts by more than `tilt` [rad] or sinks below `height` [m]."""

    tilt: float = Field(gt=0)
    height: float = 0.0


class ExcitationTable(Table):
    """[excitation]: the bank of command sequences that every simulator of a population runs."""

    episodes: int = Field(default=20, ge=2, le=10_000)
    steps: int = Field(default=50, ge=2, le=100_000)
    kinds: list[Literal["levels", "chirp", "gait", "walk", "triangle", "drop"]] = Field(
        default_factory=lambda: ["levels", "chirp", "walk"], min_length=1
    )
    amplitude: float = Field(default=0.5, gt=0, le=1000)

    @model_validator(mode="after")
    def _bounded(self):
        if self.episodes * self.steps > COMMANDS:
            raise ValueError(
                f"episodes * steps is {self.episodes * self.steps}, at most {COMMANDS} should be"
            )
        return self


class ReplayTable(Table):
    """[replay]: recordings are replayed in windows of at most `horizon` [s]; without it, whole episodes.

    Unstable and chaotic robots need short windows: beyond them two simulations of one robot differ as much
    as those of two robots.
    """

    horizon: float | None = Field(default=None, gt=0, le=86_400)


class PopulationTable(Table):
    """[populations.<name>]: other ranges for some parameters, as {parameter = [low, high]}."""

    ranges: dict[str, Annotated[tuple[float, float], Strict(False)]]

    @field_validator("ranges")
    @classmethod
    def _order(cls, ranges: dict[str, tuple[float, float]]):
        for name, (low, high) in ranges.items():
            if not low < high:
                raise ValueError(f"{name}: low {low} is not below high {high}")
        return ranges


class RobotFile(Table):
    """The whole file; what its parts say about each other is checked by `dynreg.sim.consistency`."""

    robot: RobotTable
    drives: list[Drive] = Field(default_factory=list)
    actions: list[ActionTable] = Field(default_factory=list)
    channels: list[ChannelTable] = Field(min_length=1)
    inputs: list[InputTable] = Field(default_factory=list)
    settings: list[SettingTable] = Field(default_factory=list)
    parameters: list[ParameterTable] = Field(min_length=1)
    base: BaseTable | None = None
    reset: ResetTable = ResetTable()
    fall: FallTable | None = None
    excitation: ExcitationTable = ExcitationTable()
    replay: ReplayTable = ReplayTable()
    populations: dict[str, PopulationTable] = Field(default_factory=dict)
    gait: GaitTable | None = None
    tasks: list[TaskTable] = Field(default_factory=list)
