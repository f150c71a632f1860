"""One plausible document of every kind, for the tests of the command line and the report."""

import math

import made_up_changes
import made_up_comparison
import made_up_diagnosis
import made_up_drift
import made_up_gait
import made_up_navigation

from dynreg.results import (
    Calibration,
    CalibrationStep,
    CarriedBy,
    CarriedEffect,
    Causes,
    ChannelError,
    CollectedFile,
    Collection,
    Cost,
    DatasetExport,
    DraftedMap,
    EntrySummary,
    Estimate,
    FreeQuantity,
    Gain,
    Import,
    Info,
    LikelyCause,
    Listing,
    LogContents,
    LogFinding,
    LogFindings,
    Neighbour,
    Neighbours,
    Nominal,
    PopulationSummary,
    RangesFile,
    RecordingSummary,
    Removal,
    ReportFile,
    Result,
    RobotCheck,
    RobotDraft,
    RobotFolder,
    RobotLine,
    RobotList,
    Stage,
    Synthesised,
    Trace,
    Verification,
)

UNITS = {
    "tip_mass": ("kg", 0.49),
    "torque_constant": ("N*m/A", 0.35),
    "resistance": ("ohm", 4.5),
    "rotor_inertia": ("kg*m^2", 0.0018),
    "coulomb_friction": ("N*m", 0.02),
    "viscous_friction": ("N*m*s/rad", 0.006),
    "zero_offset": ("rad", 0.0),
}
LIMITS = {
    "tip_mass": (0.4, 0.6),
    "torque_constant": (0.2, 0.6),
    "resistance": (2.5, 8.0),
    "zero_offset": (-0.08, 0.08),
}
NOMINAL = {name: value for name, (_, value) in UNITS.items()}
EPISODES = ("sin_sin_kp400", "lift_and_drop_kp400", "up_and_down_kp400")


def neighbours(fits: bool = True, kind: str = "synthesised", held_out: bool = True, k: int = 5) -> Neighbours:
    """A query of the servo bench with plausible numbers."""
    near = tuple(_neighbour(i) for i in range(k))
    answer = {"synthesised": "c0ffee" + "5" * 58, "neighbour": near[0].entry, "nominal": "0" * 64}[kind]
    return Neighbours(
        robot="servo_pendulum",
        population="9a" * 32,
        recording="b7" * 32,
        recording_name="bench_monday",
        distance="one_sided",
        k=k,
        neighbours=near,
        synthesised=Synthesised(simulator="c0ffee" + "5" * 58, replay_error=0.068, parameters=estimates()),
        answer=answer,
        answer_kind=kind,
        answer_parameters=near[0].parameters,
        nominal=Nominal(replay_error=0.1042, parameters=NOMINAL),
        stages=_stages(near[0].entry, answer, held_out),
        gain=Gain(value=0.31, low=0.22, high=0.37),
        parts={
            "fit": ("sin_sin_kp100", "sin_sin_kp800", "up_and_down_kp100"),
            "select": ("sin_sin_kp200", "up_and_down_kp200"),
            "test": EPISODES if held_out else (),
        },
        channels=(
            ChannelError(channel="arm/position", unit="rad", nominal=0.0621, answer=0.0433, spread=0.0051),
            ChannelError(channel="arm/velocity", unit="rad/s", nominal=0.411, answer=0.352, spread=0.03),
        ),
        traces=tuple(_trace(episode, i) for i, episode in enumerate(EPISODES)),
        fits=fits,
        alarm=None
        if fits
        else "replay error 0.41 on select lies above 0.12, the 95 % quantile of the neighbours' own robots",
        notes=("3 episodes are shorter than 2 s",),
        cost=Cost(evaluations=1000, rollouts=142, seconds=8.4),
    )


