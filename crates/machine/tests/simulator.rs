//! Laws of the simulated machine.

#![allow(clippy::unwrap_used, reason = "a helper that fails fails its test")]

use lasergym_geom::Point;
use lasergym_machine::simulator::{
    IMAGING_POSITION_UM, Preset, Rig, SimulatedError, SimulatorOptions,
};
use lasergym_machine::{Camera, DriverError, FaultKind, Laser, Stage};
use proptest::prelude::*;

fn pulse(rig: &Rig, position: Point) {
    let (mut stage, mut laser) = (rig.stage(), rig.laser());
    stage.move_to(position).unwrap();
    laser.arm().unwrap();
    laser.fire().unwrap();
    laser.disarm().unwrap();
    stage.move_to(IMAGING_POSITION_UM).unwrap();
}

fn gray(rig: &Rig) -> Vec<u8> {
    rig.camera().frame().unwrap().gray().to_vec()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

    /// Without errors a mark is a disc exactly where the stage was told to go, and the frame shows
    /// it there: dark inside, bright outside.
    #[test]
    fn an_ideal_rig_does_what_it_is_told(x in 0.0..100.0, y in 0.0..100.0) {
        let rig = Rig::new(Preset::Ideal.options(), 1).unwrap();
        let before = gray(&rig);
        pulse(&rig, Point::new(x, y));
        let after = gray(&rig);
        let marks = rig.true_marks();
        prop_assert_eq!(marks.len(), 1);
        prop_assert_eq!((marks[0].x_px, marks[0].y_px, marks[0].radius_px), (x, y, 9.0));
        let calibration = rig.true_calibration();
        // The rim is 0.5 frame px outside the disc, and the square window of the blur, 3 frame px
        // to each side, brings it 4.3 frame px further along a diagonal; 4 frame px are 1 px.
        let untouched_px = 9.0 + (0.5 + 4.3) / 4.0;
        for j in (0..480).step_by(3) {
            for i in (0..640).step_by(3) {
                let frame = Point::new(f64::from(i) + 0.5, f64::from(j) + 0.5);
                let distance = calibration.pattern_px(frame).distance(Point::new(x, y));
                let at = (j * 640 + i) as usize;
                if distance < 8.2 {
                    let kept = f64::from(after[at]) / f64::from(before[at]);
                    prop_assert!((kept - 0.6).abs() < 0.02, "{}", kept);
                } else if distance > untouched_px {
                    prop_assert_eq!(after[at], before[at]);
                }
            }
        }
    }

    /// Saved and loaded in the middle, a rig does what it would have done.
    #[test]
    fn a_saved_rig_goes_on_as_it_would_have(seed in 0_u64..1000, at in 0_usize..5) {
        let rig = Rig::new(Preset::Harsh.options(), seed).unwrap();
        let mut resumed = None;
        for k in 0..5_usize {
            if k == at {
                let json = serde_json::to_string(&rig.state()).unwrap();
                resumed = Some(Rig::from_state(serde_json::from_str(&json).unwrap()).unwrap());
            }
            for rig in std::iter::once(&rig).chain(&resumed) {
                pulse(rig, Point::new(20.0 + 12.0 * k as f64, 50.0));
                rig.camera().frame().unwrap();
            }
        }
        let resumed = resumed.unwrap();
        prop_assert_eq!(resumed.state(), rig.state());
        prop_assert_eq!(gray(&resumed), gray(&rig));
    }
}

#[test]
fn the_same_seed_gives_the_same_frames() {
    let run = |seed| {
        let rig = Rig::new(Preset::Lab.options(), seed).unwrap();
        pulse(&rig, Point::new(40.0, 60.0));
        (gray(&rig), rig.true_marks())
    };
    assert_eq!(run(7), run(7));
    assert_ne!(run(7).0, run(8).0);
}

#[test]
fn backlash_holds_the_carriage_back_the_way_it_came() {
    let options = SimulatorOptions { backlash_um: 2.0, ..Preset::Ideal.options() };
    let rig = Rig::new(options, 1).unwrap();
    let mut stage = rig.stage();
    let mut marks = |from: f64| {
        stage.move_to(Point::new(from, 50.0)).unwrap();
        stage.move_to(Point::new(50.0, 50.0)).unwrap();
        assert_eq!(stage.position_um().unwrap(), Point::new(50.0, 50.0));
        let mut laser = rig.laser();
        laser.arm().unwrap();
        laser.fire().unwrap();
        rig.true_marks().last().unwrap().x_px
    };
    assert_eq!((marks(20.0), marks(80.0)), (49.0, 51.0));
}

#[test]
fn vibration_and_radius_noise_have_their_deviation() {
    let options =
        SimulatorOptions { vibration_um: 0.5, radius_noise_px: 0.2, ..Preset::Ideal.options() };
    let rig = Rig::new(options, 3).unwrap();
    let mut laser = rig.laser();
    laser.arm().unwrap();
    for _ in 0..1000 {
        laser.fire().unwrap();
    }
    let marks = rig.true_marks();
    let deviation = |value: &dyn Fn(usize) -> f64| {
        ((0..1000).map(|k| value(k).powi(2)).sum::<f64>() / 1000.0).sqrt()
    };
    assert!((deviation(&|k| marks[k].x_px - 50.0) - 0.5).abs() < 0.06);
    assert!((deviation(&|k| marks[k].y_px - 50.0) - 0.5).abs() < 0.06);
    assert!((deviation(&|k| marks[k].radius_px - 9.0) - 0.2).abs() < 0.03);
}

