"""The session of `make demo` in Python.

python examples/query_in_python.py LOG... [--registry FOLDER] [--n 1000]
"""

import argparse

import dynreg


def main(arguments: list[str] | None = None) -> None:
    """Populate, ingest, query, and print what is worth knowing."""
    parser = argparse.ArgumentParser(description="Find the servo bench's nearest simulators for some logs.")
    parser.add_argument("logs", nargs="+")
    parser.add_argument("--registry", default="demo/registry")
    parser.add_argument("--map", help="TOML map; the XL330 bench's JSON logs need none")
    parser.add_argument("--n", type=int, default=1000)
    given = parser.parse_args(arguments)
    with dynreg.open(given.registry) as registry:
        registry.populate("servo_pendulum", given.n, progress=lambda *step: print(*step))
        recording = registry.ingest(given.logs, "servo_pendulum", log_map=given.map)
        found = registry.query(recording, k=5, hold_out="kp=400")
        print(found)
        print(found.to_frame().to_string(index=False))
        for name, estimate in found.synthesised.parameters.items():
            print(
                f"{name}: {estimate.value:.4g} in [{estimate.low:.4g}, {estimate.high:.4g}] {estimate.unit}"
            )
        if not found.fits:
            print("alarm:", found.alarm)


if __name__ == "__main__":
    main()
