"""What `robot.toml` may say, as pydantic models (the reference of the file format)."""

import math
from typing import Annotated, Literal

from pydantic import Field, Strict, field_validator, model_validator

from dynreg.sim.engine import ENGINES
from dynreg.sim.gait_tables import GaitTable, PosesTable, TaskTable
from dynreg.sim.sets import NO_LIMIT
from dynreg.sim.table import Table

COMMANDS = 10_000_000  # of one simulator, in a population: 40 times those of the packaged robot that has most
SUBSTEPS = 100_000  # physics time steps in a command: more than a robot of 10 Hz at the shortest time step


class RobotTable(Table):
    """[robot]: the robot and how it is simulated."""

    name: str = Field(
        pattern=r"^[A-Za-z][A-Za-z0-9_\-]*$",
        max_length=100,
        description="The robot's name: a letter, then letters, digits, `_` or `-`.",
    )
    model: str = Field(
        default="model.xml",
        description="The MJCF file, relative to the folder; `/` or `\\\\` between the names of folders.",
    )
    engines: list[Literal[tuple(ENGINES)]] = Field(
        min_length=1,
        description="Engines that can simulate it; the first is used. `joint`: each joint alone, fast. "
        "`mujoco`: the whole model, with contacts. `kinematic`, `unicycle`: a base on wheels.",
    )
    control_rate: float | None = Field(
        default=None,
        ge=0.01,
        le=100_000,
        description='Commands per second [Hz]. Required unless `control = "timed"`.',
    )
    control: Literal["rate", "timed"] = Field(
        default="rate",
        description="`rate`: commands come at `control_rate`. `timed`: each command has its own duration.",
    )
    timestep: float = Field(ge=1e-6, le=0.05, description="Physics time step [s].")
    integrator: Literal["euler", "implicitfast", "rk4"] | None = Field(
        default=None, description="Integrator of the `mujoco` engine; without it, the one in the MJCF model."
    )
    tools: list[str] = Field(
        default_factory=list,
        description="Sites of the MJCF model where the robot may carry something, such as its flange: a diagnosis "
        "looks for a `payload` at each of them. The site's type and size are the payload's shape.",
    )
    tracked: list[str] = Field(
        default_factory=list,
        description="Bodies of the MJCF model beside the robot, each with a free joint, such as a ball: tasks may "
        "score where they go.",
    )
    title: str = Field(default="", description="One line for people.")
    source: str = Field(default="", description="Where the model and its numbers come from.")

    @field_validator("model")
    @classmethod
    def _of_any_system(cls, path: str) -> str:
        return path.replace("\\", "/")

    @model_validator(mode="after")
    def _rate(self):
        if self.control == "rate" and self.control_rate is None:
            raise ValueError("control_rate is missing: give the rate of commands in Hz, or control = 'timed'")
        if self.control_rate is not None and 1 > SUBSTEPS * self.timestep * self.control_rate:
            raise ValueError(
                f"more than {SUBSTEPS} of a timestep of {self.timestep:g} s between two commands"
            )
        return self


class DriveTable(Table):
    """What every drive has. Its numbers hold at the joint: leave `gear` of the MJCF actuator at 1."""

    joint: str = Field(
        description="Joint of the MJCF model, or a whole action name: a base on wheels has two, such as "
        "`base/speed_command`; a joint has one."
    )
    enable: str | None = Field(
        default=None,
        description="Name of a 0/1 channel of the log; the drive gives no torque while it is below 0.5. "
        "It needs no table of its own.",
    )

    @property
    def law(self) -> str:
        """The type of drive whose law the engines run."""
        return self.type


_PROFILE_SPEED = Field(
    default=NO_LIMIT,
    gt=0,
    description="Fastest change of the target that the loop follows [rad/s]: the servo's own profile generator.",
)
_PROFILE_ACCELERATION = Field(
    default=NO_LIMIT, gt=0, description="Largest acceleration of that target [rad/s^2]: a trapezoid of speed."
)