#[test]
fn misfires_and_double_fires_come_as_often_as_said() {
    let options = SimulatorOptions {
        misfire_probability: 0.1,
        double_fire_probability: 0.2,
        ..Preset::Ideal.options()
    };
    let rig = Rig::new(options, 5).unwrap();
    let mut laser = rig.laser();
    laser.arm().unwrap();
    let mut counts = [0_usize; 3];
    for _ in 0..1000 {
        let before = rig.true_marks().len();
        laser.fire().unwrap();
        counts[rig.true_marks().len() - before] += 1;
    }
    assert!(counts[0].abs_diff(100) < 50 && counts[2].abs_diff(200) < 65, "{counts:?}");
}

#[test]
fn a_laser_that_is_not_armed_does_not_fire() {
    let rig = Rig::new(Preset::Ideal.options(), 1).unwrap();
    let mut laser = rig.laser();
    assert_eq!(laser.fire(), Err(SimulatedError::NotArmed));
    laser.arm().unwrap();
    laser.disarm().unwrap();
    assert_eq!(laser.fire(), Err(SimulatedError::NotArmed));
    assert!(rig.true_marks().is_empty());
}

#[test]
fn positions_beyond_the_limits_are_refused() {
    let rig = Rig::new(Preset::Ideal.options(), 1).unwrap();
    let mut stage = rig.stage();
    for (x, y) in [(126.0, 50.0), (50.0, -26.0), (f64::NAN, 50.0), (f64::INFINITY, 0.0)] {
        let error = stage.move_to(Point::new(x, y)).unwrap_err();
        assert_eq!(error.kind(), FaultKind::OutOfLimits);
    }
    assert_eq!(stage.position_um(), Ok(IMAGING_POSITION_UM));
}

#[test]
fn exposures_that_the_camera_does_not_have_are_refused() {
    let rig = Rig::new(Preset::Ideal.options(), 1).unwrap();
    for exposure_s in [0.0, -1.0, f64::NAN, 11.0] {
        let error = rig.camera().set_exposure_s(exposure_s);
        assert!(matches!(error, Err(SimulatedError::Exposure { .. })));
    }
}

#[test]
fn half_the_exposure_is_half_as_bright() {
    let rig = Rig::new(Preset::Ideal.options(), 1).unwrap();
    let whole = gray(&rig);
    rig.camera().set_exposure_s(0.01).unwrap();
    let half = gray(&rig);
    assert!(whole.iter().zip(&half).all(|(whole, half)| half.abs_diff(whole / 2) <= 1));
}

#[test]
fn noise_is_that_of_the_electrons() {
    let options = SimulatorOptions {
        electrons_per_level: 40.0,
        read_noise_levels: 1.0,
        texture_contrast: 0.0,
        brightness_levels: 160.0,
        ..Preset::Ideal.options()
    };
    let rig = Rig::new(options, 1).unwrap();
    let levels: Vec<f64> = gray(&rig).into_iter().map(f64::from).collect();
    let count = levels.len() as f64;
    let mean = levels.iter().sum::<f64>() / count;
    let variance = levels.iter().map(|level| (level - mean).powi(2)).sum::<f64>() / count;
    // Shot noise, read noise and rounding.
    let expected = 160.0 / 40.0 + 1.0 + 1.0 / 12.0;
    assert!((mean - 160.0).abs() < 0.05 && (variance / expected - 1.0).abs() < 0.03);
}

#[test]
fn time_is_virtual_and_adds_up() {
    let rig = Rig::new(Preset::Ideal.options(), 1).unwrap();
    pulse(&rig, Point::new(80.0, 90.0));
    rig.camera().frame().unwrap();
    let times = rig.elapsed_s();
    // Twice 50 µm at 10 000 µm/s²: half the way speeding up, half slowing down.
    assert!((times.move_s - 2.0 * 2.0 * f64::sqrt(50.0 / 1e4)).abs() < 1e-9);
    assert!((times.settle_s - 0.1).abs() < 1e-12);
    assert!((times.expose_s - 0.04).abs() < 1e-12 && (times.pulse_s - 0.01).abs() < 1e-12);
    let sum = times.move_s + times.settle_s + times.expose_s + times.pulse_s;
    assert!((times.total_s() - sum).abs() < 1e-12);
}

#[test]
fn states_that_are_none_are_refused() {
    let state = Rig::new(Preset::Lab.options(), 1).unwrap().state();
    let mut position = state.clone();
    position.screw_um[0] = f64::NAN;
    let mut speck = state.clone();
    speck.specks[0].radius_px = 1e9;
    let mut options = state;
    options.options.vibration_um = -1.0;
    assert!(matches!(Rig::from_state(position), Err(SimulatedError::State { .. })));
    assert!(matches!(Rig::from_state(speck), Err(SimulatedError::State { .. })));
    assert!(matches!(Rig::from_state(options), Err(SimulatedError::InvalidOption { .. })));
}
