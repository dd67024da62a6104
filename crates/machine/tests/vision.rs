//! Vision against the simulator's truth, with the hard cases one by one.

#![allow(clippy::unwrap_used, reason = "a helper that fails fails its test")]

use std::time::Instant;

use lasergym_geom::Point;
use lasergym_machine::simulator::{IMAGING_POSITION_UM, Preset, Rig, SimulatorOptions, TrueMark};
use lasergym_machine::vision::{Vision, VisionOptions};
use lasergym_machine::{
    Camera, CameraCalibration, Frame, Laser, Observation, Observer, ObserverError, Stage, Verdict,
};
use proptest::prelude::*;

/// A rig with its vision and the frame that was taken last.
struct Bench {
    rig: Rig,
    vision: Vision,
    last: Frame,
    origin: Point,
}

impl Bench {
    fn new(options: SimulatorOptions, seed: u64) -> Self {
        let rig = Rig::new(options, seed).unwrap();
        let last = rig.camera().frame().unwrap();
        let origin = rig.frame_displacement_um();
        let options = VisionOptions::default();
        let vision = Vision::new(rig.true_calibration(), &last, options).unwrap();
        rig.laser().arm().unwrap();
        Self { rig, vision, last, origin }
    }

    /// Without chance in stage and laser, so that a test says where marks are.
    fn steady(preset: Preset, seed: u64) -> Self {
        let steady = Preset::Ideal.options();
        Self::new(
            SimulatorOptions {
                backlash_um: 0.0,
                vibration_um: 0.0,
                drift_um_per_move: 0.0,
                settling_error_um: 0.0,
                impulse_probability: 0.0,
                radius_noise_px: 0.0,
                misfire_probability: 0.0,
                double_fire_probability: 0.0,
                stage_margin_um: steady.stage_margin_um,
                ..preset.options()
            },
            seed,
        )
    }

    fn fire(&self, position: Point) {
        self.rig.stage().move_to(position).unwrap();
        self.rig.laser().fire().unwrap();
        self.rig.stage().move_to(IMAGING_POSITION_UM).unwrap();
    }

    fn look(&mut self, aimed: Point) -> Observation {
        let after = self.rig.camera().frame().unwrap();
        let observation = self.vision.observe(&self.last, &after, aimed).unwrap();
        self.last = after;
        observation
    }

    fn pulse(&mut self, position: Point) -> Observation {
        self.fire(position);
        self.look(position)
    }

    fn last_mark(&self) -> TrueMark {
        *self.rig.true_marks().last().unwrap()
    }

