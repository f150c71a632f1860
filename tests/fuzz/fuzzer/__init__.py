"""A fuzzer of everything that dynreg reads from strangers; `run.py` beside this package is its command."""