class PositionDrive(DriveTable):
    """torque = clip(gain (target - q) - rate_gain qd, -torque_limit (1 + qd / speed_limit), torque_limit (1 - qd /
    speed_limit)).

    The speed only limits what the motor can give, and neither bound leaves 0 to +-torque_limit; where either limit is
    not stated, it limits nothing. With `back_emf` the bounds are +-torque_limit, and torque_limit / speed_limit qd is
    taken off at every torque.
    """

    type: Literal["position"] = Field(description="The control law.")
    gain: float = Field(ge=0, description="Proportional gain [N*m/rad; N/m of a slide].")
    rate_gain: float = Field(default=0.0, ge=0, description="Derivative gain [N*m*s/rad].")
    torque_limit: float = Field(default=NO_LIMIT, gt=0, description="Largest torque [N*m].")
    speed_limit: float = Field(
        default=NO_LIMIT,
        gt=0,
        description="No-load speed [rad/s]: the largest torque falls in proportion to speed and is zero there.",
    )
    back_emf: bool = Field(
        default=False,
        description="`true` for a servo that sets its motor's voltage (a hobby servo): the speed takes its share off "
        "every torque, and damps. `false` for one that controls the current: speed only limits the torque.",
    )
    profile_speed: float = _PROFILE_SPEED
    profile_acceleration: float = _PROFILE_ACCELERATION


class PidDrive(DriveTable):
    """As `position`, with an integral part: torque = clip(gain (target - q) + integral_gain integral(target - q) -
    rate_gain qd, -torque_limit (1 + qd / speed_limit), torque_limit (1 - qd / speed_limit)).

    The rate is the measured angle's, so that a step of the target gives no kick. The integral begins at 0 with an
    episode and when the drive is switched on, and does not grow while the torque is clipped in its direction. The loop
    runs at the physics time step, and targets come at `control_rate`: 125 Hz for a robot with frames of 8 ms.
    """

    type: Literal["pid"] = Field(description="The control law.")
    gain: float = Field(gt=0, description="Proportional gain, P [N*m/rad; N/m of a slide].")
    integral_gain: float = Field(default=0.0, ge=0, description="Integral gain, I [N*m/rad/s].")
    rate_gain: float = Field(default=0.0, ge=0, description="Derivative gain, D [N*m*s/rad].")
    torque_limit: float = Field(default=NO_LIMIT, gt=0, description="Largest torque [N*m].")
    speed_limit: float = Field(
        default=NO_LIMIT,
        gt=0,
        description="No-load speed [rad/s]: the largest torque falls in proportion to speed and is zero there. It "
        "limits nothing where `torque_limit` is not stated.",
    )

    @property
    def law(self) -> str:
        return "position"  # an integral part moves its target: `effects.integral`


class TorqueDrive(DriveTable):
    """torque = clip(gain command, +-torque_limit)."""

    type: Literal["torque"] = Field(description="The control law.")
    gain: float = Field(default=1.0, description="Torque for one unit of the command [N*m; N of a slide].")
    torque_limit: float = Field(default=NO_LIMIT, gt=0, description="Largest torque [N*m].")


class DutyServo(DriveTable):
    """duty = clip(duty_gain gain (target - q), +-duty_limit); torque = kt / resistance (duty supply - kt qd).

    The control law of Dynamixel XL330 firmware.
    """

    type: Literal["duty_servo"] = Field(description="The control law.")
    gain: float = Field(ge=0, description="The firmware's P register [1].")
    duty_gain: float = Field(gt=0, description="Duty cycle for one unit of gain and error [1/rad].")
    kt: float = Field(gt=0, description="Torque constant [N*m/A].")
    resistance: float = Field(gt=0, description="Winding resistance [ohm].")
    supply: float = Field(gt=0, description="Supply voltage [V], where the log has not measured it.")
    duty_limit: float = Field(
        default=1.0,
        gt=0,
        le=1,
        description="Largest duty cycle [1]: the firmware's PWM limit over its full value.",
    )
    profile_speed: float = _PROFILE_SPEED
    profile_acceleration: float = _PROFILE_ACCELERATION
    supply_input: str | None = Field(
        default=None, description="Name of the table in `[[inputs]]` with the measured supply voltage."
    )


class DcMotor(DriveTable):
    """torque = clip(kt / resistance command, +-torque_limit) - kt^2 / resistance qd; the command is a voltage [V]."""

    type: Literal["dcmotor"] = Field(description="The control law.")
    kt: float = Field(gt=0, description="Torque constant [N*m/A].")
    resistance: float = Field(gt=0, description="Winding resistance [ohm].")
    torque_limit: float = Field(default=NO_LIMIT, gt=0, description="Largest torque [N*m].")


