"""Trains an agent: ``lasergym train`` as a script, with the same options."""

import sys

from lasergym.cli import main

if __name__ == "__main__":
    sys.exit(main(["train", *sys.argv[1:]]))