def estimates() -> dict[str, Estimate]:
    """The bench's parameters with intervals, one of them at its bound."""
    out = {}
    for i, (name, (unit, nominal)) in enumerate(UNITS.items()):
        value = nominal * (1 + 0.07 * (-1) ** i) + (0.012 if name == "zero_offset" else 0)
        half = 0.05 * abs(value) + 1e-4
        out[name] = Estimate(
            value=value,
            low=value - half,
            high=value + half,
            unit=unit,
            nominal=nominal,
            at_bound=i == 4,
            limits=LIMITS.get(name),
        )
    return out


def calibration() -> Calibration:
    """A search of 600 simulations."""
    return Calibration(
        robot="servo_pendulum",
        recording="b7" * 32,
        method="cma",
        simulator="d1" * 32,
        parameters={n: e.model_copy(update={"low": None, "high": None}) for n, e in estimates().items()},
        train_error=0.064,
        test_error=0.071,
        nominal_train_error=0.105,
        nominal_test_error=0.104,
        history=tuple(
            CalibrationStep(simulations=20 * i, error=0.064 + 0.05 * math.exp(-i / 8)) for i in range(1, 31)
        ),
        cost=Cost(evaluations=0, rollouts=600, seconds=41.2),
    )


def causes(outside: bool = False) -> Causes:
    """A log that looks like dry friction that grows with the load, or like nothing known."""
    likely = (("load_friction", 0.93, 0.8), ("stribeck_load_friction", 0.06, 0.2), ("", 0.01, 0.0))
    return Causes(
        robot="servo_pendulum",
        population="c3" * 32,
        recording="b7" * 32,
        recording_name="bench_monday",
        entries=2000,
        k=5,
        causes=tuple(
            LikelyCause(
                effect=effect, joints=(), belief=belief, near=near, cosine=0.96 * belief, entry=f"{i}e" * 32
            )
            for i, (effect, belief, near) in enumerate(likely)
        ),
        resemblance=0.71 if outside else 0.98,
        outside=outside,
        size=0.021,
        noise=0.0031,
        cost=Cost(evaluations=2000, rollouts=19, seconds=0.3),
    )


def _neighbour(i: int) -> Neighbour:
    parameters = {
        n: v * (1 + 0.09 * math.sin(3.1 * i + j)) + 0.001 * i for j, (n, v) in enumerate(NOMINAL.items())
    }
    return Neighbour(
        entry=f"{i:x}a" * 32,
        name=f"servo_pendulum-{417 * (i + 1) % 1000}",
        index=417 * (i + 1) % 1000,
        distance=1.03 + 0.02 * i,
        replay_error=0.079 + 0.004 * i,
        parameters=parameters,
    )


def _stages(nearest: str, answer: str, held_out: bool) -> tuple[Stage, ...]:
    rows = [
        ("nominal", None, 0.105, 0.101, 0.1042, 1),
        ("nearest", nearest, 0.088, 0.086, 0.0903, 5),
        ("replayed", nearest, 0.081, 0.079, 0.0841, 100),
        ("synthesised", answer, 0.066, 0.068, 0.0719, 36),
        ("answer", answer, 0.066, 0.068, 0.0719, 0),
    ]
    return tuple(
        Stage(stage=s, simulator=i, fit=f, select=e, test=t if held_out else None, simulations=n)
        for s, i, f, e, t, n in rows
    )


def _trace(episode: str, phase: int) -> Trace:
    time = [0.01 * i for i in range(600)]
    measured = [
        math.sin(2.2 * t + phase) * (1 - 0.3 * math.sin(0.9 * t)) + 0.02 * math.sin(57 * t) for t in time
    ]
    measured[200:212] = [None] * 12
    return Trace(
        episode=episode,
        channel="arm/position",
        unit="rad",
        time=time,
        measured=measured,
        nominal=[1.12 * math.sin(2.2 * t + phase - 0.16) * (1 - 0.3 * math.sin(0.9 * t)) for t in time],
        answer=[0.98 * math.sin(2.2 * t + phase - 0.04) * (1 - 0.3 * math.sin(0.9 * t)) for t in time],
    )