class SpeedDrive(DriveTable):
    """torque = clip(rate_gain (command - qd), +-torque_limit), the command being a speed; for engines with forces."""

    type: Literal["speed"] = Field(description="The control law.")
    rate_gain: float = Field(gt=0, description="Torque for an error of one unit of speed [N*m*s/rad].")
    torque_limit: float = Field(default=NO_LIMIT, gt=0, description="Largest torque [N*m].")


class VelocityDrive(DriveTable):
    """rate of velocity = (gain command - velocity) / lag.

    For the engines kinematic and unicycle. `joint` is an action such as "base/speed_command", or a wheel of [base],
    whose command is a speed of rotation [rad/s]. The lags of both wheels count by their mean.
    """

    type: Literal["velocity"] = Field(description="The control law.")
    enable: None = Field(default=None, description="Not available for this drive.")
    gain: float = Field(default=1.0, description="Speed for one unit of the command [1].")
    lag: float = Field(default=0.0, ge=0, description="Time constant of the speed [s]; 0 follows at once.")


Drive = Annotated[
    PositionDrive | TorqueDrive | PidDrive | DutyServo | DcMotor | SpeedDrive | VelocityDrive,
    Field(discriminator="type"),
]


class SignalTable(Table):
    """A named signal, its SI unit and what it can be."""

    name: str = Field(min_length=1, description="The signal's name, `<joint>/<quantity>`.")
    unit: str = Field(description="SI unit, such as `rad`, `rad/s`, `N*m`, `V`, `1`.")
    low: float | None = Field(default=None, description="Least value; without it, unlimited.")
    high: float | None = Field(default=None, description="Largest value; without it, unlimited.")

    @model_validator(mode="after")
    def _order(self):
        if self.low is not None and self.high is not None and not self.low < self.high:
            raise ValueError(f"low {self.low} is not below high {self.high}")
        return self


class ActionTable(SignalTable):
    """[[actions]]: the commands, in the order of the command vector."""

    low: float | None = Field(
        default=None,
        description="Least command that the drive takes, as MuJoCo's `ctrlrange`: what a log has below it is cut off "
        "in a replay. Without it, unlimited. Populations, experiments and gaits also keep targets within their "
        "joint's range; a replay does not, and a drive may press its joint on a stop.",
    )
    high: float | None = Field(default=None, description="Largest command that the drive takes; see `low`.")
    optional: bool = Field(
        default=False,
        description="`true` where real logs may lack the command. Such logs can be ingested but not "
        "replayed.",
    )


class ChannelTable(SignalTable):
    """[[channels]]: what is measured, in the order of the state vector."""

    noise: float = Field(
        default=0.0, ge=0, description="Standard deviation of the sensor's noise, in `unit`."
    )
    quantum: float = Field(
        default=0.0, ge=0, description="Step of the sensor's quantisation, in `unit` (an encoder's tick)."
    )
    zero: float = Field(
        default=0.0,
        ge=0,
        description="Standard deviation by which a position's zero differs between episodes, in `unit` "
        "(set by hand at every start).",
    )
    weight: float = Field(
        default=1.0,
        ge=0,
        description="Weight of the channel in replay errors. 0 leaves it out: use that for a noisy or a "
        "derived signal, or one whose error never decays.",
    )


class InputTable(SignalTable):
    """[[inputs]]: measured signals that act on the robot from outside."""

    optional: bool = Field(
        default=False, description="`true` where a log may lack it; `nominal` is used there."
    )
    nominal: float = Field(default=0.0, description="Value where the log lacks it, in `unit`.")


class SettingTable(Table):
    """[[settings]]: constants that are known of each episode."""

    name: str = Field(description="The setting's name.")
    unit: str = Field(description="SI unit of the value.")
    nominal: float = Field(description="Value of an episode whose log does not state it.")
    values: list[float] = Field(
        default_factory=list, description="Values that a population's commands run through."
    )
    trial: list[float] = Field(
        default_factory=list,
        description="Values that the commands for a diagnosis alternate between, such as a known added mass.",
    )
    sets: list[str] = Field(
        min_length=1,
        description="What the value sets: see [What `sets` can set](robots.md#what-sets-can-set).",
    )


