//! Delays and sky writing have the effects that users of controllers know.

use lasergym_galvo::{
    Controller, Delays, HeadKnowledge, PENCHEV_LAG_US, PostOptions, Postprocessor, ProgramSettings,
    ProgramStep, Report, ScanHead, SkyWriting, SkyWritingMode, StrokeMeasure, simulate_steps,
};
use lasergym_geom::Point;
use lasergym_toolpath::VectorStep;

const SPEED_M_S: f64 = 2.0;

/// Pulses every 7 µm: three of them in half a crater of 40 µm.
const RATE_HZ: f64 = SPEED_M_S / 7.0 * 1e6;

/// Laser delays that suit the lag: the laser is on while the beam is on its way from the start.
fn suited() -> Delays {
    Delays { laser_on_us: PENCHEV_LAG_US, laser_off_us: PENCHEV_LAG_US, ..Delays::default() }
}

fn jump(x: f64, y: f64) -> ProgramStep {
    ProgramStep::Jump { to_um: Point::new(x, y) }
}

fn mark(x: f64, y: f64) -> ProgramStep {
    ProgramStep::Mark { to_um: Point::new(x, y), speed_m_s: SPEED_M_S, lit: true }
}

#[allow(clippy::unwrap_used, reason = "a test that fails says where")]
fn run(
    delays: Delays,
    sky_writing: Option<SkyWriting>,
    path: &[ProgramStep],
) -> (Report, Vec<StrokeMeasure>) {
    let controller = Controller { delays, sky_writing, ..Controller::default() };
    let head = ScanHead { controller, ..ScanHead::default() };
    let settings = ProgramSettings { pulse_rate_hz: RATE_HZ, ..ProgramSettings::of_head(&head) };
    let mut steps = vec![ProgramStep::Settings(settings)];
    steps.extend_from_slice(path);
    let mut strokes = Vec::new();
    let report = simulate_steps(&head, &steps, |stroke| strokes.push(*stroke)).unwrap();
    (report, strokes)
}

/// A corner that turns by `degrees`, from (−2000, 0) over (0, 0).
fn corner(degrees: f64) -> [ProgramStep; 3] {
    let angle = degrees.to_radians();
    [jump(-2000.0, 0.0), mark(0.0, 0.0), mark(2000.0 * angle.cos(), 2000.0 * angle.sin())]
}

#[track_caller]
fn assert_falls(values: &[f64]) {
    assert!(values.windows(2).all(|pair| pair[1] < pair[0]), "{values:?}");
}

#[test]
fn a_longer_jump_delay_straightens_the_start_of_the_next_line() {
    let path = [jump(0.0, -3000.0), mark(2000.0, -3000.0), jump(0.0, 0.0), mark(2000.0, 0.0)];
    let waits = [0.0, 150.0, 300.0, 600.0];
    let runs = waits.map(|jump_us| run(Delays { jump_us, ..suited() }, None, &path));
    assert_falls(&runs.each_ref().map(|(_, strokes)| strokes[1].lateral_error_um));
    assert!(runs[3].1[1].lateral_error_um < 5.0 && runs[0].1[1].lateral_error_um > 100.0);
    for ((report, _), wait_us) in runs.iter().zip(waits) {
        // One jump: the first costs no time.
        assert!((report.time.delay_s * 1e6 - wait_us).abs() < 1e-6);
    }
}

#[test]
fn a_short_jump_waits_less() {
    let delays =
        Delays { jump_us: 500.0, jump_short_us: 100.0, jump_threshold_um: 1000.0, ..suited() };
    let waits = |gap_um: f64| {
        let path = [jump(0.0, 0.0), mark(500.0, 0.0), jump(500.0 + gap_um, 0.0), mark(9e3, 0.0)];
        run(delays, None, &path).0.time.delay_s * 1e6
    };
    assert!((waits(1500.0) - waits(500.0) - 400.0).abs() < 1e-6);
}

#[test]
fn a_longer_mark_delay_straightens_the_end_of_a_line() {
    let path = [jump(0.0, 0.0), mark(2000.0, 0.0), jump(2000.0, 3000.0), mark(0.0, 3000.0)];
    let runs = [0.0, 75.0, 150.0, 300.0]
        .map(|mark_us| run(Delays { mark_us, ..suited() }, None, &path).1[0].lateral_error_um);
    assert_falls(&runs);
    assert!(runs[3] < 1e-6 && runs[0] > 50.0, "{runs:?}");
}

