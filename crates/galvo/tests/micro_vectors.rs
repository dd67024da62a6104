//! Micro-vectors do what the vectors do from which they are made.

use std::fmt::Write;

use lasergym_galvo::{
    AnyProgram, GalvoError, HeadKnowledge, LaserControl, MICRO_VECTOR_HEADER, Observer,
    PostOptions, ProgramFormat, PulseLanding, Report, ScanHead, SkyWriting, SkyWritingMode,
    StrokeMeasure, postprocess_text, simulate,
};

/// Lines at two speeds, a square with corners, a vector shorter than the beam, a circle and two heights.
const JOB: &str = "UNITS/MM\nFEDRAT/120000,MMPM\nRAPID\nGOTO/0,0,0\nGOTO/2,0,0\nFEDRAT/60000,MMPM\nRAPID\n\
    GOTO/2,0.5,0\nGOTO/0,0.5,0\nRAPID\nGOTO/-2,-2,0\nGOTO/-1,-2,0\nGOTO/-1,-1,0\nGOTO/-2,-1,0\nGOTO/-2,-2,0\n\
    RAPID\nGOTO/3,3,-0.01\nGOTO/3.02,3,-0.01\nRAPID\nGOTO/1,-1\nCIRCLE/0,-1,0,0,0,1,1\nGOTO/1,-1\nFINI\n";

/// Pulses of the two programs are this near, µm.
const SAME_UM: f64 = 0.1;

struct Pulses(Vec<PulseLanding>);

impl Observer for Pulses {
    fn pulse(&mut self, pulse: &PulseLanding) {
        self.0.push(*pulse);
    }
}

fn program(
    head: &ScanHead,
    options: &PostOptions,
    format: ProgramFormat,
) -> Result<String, GalvoError> {
    let knowledge = HeadKnowledge::of_head(head);
    Ok(postprocess_text(head, &knowledge, options, ("job.apt", JOB), format, 255.0)?.0)
}

fn pulses(head: &ScanHead, name: &str, text: &str) -> Result<Vec<PulseLanding>, GalvoError> {
    let program = AnyProgram::of_name(name, text.as_bytes(), head)?;
    Ok(program.play(head, Pulses(Vec::new()))?.0.0)
}

fn judged(
    head: &ScanHead,
    name: &str,
    text: &str,
) -> Result<(Report, Vec<StrokeMeasure>), GalvoError> {
    let program = AnyProgram::of_name(name, text.as_bytes(), head)?;
    let mut strokes = Vec::new();
    let (report, _) = simulate(head, program, None, |stroke| strokes.push(*stroke))?;
    Ok((report, strokes))
}

fn micro(step_us: u32) -> ProgramFormat {
    ProgramFormat::RtcMicroVectors { step_us }
}

#[test]
fn pulses_land_where_those_of_the_vectors_land() {
    let grbl = ProgramFormat::of_name("grbl").unwrap();
    for (name, _) in ScanHead::shipped_texts() {
        let head = ScanHead::shipped(name).unwrap();
        for control in [LaserControl::Delays, LaserControl::Inline] {
            let options = PostOptions { control, pitch_um: Some(20.0), ..PostOptions::default() };
            let (vectors, list) = (
                program(&head, &options, grbl).unwrap(),
                program(&head, &options, micro(10)).unwrap(),
            );
            let expected = pulses(&head, "job.nc", &vectors).unwrap();
            let found = pulses(&head, "job.csv", &list).unwrap();
            assert_eq!(found.len(), expected.len(), "{name}");
            for (a, b) in found.iter().zip(&expected) {
                let apart_um = a.position_um.distance(b.position_um);
                assert!(apart_um < SAME_UM, "{name}: {apart_um} µm at {} µs", b.time_us);
                assert!(
                    a.stroke == b.stroke && a.first == b.first,
                    "{name} {control:?}: {a:?} {b:?}"
                );
            }
        }
    }
}

