"""Evaluates an agent beside planners: ``lasergym evaluate`` as a script, with the same options."""

import sys

from lasergym.cli import main

if __name__ == "__main__":
    sys.exit(main(["evaluate", *sys.argv[1:]]))