#[test]
fn a_longer_polygon_delay_sharpens_a_corner_and_burns_it() {
    let delays = |polygon_us| Delays { polygon_us, mark_us: 500.0, ..suited() };
    let runs =
        [0.0, 100.0, 300.0, 600.0].map(|wait_us| run(delays(wait_us), None, &corner(90.0)).0);
    assert_falls(&runs.map(|report| -report.corner_overburn_max));
    assert!(runs[0].corner_overburn_max < 2.0 && runs[3].corner_overburn_max > 10.0);
    // The pulses that a rounded corner spares are those of the delay.
    let extra = (runs[3].pulses - runs[0].pulses) as f64;
    assert!((extra - 600e-6 * RATE_HZ).abs() <= 1.0);
    // A variable delay is half as long at a right angle and nothing straight on.
    for (degrees, part) in [(0.001, 0.0), (90.0, 0.5), (179.999, 1.0)] {
        let variable = Delays { variable_polygon: true, ..delays(300.0) };
        let none = run(delays(0.0), None, &corner(degrees)).0.time.delay_s;
        let waited_us = (run(variable, None, &corner(degrees)).0.time.delay_s - none) * 1e6;
        assert!((waited_us - 300.0 * part).abs() < 1e-3, "{waited_us}");
    }
}

#[test]
fn laser_delays_that_do_not_suit_the_lag_shift_the_ends() {
    let path = [jump(0.0, 0.0), mark(4000.0, 0.0)];
    let ends = |laser_on_us, laser_off_us| {
        let delays = Delays { laser_on_us, laser_off_us, mark_us: 1000.0, ..suited() };
        run(delays, None, &path).1[0]
    };
    let suits = ends(1000.0, PENCHEV_LAG_US);
    let (late, early) = (ends(1100.0, PENCHEV_LAG_US), ends(1000.0, PENCHEV_LAG_US - 300.0));
    assert!((late.start_error_um - suits.start_error_um - 200.0).abs() < 0.1);
    // The beam slows down behind the end of the command: within a pulse of 300 µs at full speed.
    assert!((-600.0..0.0).contains(&(early.end_error_um - suits.end_error_um)));
}

#[test]
fn nothing_is_burnt_twice_on_a_straight_line() {
    let sky =
        SkyWriting { n_prev: 100, ..SkyWriting::automatic(SkyWritingMode::Direct, PENCHEV_LAG_US) };
    let (report, _) = run(Delays::default(), Some(sky), &[jump(0.0, 0.0), mark(2000.0, 0.0)]);
    assert!((report.overburn_max - 1.0).abs() < 1e-12, "{report:?}");
    // Without run-in pulses pile up where the mirror starts.
    let (report, _) = run(Delays::default(), None, &[jump(0.0, 0.0), mark(2000.0, 0.0)]);
    assert!(report.overburn_max > 5.0, "{report:?}");
}

#[test]
fn a_sharp_corner_burns_unless_the_stroke_is_broken_there() {
    for degrees in [90.0, 135.0, 170.0] {
        let path = corner(degrees);
        let delays = Delays { polygon_us: 100.0, mark_us: 500.0, ..suited() };
        let (polygon, _) = run(delays, None, &path);
        assert!(polygon.corner_overburn_max > 1.3, "{degrees}°: {polygon:?}");
        // Sky writing at every corner.
        let sky = SkyWriting {
            n_prev: 100,
            ..SkyWriting::automatic(SkyWritingMode::Direct, PENCHEV_LAG_US)
        };
        let (written, _) = run(Delays::default(), Some(sky), &path);
        assert!(written.corner_overburn_max.max(written.overburn_max) <= 1.0, "{written:?}");
        // The adaptive postprocessor.
        let head = ScanHead::default();
        let knowledge = HeadKnowledge::of_head(&head);
        let options = PostOptions {
            speed_m_s: Some(SPEED_M_S),
            pitch_um: Some(7.0),
            ..PostOptions::default()
        };
        let mut steps = Vec::new();
        let mut post = Postprocessor::new(&head, &knowledge, options, |step: &ProgramStep| {
            steps.push(*step);
            Ok(())
        })
        .unwrap();
        for step in path {
            let vector = match step {
                ProgramStep::Jump { to_um } => VectorStep::Jump { to_um },
                ProgramStep::Mark { to_um, .. } => VectorStep::Mark { to_um, speed_m_s: None },
                _ => continue,
            };
            post.step(&vector).unwrap();
        }
        post.finish().unwrap();
        let adaptive = simulate_steps(&head, &steps, |_| {}).unwrap();
        assert!(adaptive.corner_overburn_max.max(adaptive.overburn_max) <= 1.0, "{adaptive:?}");
    }
}

fn sky(mode: SkyWritingMode) -> SkyWriting {
    SkyWriting::automatic(mode, PENCHEV_LAG_US)
}

