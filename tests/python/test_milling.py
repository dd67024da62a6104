"""Depth milling: solving, simulating, calibrating, height files and the command line."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from lasergym import milling
from lasergym.cli import main
from lasergym.errors import DepthMapError, EmptyTargetError, MillingError, OptionError

QUICK = {"iterations": 8, "free_iterations": 5}


@pytest.fixture
def dish_um() -> NDArray[np.float64]:
    y, x = np.mgrid[0:24, 0:30] / 24 - 0.5
    return 16 + 4 * np.sin(5 * x) + 6 * (np.hypot(x, y) < 0.3)


def test_solving_beats_pixel_by_pixel_and_simulating_agrees(dish_um: NDArray[np.float64]) -> None:
    result = milling.solve(dish_um, pixel_um=6, **QUICK)
    assert result.tracking_error_percent < 0.7 * result.pixel_by_pixel_error_percent
    assert not result.partial
    assert result.depth_um.shape == result.target_um.shape == dish_um.shape
    error = np.abs(result.depth_um - dish_um)
    np.testing.assert_allclose(
        result.tracking_error_percent, 100 * error.sum() / dish_um.sum(), rtol=1e-9
    )
    again = milling.simulate(result.passes, dish_um, pixel_um=6)
    np.testing.assert_array_equal(again.depth_um, result.depth_um)
    speeds = result.passes.speed_mm_s
    assert speeds.min() >= 200 - 1e-9
    assert speeds.max() <= 800 + 1e-9
    pixel = milling.simulate(None, dish_um, pixel_um=6)
    assert pixel.tracking_error_percent == result.pixel_by_pixel_error_percent
    assert 0 < result.exposure_s <= result.machining_time_s


def test_the_waterjet_mills_from_a_profile_file(tmp_path: Path) -> None:
    profile = tmp_path / "jet.toml"
    profile.write_text(milling.profile_text("waterjet-garnet").replace("200.0", "150.0"))
    target = np.full((16, 16), 110.0)
    result = milling.solve(target, pixel_um=60, process=profile, **QUICK)
    assert result.tracking_error_percent < result.pixel_by_pixel_error_percent


def test_the_callback_stops_the_solver(dish_um: NDArray[np.float64]) -> None:
    seen: list[tuple[float, float]] = []

    def stop(fraction: float, error: float) -> bool:
        seen.append((fraction, error))
        return len(seen) == 2

    result = milling.solve(dish_um, pixel_um=6, progress=stop)
    assert result.partial
    assert len(seen) == 2
    assert result.tracking_error_percent < result.pixel_by_pixel_error_percent


def test_an_error_of_the_callback_reaches_the_caller(dish_um: NDArray[np.float64]) -> None:
    def fail(_fraction: float, _error: float) -> bool:
        raise KeyError("mine")

    with pytest.raises(KeyError, match="mine"):
        milling.solve(dish_um, pixel_um=6, progress=fail)


def test_programs_have_every_stretch(dish_um: NDArray[np.float64]) -> None:
    result = milling.solve(dish_um, pixel_um=6, iterations=2, free_iterations=0)
    lines = result.to_csv().splitlines()
    assert lines[0] == "pass,point,x_um,y_um,speed_mm_s,beam_on"
    assert len(lines) > len(result.passes.y_um)
    program = result.to_gcode(power_s=500)
    assert program.splitlines()[-1] == "M5 S0"
    assert " S500" in program
    with pytest.raises(OptionError, match="power_s"):
        result.to_gcode(power_s=-1)


@pytest.mark.parametrize(
    ("target", "error", "match"),
    [
        (np.zeros((9, 9)), EmptyTargetError, "nothing to remove"),
        (np.full((9, 9), np.nan), DepthMapError, "row 0, column 0"),
        (np.full((9, 9), -1.0), DepthMapError, "finite"),
        (np.ones(9), DepthMapError, "shape"),
        ([["a"]], DepthMapError, "numbers"),
        (np.zeros((0, 0)), MillingError, "0 × 0"),
    ],
)
def test_bad_targets_are_refused(target: object, error: type[Exception], match: str) -> None:
    with pytest.raises(error, match=match):
        milling.solve(target, pixel_um=5)  # type: ignore[arg-type]


def test_measuring_after_each_layer_makes_up_for_a_wrong_model(tmp_path: Path) -> None:
    # The plant's footprint is 5 % wider, its rate 5 % lower.
    plant_file = tmp_path / "plant.toml"
    text = milling.profile_text("laser-graphite")
    text = text.replace("radius_um = 22.5", f"radius_um = {22.5 * 1.05}")
    text = text.replace("peak_um_s = 75000.0", f"peak_um_s = {75000 * 0.95 / 1.05**2}")
    plant_file.write_text(text)
    y, x = np.mgrid[0:30, 0:30] / 30
    target = 30 + 8 * np.sin(6 * x) * np.cos(5 * y)

    def plant(passes: milling.Passes, surface: milling.Surface) -> milling.Surface:
        return milling.simulate(
            passes, target, pixel_um=6, process=plant_file, measured_um=surface
        ).depth_um

    settings: dict[str, Any] = {"pixel_um": 6, "iterations": 15, "free_iterations": 0}
    planned = milling.solve(target, layers=3, **settings)
    opened = plant(planned.passes, np.zeros_like(target))
    loop = milling.closed_loop(target, plant, layers=3, **settings)
    error = {
        name: 100 * np.abs(surface - target).sum() / target.sum()
        for name, surface in (("open", opened), ("closed", loop.depth_um))
    }
    assert error["closed"] < 0.5 * error["open"]
    assert len(loop.surfaces_um) == 3
    assert [plan.layers for plan in loop.plans] == [3, 2, 1]


def test_a_job_goes_on_from_a_measured_surface(dish_um: NDArray[np.float64]) -> None:
    first = milling.solve(dish_um, pixel_um=6, layers=3, **QUICK)
    layer = first.layer(0)
    assert len(layer.y_um) * 3 == len(first.passes.y_um)
    surface = milling.simulate(layer, dish_um, pixel_um=6).depth_um
    noise = np.random.default_rng(1).normal(0, 0.1, surface.shape)
    rest = milling.solve(dish_um, pixel_um=6, layers=2, measured_um=surface + noise, **QUICK)
    assert rest.layers == 2
    assert rest.tracking_error_percent < 1.5 * first.tracking_error_percent + 0.5
    # A surface measured with coarser pixels is interpolated.
    coarse = surface.reshape(12, 2, 15, 2).mean(axis=(1, 3))
    assert milling.solve(dish_um, pixel_um=6, layers=2, measured_um=coarse, **QUICK).layers == 2
    for measured, error, match in (
        (np.full((24, 31), 1.0), DepthMapError, "measure the whole target"),
        (np.full((24, 30), np.nan), DepthMapError, "row 0, column 0"),
        (np.full((24, 30), 99.0), EmptyTargetError, "nothing to remove"),
        (np.ones(3), DepthMapError, "shape"),
    ):
        with pytest.raises(error, match=match):
            milling.solve(dish_um, pixel_um=6, measured_um=measured)
    with pytest.raises(OptionError, match="layer"):
        first.layer(3)


def test_bad_options_are_refused(dish_um: NDArray[np.float64]) -> None:
    for options, match in (
        ({"pixel_um": 0.0}, "cell_um"),
        ({"process": "laser"}, "laser-graphite, waterjet-garnet"),
        ({"layers": 0}, "layers"),
        ({"layers": 1}, "allow 2 layers"),
        ({"iterations": 0}, "iterations"),
        ({"free_range": 0.9}, "free_range"),
        ({"process": "waterjet-garnet"}, "base depth"),
    ):
        with pytest.raises(ValueError, match=match):
            milling.solve(dish_um, **{"pixel_um": 6, **options})  # type: ignore[arg-type]


def test_trenches_calibrate_a_process(tmp_path: Path) -> None:
    # Trenches of a Gaussian beam and a power law, from their closed form.
    radius, exponent, peak = 20.0, 0.4, 6e4
    noise = np.random.default_rng(3)
    rows = ["speed_mm_s,y_um,depth_um"]
    for speed in (200.0, 400.0, 800.0):
        for y in np.linspace(-50, 50, 101):
            depth = peak * (speed / 400) ** exponent / (speed * 1e3) * radius * np.sqrt(np.pi / 2)
            depth *= np.exp(-2 * (y / radius) ** 2)
            rows.append(f"{speed},{y},{depth + 0.02 * noise.standard_normal()}")
    path = tmp_path / "trenches.csv"
    path.write_text("\n".join(rows))
    found = {one.name: one for one in milling.calibrate(path).parameters}
    # The model brings the Gaussian to 0 at two radii, which the closed form does not.
    for name, value in (("peak_um_s", peak), ("radius_um", radius), ("exponent", exponent)):
        np.testing.assert_allclose(found[name].value, value, rtol=0.02)
        assert 0 < found[name].confidence_95 < 0.02 * value
    path.write_text("speed_mm_s,y_um,depth_um\n1,2\n")
    with pytest.raises(MillingError, match="line 2"):
        milling.calibrate(path)


def test_heights_are_read_from_files(tmp_path: Path) -> None:
    values = np.arange(12, dtype=np.float32).reshape(3, 4)
    np.save(tmp_path / "a.npy", values)
    np.testing.assert_array_equal(milling.load_heights(tmp_path / "a.npy"), values)
    np.save(tmp_path / "b.npy", np.asfortranarray(values))
    np.testing.assert_array_equal(milling.load_heights(tmp_path / "b.npy"), values)
    body = "\n".join(" ".join(map(str, row)) for row in values)
    (tmp_path / "c.asc").write_text(f"ncols 4\nnrows 3\ncellsize 30\n{body}\n")
    np.testing.assert_array_equal(milling.load_heights(tmp_path / "c.asc"), values)
    image = pytest.importorskip("PIL.Image")
    image.fromarray(values).save(tmp_path / "c.tiff")
    np.testing.assert_array_equal(milling.load_heights(tmp_path / "c.tiff"), values)
    corners = ((0, 0, 0), (0.04, 0, 0.01), (0, 0.03, 0))
    triangle = struct.pack("<12fH", 0, 0, 1, *(v for corner in corners for v in corner), 0)
    (tmp_path / "d.stl").write_bytes(bytes(80) + struct.pack("<I", 1) + triangle)
    assert milling.load_heights(tmp_path / "d.stl", pixel_um=10).shape == (3, 4)
    for name in ("e.bmp", "e.npy", "e.tif"):
        (tmp_path / name).write_bytes(b"nothing")
        with pytest.raises(DepthMapError):
            milling.load_heights(tmp_path / name)


def test_heights_become_depths() -> None:
    heights = [[0.0, 1.0], [2.0, 4.0]]
    np.testing.assert_allclose(milling.depths(heights, depth_um=8, base_um=1), [[9, 7], [5, 1]])
    np.testing.assert_allclose(
        milling.depths(heights, depth_um=8, scale="high-sinks"), [[0, 2], [4, 8]]
    )
    with pytest.raises(OptionError, match="scale"):
        milling.depths(heights, scale="sideways")  # type: ignore[arg-type]


def run(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    code = main(arguments)
    captured = capsys.readouterr()
    return code, captured.out, captured.err


def test_the_command_writes_a_job(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], dish_um: NDArray[np.float64]
) -> None:
    np.save(tmp_path / "relief.npy", -dish_um)
    job = tmp_path / "job"
    code, out, _ = run(
        capsys,
        *("mill", str(tmp_path / "relief.npy"), "--pixel-um", "6", "--depth-um", "14"),
        *("--base-um", "8", "--process", "laser-graphite", "-o", str(job), "--json"),
        *("--iterations", "8", "--free-iterations", "4"),
    )
    assert code == 0
    report = json.loads(out)
    assert report == json.loads((job / "report.json").read_text())
    assert 0 < report["tracking_error_percent"] < report["pixel_by_pixel_error_percent"]
    assert report["machining_time_s"] > 0
    assert report["elapsed_s"] > 0
    for name in ("passes.csv", "passes.nc"):
        assert (job / name).stat().st_size > 100
    assert np.load(job / "surface_um.npy").shape == dish_um.shape


def test_the_command_goes_on_from_a_measured_surface(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], dish_um: NDArray[np.float64]
) -> None:
    np.save(tmp_path / "relief.npy", dish_um)
    arguments = ("mill", str(tmp_path / "relief.npy"), "--pixel-um", "6", "--json")
    arguments += ("--iterations", "6", "--free-iterations", "0")
    code, out, _ = run(
        capsys, *arguments, "--layers", "3", "--one-layer", "-o", str(tmp_path / "first")
    )
    assert code == 0
    passes = json.loads(out)["passes"]
    lines = (tmp_path / "first" / "passes.csv").read_text().splitlines()
    assert int(lines[-1].split(",")[0]) <= passes // 3
    np.save(tmp_path / "measured.npy", 0.4 * dish_um)
    code, out, _ = run(
        capsys, *arguments, "--layers", "2", "--measured", str(tmp_path / "measured.npy")
    )
    assert code == 0
    report = json.loads(out)
    assert report["layers"] == 2
    assert report["measured"] == str(tmp_path / "measured.npy")
    assert report["tracking_error_percent"] < 10


def test_the_command_refuses_bad_input(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], dish_um: NDArray[np.float64]
) -> None:
    relief = tmp_path / "relief.npy"
    np.save(relief, dish_um)
    for arguments, words in (
        ((str(relief),), "--pixel-um"),
        ((str(relief), "--pixel-um", "6", "--width-mm", "1"), "--pixel-um"),
        ((str(relief), "--pixel-um", "6", "--layers", "1"), "layers"),
        ((str(relief), "--pixel-um", "6", "-o", str(relief)), "folder"),
        ((str(relief), "--pixel-um", "6", "--process", "axe"), "axe"),
        ((str(tmp_path / "x.bmp"), "--pixel-um", "6"), "x.bmp"),
    ):
        code, out, err = run(capsys, "mill", *arguments)
        assert code in (1, 2)
        assert out == ""
        assert "error:" in err
        assert words in err
