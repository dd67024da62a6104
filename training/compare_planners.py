"""Fills Table 1 of Xie et al. (2022): ``lasergym compare`` as a script, with the same options."""

import sys

from lasergym.cli import main

if __name__ == "__main__":
    sys.exit(main(["compare", *sys.argv[1:]]))