#[test]
fn sky_writing_adds_run_ins_and_run_outs_of_their_counts() {
    let path = [jump(-5000.0, 0.0), mark(-4000.0, 0.0), jump(0.0, 0.0), mark(2000.0, 0.0)];
    for (mode, ten_us) in [
        (SkyWritingMode::Retrace, 20.0),
        (SkyWritingMode::Direct, 10.0),
        (SkyWritingMode::SharpCorners, 10.0),
    ] {
        let (report, strokes) = run(Delays::default(), Some(sky(mode)), &path);
        let expected_us = 2.0 * ten_us * f64::from(33 + 22);
        assert!((report.time.run_in_s * 1e6 - expected_us).abs() < 1e-6, "{mode:?}: {report:?}");
        // Mode 1 jumps to the drawn start; the others to the start of the run-in, past the run-out.
        let offsets_um = if mode == SkyWritingMode::Retrace { 0.0 } else { 660.0 + 440.0 };
        let jumped_um = report.time.jump_s * 5e6;
        assert!((jumped_um - (4000.0 - offsets_um)).abs() < 1e-6, "{mode:?}: {jumped_um}");
        assert!(report.time.delay_s < 1e-12);
        for stroke in strokes {
            // Met within a pulse, evenly spaced; what is left is not forgotten after 1.5 lags.
            assert!(stroke.start_error_um.abs() < 5.0, "{mode:?}: {stroke:?}");
            assert!((-7.0..2.0).contains(&stroke.end_error_um), "{mode:?}: {stroke:?}");
            assert!(stroke.pitch_min > 0.98 && stroke.pitch_max < 1.02, "{mode:?}: {stroke:?}");
        }
    }
}

#[test]
fn laser_delays_do_not_apply_in_sky_writing() {
    let path = [jump(0.0, 0.0), mark(2000.0, 0.0)];
    let delays = Delays { laser_on_us: 700.0, laser_off_us: -300.0, ..Delays::default() };
    let one = run(delays, Some(sky(SkyWritingMode::Direct)), &path).1;
    let other = run(Delays::default(), Some(sky(SkyWritingMode::Direct)), &path).1;
    assert_eq!(one[0], other[0]);
}

#[test]
fn a_laser_on_shift_moves_the_start_only() {
    let path = [jump(0.0, 0.0), mark(2000.0, 0.0)];
    let strokes = [0.0, 70.0, -70.0].map(|laser_on_shift_us| {
        let shifted = SkyWriting { laser_on_shift_us, n_prev: 100, ..sky(SkyWritingMode::Direct) };
        run(Delays::default(), Some(shifted), &path).1[0]
    });
    // 140 µm are 20 pulses.
    assert!((strokes[1].start_error_um - strokes[0].start_error_um - 140.0).abs() < 0.5);
    assert!((strokes[2].start_error_um - strokes[0].start_error_um + 140.0).abs() < 0.5);
    for stroke in &strokes[1..] {
        assert!((stroke.end_error_um - strokes[0].end_error_um).abs() < 0.5);
    }
}

#[test]
fn a_longer_run_in_evens_the_start_and_a_longer_run_out_the_end() {
    let path = [jump(0.0, 0.0), mark(2000.0, 0.0)];
    let uneven = |n_prev, n_post| {
        let counted = SkyWriting { n_prev, n_post, ..sky(SkyWritingMode::Direct) };
        1.0 - run(Delays::default(), Some(counted), &path).1[0].pitch_min
    };
    assert_falls(&[0, 5, 15, 40].map(|n_prev| uneven(n_prev, 100)));
    assert_falls(&[0, 5, 15, 22].map(|n_post| uneven(100, n_post)));
    assert!(uneven(100, 22) < 1e-3 && uneven(0, 100) > 0.3 && uneven(100, 0) > 0.3);
}

#[test]
fn corners_break_strokes_as_mode_and_limit_say() {
    // cos 20° = 0.940.
    for (mode, limit, strokes) in [
        (SkyWritingMode::Retrace, 0.9, 2),
        (SkyWritingMode::Direct, 0.9, 2),
        (SkyWritingMode::SharpCorners, 0.9, 1),
        (SkyWritingMode::SharpCorners, 0.95, 2),
        (SkyWritingMode::SharpCorners, -1.0, 1),
    ] {
        let limited = SkyWriting { limit, ..sky(mode) };
        let polygon = Delays { polygon_us: 130.0, ..Delays::default() };
        let (report, found) = run(polygon, Some(limited), &corner(20.0));
        assert_eq!(found.len(), strokes, "{mode:?} {limit}");
        // Where the stroke goes on the polygon delay counts.
        let waited_us = report.time.delay_s * 1e6;
        assert!((waited_us - if strokes == 1 { 130.0 } else { 0.0 }).abs() < 1e-6);
    }
}