#[test]
fn strokes_and_times_are_judged_the_same() {
    let grbl = ProgramFormat::of_name("grbl").unwrap();
    for (name, _) in ScanHead::shipped_texts() {
        let head = ScanHead::shipped(name).unwrap();
        let options = PostOptions { pitch_um: Some(20.0), ..PostOptions::default() };
        let (expected, strokes) =
            judged(&head, "a.nc", &program(&head, &options, grbl).unwrap()).unwrap();
        let list = program(&head, &options, micro(10)).unwrap();
        let (found, same_strokes) = judged(&head, "a.csv", &list).unwrap();
        assert_eq!((found.strokes, found.pulses), (expected.strokes, expected.pulses), "{name}");
        for (a, b) in same_strokes.iter().zip(&strokes) {
            assert!((a.start_error_um - b.start_error_um).abs() < SAME_UM, "{a:?} {b:?}");
            assert!((a.end_error_um - b.end_error_um).abs() < SAME_UM, "{a:?} {b:?}");
        }
        assert!((found.pitch_min - expected.pitch_min).abs() < 0.01);
        assert!((found.pitch_max - expected.pitch_max).abs() < 0.01);
        assert!((found.corner_overburn_max - expected.corner_overburn_max).abs() < 1e-9);
        assert!((found.overburn_max - expected.overburn_max).abs() < 1e-9);
        // A stroke has five stretches of time, each told apart to within a step.
        let steps = |count: u64| 10e-6 * count as f64;
        let (a, b) = (found.time, expected.time);
        assert!((a.total_s() - b.total_s()).abs() < steps(3), "{a:?} {b:?}");
        for (a, b) in [
            (a.mark_s, b.mark_s),
            (a.jump_s, b.jump_s),
            (a.delay_s, b.delay_s),
            (a.run_in_s, b.run_in_s),
        ] {
            assert!((a - b).abs() < steps(2 * (expected.strokes + 1)), "{name}: {a} {b}");
        }
    }
}

#[test]
fn sky_writing_is_in_the_micro_vectors() {
    for mode in [SkyWritingMode::Retrace, SkyWritingMode::Direct, SkyWritingMode::SharpCorners] {
        let mut head = ScanHead::default();
        head.controller.sky_writing = Some(SkyWriting {
            laser_on_shift_us: -300.0,
            ..SkyWriting::automatic(mode, head.x.lag_us())
        });
        let options = PostOptions {
            method: lasergym_galvo::Method::None,
            // No length is a multiple of it: whether a pulse fires as the laser goes off is rounding.
            pitch_um: Some(19.3),
            ..PostOptions::default()
        };
        let grbl = ProgramFormat::of_name("grbl").unwrap();
        let expected = pulses(&head, "a.nc", &program(&head, &options, grbl).unwrap()).unwrap();
        let found = pulses(&head, "a.csv", &program(&head, &options, micro(10)).unwrap()).unwrap();
        assert_eq!(found.len(), expected.len(), "{mode:?}");
        for (a, b) in found.iter().zip(&expected) {
            // The first pulses are where the head still accelerates.
            let apart_um = a.position_um.distance(b.position_um);
            assert!(apart_um < 0.5, "{mode:?}: {apart_um} µm at {} µs", b.time_us);
        }
    }
}

#[test]
fn longer_steps_are_coarser() {
    let head = ScanHead::default();
    let options = PostOptions { pitch_um: Some(20.0), ..PostOptions::default() };
    let grbl = ProgramFormat::of_name("grbl").unwrap();
    let expected = pulses(&head, "a.nc", &program(&head, &options, grbl).unwrap()).unwrap();
    let mut last_um = 0.0;
    for step_us in [10, 40, 100] {
        let list = program(&head, &options, micro(step_us)).unwrap();
        assert!(
            list.starts_with(&format!(
                "{MICRO_VECTOR_HEADER}\n# lasergym step step_us={step_us}\n"
            ))
        );
        let found = pulses(&head, "a.csv", &list).unwrap();
        let apart_um = found
            .iter()
            .zip(&expected)
            .map(|(a, b)| a.position_um.distance(b.position_um))
            .fold(0.0, f64::max);
        assert!(found.len() == expected.len() && apart_um > last_um, "{step_us}: {apart_um}");
        last_um = apart_um;
    }
    // At 1 ms whole strokes would vanish between two rows.
    let knowledge = HeadKnowledge::of_head(&head);
    let hatch = "FEDRAT/120000\n".to_owned() + &"RAPID\nGOTO/0,0\nGOTO/0.1,0\n".repeat(9);
    let options = PostOptions {
        jump_delay_us: Some(0.0),
        mark_delay_us: Some(0.0),
        ..PostOptions::default()
    };
    let refused =
        postprocess_text(&head, &knowledge, &options, ("a.apt", &hatch), micro(1000), 255.0);
    assert!(refused.unwrap_err().to_string().starts_with("step_us is 1000"));
    for step_us in [0, 5, 15, 1010] {
        let job = ("a.apt", JOB);
        let refused = postprocess_text(&head, &knowledge, &options, job, micro(step_us), 255.0);
        assert!(matches!(refused, Err(GalvoError::InvalidOption { name: "step_us", .. })));
    }
}