def recording() -> RecordingSummary:
    """A bench recording."""
    return RecordingSummary(
        recording="b7" * 32,
        name="bench_monday",
        robot="servo_pendulum",
        measured=True,
        episodes=16,
        rows_count=9600,
        duration=96.0,
        rate=100.0,
        channels=("arm/position", "arm/velocity", "arm/target", "supply"),
        settings=("kp",),
        findings=("warning: kp400.csv, row 12: 2 stamps repeat the one before",),
    )


def population() -> PopulationSummary:
    """A population that was just filled."""
    return PopulationSummary(
        population="9a" * 32,
        robot="servo_pendulum",
        entries=1000,
        planned=1000,
        added=1000,
        seconds=74.2,
        simulate_seconds=50.1,
        train_seconds=20.0,
        link_seconds=4.1,
    )


def entry() -> EntrySummary:
    """One simulator of the population."""
    detail = {"own_loss": 0.0123, "parameters": NOMINAL}
    return EntrySummary(
        id="ab" * 32, kind="entry", name="servo_pendulum-417", robot="servo_pendulum", detail=detail
    )


def listing() -> Listing:
    """What a small registry holds."""
    return Listing(registry="dynreg-registry", items=(entry(),))


def removal() -> Removal:
    """A recording that goes with a result."""
    recording = EntrySummary(
        id="b7" * 32, kind="recording", name="bench_monday", robot="servo_pendulum", detail={}
    )
    needing = {"needs": "recording b7b7b7b7b7b7"}
    result = EntrySummary(
        id="c1" * 32, kind="result", name="neighbours", robot="servo_pendulum", detail=needing
    )
    return Removal(
        registry="dynreg-registry", removed=False, items=(recording, result), moved=(), bytes=120_000
    )


def imported() -> Import:
    """A registry of eight simulators that came in, with a name that was taken."""
    return Import(
        registry="dynreg-registry",
        source="monday-registry",
        added={"population": 1, "entry": 8},
        known={"population": 0, "entry": 0},
        left_out=("the name 'bench' of recording b7b7b7b7b7b7: here it means recording c1c1c1c1c1c1",),
    )


def dataset_export() -> DatasetExport:
    """A population as a folder of Parquet files."""
    return DatasetExport(
        place="bench_monday",
        form="parquet",
        robot="servo_pendulum",
        entries=1000,
        recordings=1,
        episodes=40_005,
        transitions=2_000_995,
        bytes=24_000_000,
    )


def collection() -> Collection:
    """A file that nothing names."""
    file = CollectedFile(path="results/neighbours-b7-c1.json", why="nothing names it", bytes=2048)
    return Collection(registry="dynreg-registry", removed=True, files=(file,), bytes=2048)


def verification(faults: tuple[str, ...] = ()) -> Verification:
    """A registry that was checked."""
    return Verification(
        registry="dynreg-registry",
        clean=not faults,
        checked={"files": 31, "entries": 1000},
        faults=faults,
        repaired=(),
        lost=(),
    )


def information() -> Info:
    """Versions and counts."""
    return Info(
        registry="dynreg-registry",
        holds={"population": 1, "recording": 2},
        entries=1000,
        versions={"dynreg": "0.1.0", "mujoco": "4.0.0"},
        optional={"hnswlib": None},
        system="Linux",
        device="cpu",
        cores=2,
    )


def robot_folder() -> RobotFolder:
    """An extended servo with one effect that robot.toml can say, and one that it cannot."""
    return RobotFolder(
        robot="servo_pendulum",
        simulator="5" * 64,
        folder="taken",
        name="servo_pendulum_55555555",
        effects=(
            CarriedEffect(
                effect="payload",
                values={"share": 0.1},
                units={"share": "1"},
                parameters=("effect_payload",),
                mjcf=True,
            ),
            CarriedEffect(
                effect="load_friction",
                values={"coefficient": 0.2},
                units={"coefficient": "1"},
                parameters=(),
                mjcf=False,
            ),
        ),
        mjcf="taken/mujoco.xml",
        model="taken/model.xml",
        warning="load_friction is in neither file: the exported robot does not have it.",
    )