class ParameterTable(Table):
    """[[parameters]]: what differs from simulator to simulator."""

    name: str = Field(pattern=r"^[A-Za-z][A-Za-z0-9_]*$", description="The parameter's name.")
    unit: str = Field(description="SI unit, or `1` for a factor.")
    nominal: float = Field(description="Value on the nameplate.")
    low: float = Field(description="Least value in a population.")
    high: float = Field(description="Largest value in a population.")
    scale: Literal["linear", "log"] = Field(
        default="linear", description="How a population's values spread over the range."
    )
    tolerance: float = Field(
        default=math.inf,
        gt=0,
        allow_inf_nan=True,
        description="Standard deviation of `nominal`, relative to it (to the width of the range where "
        "`nominal` is 0). `inf`: the nameplate says nothing.",
    )
    known: bool = Field(
        default=False,
        description="`true` where each recording tells the value (the command rate); it is then not "
        "searched for.",
    )
    sets: list[str] = Field(
        min_length=1,
        description="What the value sets: see [What `sets` can set](robots.md#what-sets-can-set).",
    )

    @model_validator(mode="after")
    def _range(self):
        if not self.low < self.high:
            raise ValueError(f"low {self.low} is not below high {self.high}")
        if not self.low <= self.nominal <= self.high:
            raise ValueError(f"nominal {self.nominal} lies outside [{self.low}, {self.high}]")
        if self.scale == "log" and self.low <= 0:
            raise ValueError(f"a log scale needs low > 0, not {self.low}")
        return self


class MaterialTable(Table):
    """[[materials]]: geoms of one material, such as rubber paws beside plastic elbows.

    A diagnosis looks whether one material is more slippery than all others: `second_friction_material[paw]`.
    """

    name: str = Field(
        pattern=r"^[A-Za-z][A-Za-z0-9_]*$",
        description="The material's name, of letters, digits and `_`, such as `paw`.",
    )
    geoms: list[str] = Field(
        min_length=1,
        description='Geoms of the MJCF model, by names or globs: `["*_paw"]`. A geom is of one material at most.',
    )


class BaseTable(Table):
    """[base]: a base on two driven wheels, the joints `left` and `right`; actions are "<wheel>/velocity_command".

    With vl, vr what the commands ask of the wheels on the ground [m/s], v the base's speed and w its yaw rate:
    speed_lag v' = (vl + vr) / 2 - speed_drag v + centrifugal w^2,
    yaw_lag w' = (vr - vl) / track - yaw_drag w - coupling v w.
    """

    left: str = Field(description="Joint of the left wheel.")
    right: str = Field(description="Joint of the right wheel.")
    wheel_radius: float = Field(gt=0, description="Radius of both wheels [m].")
    track: float = Field(gt=0, description="Distance between the wheels [m].")
    speed_lag: float = Field(default=0.0, ge=0, description="Time constant of the speed [s].")
    yaw_lag: float = Field(default=0.0, ge=0, description="Time constant of the yaw rate [s].")
    centrifugal: float = Field(default=0.0, description="Speed gained in turns [m*s/rad^2]; `unicycle` only.")
    speed_drag: float = Field(
        default=1.0, gt=0, description="Drag on the speed [1]: 1 reaches the commanded speed."
    )
    coupling: float = Field(default=0.0, description="Yaw rate lost with speed [s/m]; `unicycle` only.")
    yaw_drag: float = Field(
        default=1.0, gt=0, description="Drag on the yaw rate [1]: 1 reaches the commanded yaw rate."
    )


class ResetTable(Table):
    """[reset]: where episodes start."""

    keyframe: str | None = Field(
        default=None,
        description="Keyframe of the MJCF model where episodes start; without it, the model's `qpos0`.",
    )
    settle: float = Field(
        default=0.0, ge=0, le=60, description="Time that the robot settles there before an episode [s]."
    )
    base: Literal["keyframe", "measured"] = Field(
        default="keyframe",
        description="Where a floating base begins when a log is replayed. `keyframe`: in the pose that it settled in, "
        "at the start of an episode alone, and the log is moved and turned to the place and heading that the keyframe "
        "has. `measured`: with the attitude, position and velocities that the log has there; without a height its "
        "lowest point touches the ground.",
    )


class FallTable(Table):
    """[fall]: what a fall is. A robot without this table never falls."""

    tilt: float = Field(gt=0, description="Tilt of the base beyond which the robot has fallen [rad].")
    height: float = Field(default=0.0, description="Height of the base below which the robot has fallen [m].")