#[test]
fn a_list_without_notes_has_a_stroke_each_time_the_laser_is_on() {
    // 1 m/s along x, lit from 200 µm to 805 µm.
    let mut list = format!("{MICRO_VECTOR_HEADER}\r\n");
    for k in 0..150 {
        let (x, lit) = (10 * k.min(100), (20..=80).contains(&k));
        let switched = if k == 80 { "5" } else { "" };
        write!(list, "{x},0,{},,{switched}\r\n", u8::from(lit)).unwrap();
    }
    let head = ScanHead::default();
    let (report, strokes) = judged(&head, "list.csv", &list).unwrap();
    assert_eq!((report.strokes, report.empty_strokes), (1, 0));
    assert!((strokes[0].speed_m_s - 1.0).abs() < 1e-9);
    // Without compensation the line lags behind: both ends by 216 µm, once it runs.
    assert!((strokes[0].end_error_um + 216.0).abs() < 25.0, "{strokes:?}");
    assert!((report.time.total_s() - 1490e-6).abs() < 1e-12);
    assert!((report.time.mark_s - 600e-6).abs() < 1e-12);
}

#[test]
fn faults_have_line_column_and_reason() {
    let head = ScanHead::default();
    let rows = |rows: &str| format!("{MICRO_VECTOR_HEADER}\n{rows}\n");
    for (text, line, column, word) in [
        ("x_um,y_um,laser\n0,0,0\n".to_owned(), 1, 1, "header"),
        (rows("0,0,0,"), 2, 7, "five fields"),
        (rows("0,0,0,,,7"), 2, 9, "end of the row"),
        (rows("0,x,0,,"), 2, 3, "number"),
        (rows("0,inf,0,,"), 2, 3, "number"),
        (rows("0,0,,,"), 2, 5, "number"),
        (rows("0,0,2,,"), 2, 5, "0 or 1"),
        (rows("0,0,0,11,"), 2, 7, "step of 10"),
        (rows("0,0,1,,-1"), 2, 8, "step of 10"),
        (rows("0,0,0,,3"), 2, 7, "dark"),
        (rows("0,0,0,5,3"), 2, 7, "dark"),
        (rows("0,0,1,3,"), 2, 7, "lit"),
        (rows("0,0,1,3,5"), 2, 7, "lit"),
        (rows("0,0,1,,\n0,0,0,3,4"), 3, 5, "left it"),
        (rows("20000,0,0,,"), 2, 1, "field"),
        (rows("0,0,0,5,\n1,0,1,,"), 4, 1, "laser on"),
        (rows("# lasergym step step_us=15"), 2, 1, "multiple"),
        (rows("0,0,0,,\n# lasergym step step_us=20"), 3, 1, "before the first row"),
        (rows("# lasergym hop"), 2, 12, "known"),
        (rows("# lasergym mark 3"), 2, 17, "end of the note"),
        (rows("# lasergym pulses stroke=1"), 2, 27, "pulse_rate_hz"),
        (rows("# lasergym pulses stroke=1 pulse_rate_hz=x"), 2, 28, "pulse_rate_hz"),
        (rows("# lasergym pulses stroke=1 pulse_rate_hz=0"), 2, 1, "pulse_rate_hz"),
        (rows("# lasergym pulses stroke=-1 pulse_rate_hz=5"), 2, 1, "count from 0"),
        (
            rows("# lasergym begin stroke=1 x_um=0 y_um=0 angle_deg=0 speed_m_s=0 beam_um=0"),
            2,
            1,
            "speed_m_s",
        ),
        (rows("# lasergym corner stroke=1 y_um=0"), 2, 28, "x_um"),
        (rows("# lasergym layer"), 2, 17, "z_um"),
    ] {
        let program = AnyProgram::of_name("a.csv", text.as_bytes(), &head).unwrap();
        let message = program.marked_box().unwrap_err().to_string();
        let place = format!("line {line}, column {column}: ");
        assert!(message.starts_with(&place) && message.contains(word), "{text:?}: {message}");
    }
}

#[test]
fn a_laser_that_goes_on_before_its_stroke_begins_is_followed() {
    // On 300 µs early, while the head still rests behind the jump.
    let head = ScanHead::default();
    let mut text =
        String::from("(lasergym laser_on_us=-300 laser_off_us=-300 jump_us=1000)\nM3 S9\n");
    text += "G0 X-5 Y0\nG0 X0 Y0\nG1 X1 F60000\nM5\n";
    let found = pulses(&head, "a.nc", &text).unwrap();
    let rest = found.iter().filter(|pulse| pulse.position_um.length() < 1.0).count();
    assert!(rest >= 15, "{rest}");
}
