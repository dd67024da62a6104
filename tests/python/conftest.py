"""Paths that several tests use."""

from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="session")
def assets() -> Path:
    """Drawings of our own making."""
    return ROOT / "tests" / "assets"


@pytest.fixture(scope="session")
def golden() -> Path:
    """Golden files shared with the Rust tests."""
    return ROOT / "tests" / "golden"