    /// Distance of the one mark that was seen from the last true one, px.
    fn error_px(&self, observation: &Observation) -> f64 {
        assert_eq!(observation.verdict, Verdict::Seen, "{observation:?}");
        assert_eq!(observation.marks.len(), 1, "{observation:?}");
        let truth = self.last_mark().center_px() - self.origin;
        observation.marks[0].center_px.distance(truth)
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    /// On fresh ground a mark is where it is to a tenth of a pixel, wherever it was aimed.
    #[test]
    fn lone_marks_are_found_anywhere(
        x in 5.0..95.0,
        y in 5.0..95.0,
        (aim_x, aim_y) in (0.0..100.0, 0.0..100.0),
        seed in 0_u64..1000,
    ) {
        let mut bench = Bench::steady(Preset::Lab, seed);
        bench.fire(Point::new(x, y));
        let observation = bench.look(Point::new(aim_x, aim_y));
        prop_assert!(bench.error_px(&observation) < 0.15, "{:?}", observation);
        prop_assert!((observation.marks[0].radius_px - 9.0).abs() < 0.15);
    }

    /// A crescent beside an earlier mark has the centre and radius of its whole disc.
    #[test]
    fn crescents_are_whole_discs(
        angle_rad in 0.0..std::f64::consts::TAU,
        distance in 3.0..17.0,
        seed in 0_u64..1000,
    ) {
        let mut bench = Bench::steady(Preset::Lab, seed);
        let first = Point::new(50.0, 50.0);
        bench.pulse(first);
        let (sin, cos) = f64::sin_cos(angle_rad);
        let observation = bench.pulse(first + Point::new(cos, sin) * distance);
        prop_assert!(bench.error_px(&observation) < 0.6, "{:?}", observation);
        prop_assert!((observation.marks[0].radius_px - 9.0).abs() < 0.6);
    }

    /// Where the stage comes back to is found to a few hundredths of a pixel and taken out.
    #[test]
    fn shifts_of_the_view_are_taken_out(
        (dx, dy) in (-4.0..4.0, -4.0..4.0),
        seed in 0_u64..1000,
    ) {
        let mut bench = Bench::steady(Preset::Lab, seed);
        for position in [Point::new(40.0, 40.0), Point::new(60.0, 45.0), Point::new(50.0, 60.0)] {
            bench.rig.stage().move_to(position).unwrap();
            bench.rig.laser().fire().unwrap();
            let stands = IMAGING_POSITION_UM + Point::new(dx, dy);
            bench.rig.stage().move_to(stands).unwrap();
            let observation = bench.look(position);
            let expected = Point::new(-dx, -dy);
            prop_assert!(observation.shift_px.distance(expected) < 0.08, "{:?}", observation);
            prop_assert!(bench.error_px(&observation) < 0.2);
        }
    }
}

/// The stage may jump in any direction between two frames while the lamp flickers.
#[test]
fn a_jump_of_the_view_is_followed() {
    for seed in 0..12 {
        let mut bench = Bench::steady(Preset::Harsh, seed);
        for k in 0..6 {
            let (sin, cos) = f64::sin_cos(f64::from(k) * 2.4 + seed as f64);
            let stands = Point::new(cos, sin) * 6.0;
            let position = Point::new(20.0 + 12.0 * f64::from(k), 50.0);
            bench.rig.stage().move_to(position).unwrap();
            bench.rig.laser().fire().unwrap();
            bench.rig.stage().move_to(IMAGING_POSITION_UM + stands).unwrap();
            let observation = bench.look(position);
            let off = observation.shift_px.distance(stands * -1.0);
            assert!(off < 0.15, "{seed} {k} {observation:?}");
        }
    }
}

#[test]
fn nothing_is_seen_where_nothing_was_fired() {
    for preset in Preset::ALL {
        for seed in 0..10 {
            let mut bench = Bench::steady(preset, seed);
            bench.pulse(Point::new(40.0, 50.0));
            let observation = bench.look(Point::new(60.0, 50.0));
            assert_ne!(observation.verdict, Verdict::Seen, "{preset:?} {seed} {observation:?}");
        }
    }
}

#[test]
fn dust_alone_is_no_mark() {
    for seed in 0..20 {
        let mut bench = Bench::steady(Preset::Lab, seed);
        bench.rig.settle_dust(40);
        let observation = bench.look(Point::new(50.0, 50.0));
        assert_eq!(observation.verdict, Verdict::Nothing, "{seed} {observation:?}");
        assert!(observation.marks.is_empty());
    }
}

#[test]
fn a_second_pulse_on_the_same_place_is_never_a_mark_elsewhere() {
    for preset in Preset::ALL {
        for seed in 0..10 {
            let mut bench = Bench::steady(preset, seed);
            let position = Point::new(45.0, 55.0);
            bench.pulse(position);
            let observation = bench.pulse(position);
            if observation.verdict == Verdict::Seen {
                assert!(bench.error_px(&observation) < 1.5, "{preset:?} {seed} {observation:?}");
            }
        }
    }
}

#[test]
fn ground_without_any_trace_of_a_second_pulse_shows_nothing() {
    let options = SimulatorOptions { rehit_fraction: 0.0, ..Preset::Ideal.options() };
    let mut bench = Bench::new(options, 1);
    let position = Point::new(45.0, 55.0);
    bench.pulse(position);
    let observation = bench.pulse(position);
    assert_eq!(observation.verdict, Verdict::Nothing, "{observation:?}");
}

#[test]
fn marks_at_the_border_of_the_pattern_are_found() {
    for (x, y) in [(0.0, 0.0), (100.0, 0.0), (0.0, 100.0), (100.0, 100.0), (50.0, 0.0)] {
        let mut bench = Bench::steady(Preset::Lab, 3);
        let observation = bench.pulse(Point::new(x, y));
        assert!(bench.error_px(&observation) < 0.3, "{x} {y} {observation:?}");
    }
}

#[test]
fn marks_that_the_view_cuts_are_found() {
    // The view ends 7 to 8 µm above and below the pattern.
    for (x, y) in [(30.0, -6.0), (70.0, 105.0), (-20.0, 50.0), (120.0, 40.0)] {
        let mut bench = Bench::steady(Preset::Lab, 3);
        let observation = bench.pulse(Point::new(x, y));
        assert!(bench.error_px(&observation) < 0.6, "{x} {y} {observation:?}");
    }
}

#[test]
fn marks_far_from_their_aim_are_found() {
    for seed in 0..10 {
        let mut bench = Bench::steady(Preset::Lab, seed);
        bench.fire(Point::new(25.0, 30.0));
        let observation = bench.look(Point::new(80.0, 75.0));
        assert!(bench.error_px(&observation) < 0.15, "{observation:?}");
    }
}

#[test]
fn an_aim_that_is_no_number_does_not_matter() {
    let mut bench = Bench::steady(Preset::Lab, 1);
    bench.fire(Point::new(25.0, 30.0));
    let observation = bench.look(Point::new(f64::NAN, f64::INFINITY));
    assert!(bench.error_px(&observation) < 0.15, "{observation:?}");
}

#[test]
fn two_marks_of_a_double_fire_are_both_found() {
    for (dx, dy) in [(25.0, 0.0), (0.0, 12.0), (-8.0, 8.0)] {
        let mut bench = Bench::steady(Preset::Lab, 2);
        let first = Point::new(50.0, 50.0);
        let second = first + Point::new(dx, dy);
        bench.fire(first);
        bench.fire(second);
        let observation = bench.look(first);
        assert_eq!(observation.verdict, Verdict::Seen);
        for truth in [first, second] {
            let near = observation
                .marks
                .iter()
                .map(|mark| mark.center_px.distance(truth))
                .fold(f64::INFINITY, f64::min);
            assert!(near < 0.8, "{dx} {dy} {observation:?}");
        }
    }
}

#[test]
fn a_double_fire_on_one_place_is_one_mark() {
    let options = SimulatorOptions { double_fire_probability: 1.0, ..Preset::Lab.options() };
    let mut bench = Bench::new(options, 4);
    let observation = bench.pulse(Point::new(50.0, 50.0));
    assert_eq!(bench.rig.true_marks().len(), 2);
    assert!(bench.error_px(&observation) < 0.5, "{observation:?}");
}

#[test]
fn a_flickering_lamp_is_no_change() {
    let options = SimulatorOptions {
        flicker_fraction: 0.1,
        flicker_tilt_fraction: 0.03,
        ..Preset::Lab.options()
    };
    for seed in 0..10 {
        let mut bench =
            Bench::new(SimulatorOptions { misfire_probability: 0.0, ..options.clone() }, seed);
        let idle = bench.look(Point::new(50.0, 50.0));
        assert_eq!(idle.verdict, Verdict::Nothing, "{idle:?}");
        let observation = bench.pulse(Point::new(50.0, 50.0));
        assert!(bench.error_px(&observation) < 0.3, "{observation:?}");
    }
}

#[test]
fn a_view_that_is_registered_by_a_fresh_vision_is_the_same() {
    let mut bench = Bench::new(Preset::Lab.options(), 6);
    let reference = bench.last.clone();
    let mut observations = Vec::new();
    let mut frames = vec![reference.clone()];
    for k in 0..6 {
        let position = Point::new(30.0 + 7.0 * f64::from(k), 50.0);
        observations.push(bench.pulse(position));
        frames.push(bench.last.clone());
    }
    let calibration = bench.rig.true_calibration();
    let mut fresh = Vision::new(calibration, &reference, VisionOptions::default()).unwrap();
    let position = Point::new(65.0, 50.0);
    let again = fresh.observe(&frames[5], &frames[6], position).unwrap();
    let distance = again.marks[0].center_px.distance(observations[5].marks[0].center_px);
    assert!(distance < 0.05, "{distance}");
}

#[test]
fn frames_of_another_size_are_refused() {
    let bench = Bench::steady(Preset::Ideal, 1);
    let calibration = bench.rig.true_calibration();
    let small = Frame::new(320, 240, vec![100; 320 * 240], Instant::now()).unwrap();
    let error = Vision::new(calibration, &small, VisionOptions::default()).unwrap_err();
    assert!(matches!(
        error,
        ObserverError::FrameSize { width_px: 320, expected_width_px: 640, .. }
    ));
    let mut bench = bench;
    let error = bench.vision.observe(&bench.last, &small, IMAGING_POSITION_UM).unwrap_err();
    assert!(matches!(error, ObserverError::FrameSize { height_px: 240, .. }));
}

#[test]
fn other_ground_is_refused() {
    let mut bench = Bench::steady(Preset::Lab, 1);
    let other = Rig::new(Preset::Lab.options(), 99).unwrap().camera().frame().unwrap();
    let error = bench.vision.observe(&bench.last, &other, IMAGING_POSITION_UM).unwrap_err();
    assert!(matches!(error, ObserverError::Registration { .. }), "{error}");
}

#[test]
fn dark_frames_are_refused() {
    let mut bench = Bench::steady(Preset::Lab, 1);
    let dark = Frame::new(640, 480, vec![0; 640 * 480], Instant::now()).unwrap();
    let error = bench.vision.observe(&bench.last, &dark, IMAGING_POSITION_UM).unwrap_err();
    assert!(matches!(error, ObserverError::Registration { .. }), "{error}");
    let calibration = bench.rig.true_calibration();
    let error = Vision::new(calibration, &dark, VisionOptions::default()).unwrap_err();
    assert!(matches!(error, ObserverError::Registration { .. }), "{error}");
}

#[test]
fn a_frame_of_very_few_pixels_is_refused() {
    let tiny = Frame::new(20, 20, vec![100; 400], Instant::now()).unwrap();
    let calibration = CameraCalibration::rough(20, 20, 4.0, IMAGING_POSITION_UM).unwrap();
    let error = Vision::new(calibration, &tiny, VisionOptions::default()).unwrap_err();
    assert!(matches!(error, ObserverError::Registration { .. }), "{error}");
}
