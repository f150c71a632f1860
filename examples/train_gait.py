"""A gait for the robot of a log: query, search, export.

python examples/train_gait.py LOG... [--registry FOLDER] [--n 1000] [--rollouts N] [--to gait.py]
"""

import argparse

import dynreg
from dynreg.verbs.gait import ON


def main(arguments: list[str] | None = None) -> None:
    """Populate, ingest, seek a gait in the query's answer and draws about it, and write what a robot can run."""
    parser = argparse.ArgumentParser(description="Seek a gait for the quadruped of some logs.")
    parser.add_argument("logs", nargs="+")
    parser.add_argument("--robot", default="quadruped")
    parser.add_argument("--registry", default="dynreg-registry")
    parser.add_argument("--on", default=ON)
    parser.add_argument("--n", type=int, default=1000)
    parser.add_argument("--rollouts", type=int, help="[as many as the command has]")
    parser.add_argument("--to", default="gait.py")
    given = parser.parse_args(arguments)
    with dynreg.open(given.registry) as registry:
        if given.on in ("posterior", "nearest", "synthesised", "random"):
            registry.populate(given.robot, given.n)
        recording = registry.ingest(given.logs, given.robot)
        gait = registry.gait(recording, on=given.on, k=5, rollouts=given.rollouts)
        print(gait)
        print(gait.to_frame().to_string(index=False))
        registry.export_gait("@last", given.to, "python")


if __name__ == "__main__":
    main()