class ExcitationTable(Table):
    """[excitation]: the commands that every simulator of a population runs."""

    episodes: int = Field(
        default=20, ge=2, le=10_000, description="Episodes that every simulator of a population runs."
    )
    steps: int = Field(default=50, ge=2, le=100_000, description="Commands in an episode.")
    kinds: list[Literal["levels", "chirp", "gait", "walk", "triangle", "drop"]] = Field(
        default_factory=lambda: ["levels", "chirp", "walk"],
        min_length=1,
        description="Kinds of commands, in turn. `levels`: random steps. `walk`: a smooth random walk. "
        "`gait`: one frequency for all joints. `chirp`: rising frequency. `triangle`: slow "
        "ramps. `drop`: drives switched off half way.",
    )
    amplitude: float = Field(
        default=0.5,
        gt=0,
        le=1000,
        description="Size of the commands, as a share of the room between the reset pose and the action's"
        " limits. Episodes vary it between 0.3 and 1.7 times.",
    )

    @model_validator(mode="after")
    def _bounded(self):
        if self.episodes * self.steps > COMMANDS:
            raise ValueError(
                f"episodes * steps is {self.episodes * self.steps}, at most {COMMANDS} should be"
            )
        return self


class ReplayTable(Table):
    """[replay]: how recordings are replayed.

    Unstable and chaotic robots need short windows: beyond them two simulations of one robot differ as much
    as those of two robots.
    """

    horizon: float | None = Field(
        default=None,
        gt=0,
        le=86_400,
        description="Longest replay without correction [s]; without it, whole episodes.",
    )


class PopulationTable(Table):
    """[populations.<name>]: other ranges for some parameters."""

    ranges: dict[str, Annotated[tuple[float, float], Strict(False)]] = Field(
        description="Other ranges, `{parameter = [low, high]}`; parameters that are not named keep theirs."
    )

    @field_validator("ranges")
    @classmethod
    def _order(cls, ranges: dict[str, tuple[float, float]]):
        for name, (low, high) in ranges.items():
            if not low < high:
                raise ValueError(f"{name}: low {low} is not below high {high}")
        return ranges


class RobotFile(Table):
    """The whole file; what its parts say about each other is checked by `dynreg.sim.consistency`."""

    robot: RobotTable = Field(description="The robot and how it is simulated.")
    drives: list[Drive] = Field(
        default_factory=list,
        description="How a command becomes a torque, or a speed; one table for each driven joint.",
    )
    actions: list[ActionTable] = Field(
        default_factory=list, description="The commands, in the order of the command vector."
    )
    channels: list[ChannelTable] = Field(
        min_length=1, description="What is measured, in the order of the state vector."
    )
    inputs: list[InputTable] = Field(
        default_factory=list,
        description="Measured signals that act on the robot from outside, such as its supply voltage.",
    )
    settings: list[SettingTable] = Field(
        default_factory=list,
        description="Constants that are known of each episode, such as a gain or an added mass.",
    )
    parameters: list[ParameterTable] = Field(
        min_length=1, description="What differs from simulator to simulator."
    )
    materials: list[MaterialTable] = Field(
        default_factory=list, description="Geoms of one material, where the robot has several."
    )
    base: BaseTable | None = Field(default=None, description="A base on two driven wheels.")
    reset: ResetTable = Field(default=ResetTable(), description="Where episodes start.")
    fall: FallTable | None = Field(
        default=None, description="What a fall is. A robot without this table never falls."
    )
    excitation: ExcitationTable = Field(
        default=ExcitationTable(), description="The commands that every simulator of a population runs."
    )
    replay: ReplayTable = Field(default=ReplayTable(), description="How recordings are replayed.")
    populations: dict[str, PopulationTable] = Field(
        default_factory=dict,
        description="Other ranges of parameters, by name: `dynreg populate ROBOT --ranges NAME`.",
    )
    gait: GaitTable | None = Field(
        default=None, description="How the robot walks, and the bounds of its gaits."
    )
    motions: list[PosesTable] = Field(
        default_factory=list, description="What the robot can do once, such as a kick."
    )
    tasks: list[TaskTable] = Field(
        default_factory=list, description="What a gait is sought for; the first is the usual one."
    )