def ranges_file() -> RangesFile:
    """Ranges of a servo that no simulator fits, with an effect that no model can say."""
    mass = {"name": "tip_mass", "unit": "kg", "value": 0.5, "low": 0.4, "high": 0.6}
    noise = {"name": "motor_noise", "unit": "rad", "value": 0.01, "low": 0.005, "high": 0.02}
    return RangesFile(
        robot="servo_pendulum",
        recording_name="bench_monday",
        result="c1" * 32,
        kind="diagnosis",
        simulator="5" * 64,
        file="ranges.toml",
        correlated=False,
        reliable=False,
        warning="Do not rely on these intervals: the model is not complete.",
        complete_in_model=False,
        incomplete="load_friction: no field of a MuJoCo model does this.",
        free=(
            FreeQuantity(**mass, draw="normal", told="by the log", reaches=("body_mass",)),
            FreeQuantity(**noise, draw="uniform", told="not by the log", at_bound=True),
        ),
        fixed=("control_rate",),
        effects=(
            CarriedBy(effect="load_friction", carried_by="engine", why="it acts while the robot moves"),
        ),
        left_out={"motor_noise": "nothing in the simulator depends on it"},
        notes=("correlations are not known",),
    )


def robot_draft() -> RobotDraft:
    """A folder drafted from an arm's model and a log that lacks one joint."""
    return RobotDraft(
        name="my_arm",
        folder="my_arm",
        model="arm.xml",
        log="run.csv",
        engines=("mujoco",),
        control_rate=100.0,
        timestep=0.002,
        joints=("shoulder", "elbow"),
        actions=("shoulder/target", "elbow/target"),
        channels=("shoulder/position", "elbow/position", "shoulder/velocity", "elbow/velocity"),
        parameters=("tip_mass", "gain", "shoulder_friction"),
        bytes=4096,
        map="my_arm/maps/log.toml",
        missing=("elbow/target",),
        notes=("2 meshes were not found and are left out",),
    )


def every_kind() -> tuple[Result, ...]:
    """One of each document."""
    return (
        neighbours(),
        population(),
        recording(),
        entry(),
        listing(),
        verification(),
        removal(),
        imported(),
        collection(),
        calibration(),
        causes(),
        made_up_diagnosis.diagnosis(),
        made_up_diagnosis.effects_list(),
        made_up_diagnosis.trial(),
        made_up_diagnosis.trials(),
        made_up_diagnosis.experiment(),
        made_up_diagnosis.protocol(),
        robot_draft(),
        robot_folder(),
        ranges_file(),
        made_up_gait.gait(),
        made_up_gait.rounds(),
        made_up_changes.changes(),
        made_up_drift.drift(),
        made_up_comparison.comparison(),
        made_up_navigation.navigation(),
        RobotList(
            robots=(
                RobotLine(
                    name="servo_pendulum",
                    title="Servo bench",
                    engines=("joint", "mujoco"),
                    control_rate=100.0,
                    channels=("arm/position", "arm/velocity"),
                    actions=("arm/target",),
                    settings=("kp",),
                    parameters=tuple(NOMINAL),
                ),
            )
        ),
        RobotCheck(robot="my_arm", sound=False, problems=("robot.toml, line 3: unknown key 'colour'",)),
        LogFindings(
            logs=("run.csv",),
            robot="servo_pendulum",
            usable=True,
            findings=(LogFinding(severity="info", check="jitter", where="run.csv", message="uneven stamps"),),
            contents=(
                LogContents(
                    log="run.csv",
                    topic="",
                    type="",
                    messages=800,
                    rate=200.0,
                    begin=0.0,
                    end=4.0,
                    signals=("pos_arm", "cmd_arm"),
                    units={"pos_arm": "deg"},
                ),
            ),
            drafted=DraftedMap(
                text="[map]\n",
                path="map.toml",
                found=("arm/position",),
                missing=("arm/target",),
                ambiguous=("arm/position",),
                settings=("kp",),
            ),
        ),
        ReportFile(result="@last", path="report.html", bytes=81234),
        dataset_export(),
        information(),
    )
