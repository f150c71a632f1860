"""`python -m dynreg`: the program, where its script is not on the path."""

from dynreg.cli.main import run

if __name__ == "__main__":
    run()
